#![doc = include_str!("../README.md")]

pub mod audit;
pub mod audited;
pub mod auth;
mod error;
pub mod origins;
pub mod proxy;
pub mod routes;
pub mod scopes;
pub mod tokens;

pub use error::AccessError;
