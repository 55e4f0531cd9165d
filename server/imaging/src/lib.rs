#![doc = include_str!("../README.md")]
#![warn(missing_docs)]

pub mod dicom;
mod error;
mod limits;
pub mod nifti;
mod sniff;
pub mod surface;

pub use error::ImagingError;
pub use limits::Limits;
pub use sniff::{Format, START_BYTES, sniff};
