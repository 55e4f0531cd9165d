//! What every HTTP interface of the server shares: problems, conditional requests, negotiation of formats, access, limits on
//! connections and bodies, metrics and the log of requests.

pub mod audited;
pub mod auth;
pub mod client;
pub mod conditional;
pub mod form_body;
pub mod forwarded;
pub mod fresh;
pub mod listen;
pub mod logs;
pub mod metrics;
pub mod negotiate;
pub mod origins;
pub mod problem;
pub mod proxy;
pub mod query;
pub mod refusals;
pub mod scopes;
pub mod sent;
pub mod tls;
pub mod tokens;
pub mod uploads;
mod write_timeout;
