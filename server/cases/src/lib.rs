#![doc = include_str!("../README.md")]

mod adopt;
mod application;
pub mod bids;
pub mod cache;
mod check_memory;
mod client;
pub mod dicom;
mod error;
pub mod findings;
pub mod gyri;
mod intake;
pub mod jobs;
pub mod layers;
pub mod library;
mod limit;
pub mod models;
pub mod nifti;
mod patient;
pub mod pictures;
pub mod preferences;
pub mod profile;
pub mod readings;
pub mod ready;
mod registration;
mod removal;
pub mod report;
pub mod runner;
pub mod search;
mod series;
pub mod settings;
#[cfg(any(test, feature = "testing"))]
pub mod testing;

pub use adopt::Adopted;
pub use application::{Cases, Options, StartError, open_library};
pub use client::for_client;
pub use error::Error;
pub use intake::VolumeFiles;
pub use library::{Library, LibraryOptions, Preparation};
pub use limit::{ConcurrencyLimit, Queued, Turn};
pub use patient::Patient;
pub use removal::{BeforeRemoval, DailyWarning, remove_expired};
pub use series::series_of;
