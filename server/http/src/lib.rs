#![doc = include_str!("../README.md")]

pub mod client;
pub mod client_limit;
pub mod conditional;
pub mod files;
pub mod form_body;
pub mod forwarded;
pub mod fresh;
pub mod listen;
pub mod logs;
pub mod metrics;
pub mod negotiate;
pub mod problem;
pub mod query;
pub mod refusals;
pub mod sent;
pub mod timeouts;
pub mod tls;
pub mod unread;
pub mod uploads;
mod write_timeout;
