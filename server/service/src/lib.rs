//! The service: cases in a store, prepared by workers, shown over HTTP.

pub mod app;
pub mod auth;
pub mod caching;
pub mod case;
pub mod cli;
pub mod config;
pub mod dicom;
pub mod drawing;
pub mod finish;
mod form_body;
pub mod graphics;
mod guesses;
pub mod jobs;
pub mod listen;
pub mod logs;
pub mod metrics;
pub mod models;
pub mod negotiate;
pub mod pace;
mod places;
pub mod prepare;
pub mod problem;
pub mod quality;
pub mod render_pool;
pub mod routes;
pub mod state;
pub mod store;
#[cfg(test)]
mod testing;
pub mod turnstile;
mod unstalled;
pub mod wire;
