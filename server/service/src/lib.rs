#![doc = include_str!("../README.md")]

pub mod app;
pub mod routes;
pub mod state;
#[cfg(test)]
mod tests;
pub mod wire;
