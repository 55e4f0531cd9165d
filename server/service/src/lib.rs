//! Cases over HTTP: an axum router on top of the application, and the page.

pub mod app;
pub mod auth;
pub mod conditional;
mod form_body;
mod guesses;
pub mod listen;
pub mod logs;
pub mod metrics;
pub mod negotiate;
pub mod pace;
mod places;
pub mod problem;
pub mod routes;
pub mod state;
#[cfg(test)]
mod tests;
mod unstalled;
pub mod wire;
