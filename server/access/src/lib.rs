//! Who may ask for what, and who did what: tokens and their scopes, people whom a proxy has signed in, origins, and the audit
//! record.

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
