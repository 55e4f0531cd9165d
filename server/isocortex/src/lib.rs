#![doc = include_str!("../README.md")]

pub mod cli;
pub mod config;
mod figures;
mod health;
pub mod logs;
pub mod start;
