//! What every HTTP interface of the server shares: problems, conditional requests, negotiation of formats, access, limits on
//! connections and bodies, metrics and the log of requests.

pub mod audited;
pub mod auth;
pub mod client;
pub mod conditional;
pub mod door;
pub mod form_body;
pub mod fresh;
mod guesses;
pub mod listen;
pub mod logs;
pub mod metrics;
pub mod negotiate;
pub mod origins;
pub mod pace;
pub mod problem;
pub mod proxy;
pub mod query;
pub mod refusals;
pub mod scopes;
pub mod sent;
pub mod tls;
pub mod tokens;
mod unstalled;
pub mod uploads;
