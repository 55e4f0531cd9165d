//! From NIfTI and DICOM bytes to a [`Volume`](geometry::Volume) or a [`Mask`](geometry::Mask), and back.
//!
//! This is the only crate that knows file formats, and the only one that knows that NIfTI uses RAS coordinates: its
//! results are in the patient space of DICOM, LPS in millimetres. Bytes come in and values go out; other crates open
//! files.
//!
//! Every input is treated as hostile. A length in a file is compared with the available bytes and with the [`Limits`]
//! before memory is allocated. No input makes this crate panic, except in third-party decoders of compressed pixels
//! (see [`dicom`]). No message contains patient data from a header.

#![warn(missing_docs)]

pub mod dicom;
mod error;
mod limits;
pub mod nifti;
mod sniff;

pub use error::ImagingError;
pub use limits::Limits;
pub use sniff::{Format, START_BYTES, sniff};
