//! The service: cases in a store, prepared by workers, shown over HTTP.

pub mod case;
pub mod jobs;
pub mod models;
pub mod prepare;
pub mod store;
#[cfg(test)]
mod testing;
