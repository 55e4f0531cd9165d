//! Cases over HTTP: an axum router on top of the application, and the page.

pub mod app;
pub mod routes;
pub mod state;
#[cfg(test)]
mod tests;
pub mod wire;
