//! The program: configuration, and the commands that start the application.

pub mod cli;
pub mod config;
mod figures;
mod health;
pub mod logs;
pub mod start;
