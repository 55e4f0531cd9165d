//! The application: cases are submitted, prepared by workers, kept in memory and drawn.
//!
//! It knows neither HTTP nor the network protocols of DICOM: it returns an [`Error`], which each protocol translates.

mod application;
mod cache;
pub mod dicom;
mod error;
mod handover;
mod intake;
pub mod jobs;
pub mod library;
mod limit;
pub mod models;
pub mod pictures;
pub mod profile;
mod room;
#[cfg(test)]
mod testing;

pub use application::{Cases, Options, StartError, open_library};
pub use error::Error;
pub use library::{Library, Preparation};
pub use limit::{ConcurrencyLimit, Queued, Turn};
