//! NIfTI bytes and DICOM files to a [`Volume`](geometry::Volume) or a [`Mask`](geometry::Mask), and back.
//!
//! The one crate that knows file formats, and the one that knows that NIfTI's space is RAS: what leaves it is in
//! DICOM's patient space, LPS, in millimetres. Bytes come in and values go out; files are opened elsewhere.
//!
//! Every input is taken for hostile. A length that a file states is compared with the bytes at hand and with the
//! [`Limits`] before memory is asked for; nothing here panics on any bytes, but for decoders of packed pixels that are
//! others' (see [`dicom`]); and no message holds what a header says of the patient.

pub mod dicom;
mod error;
mod limits;
pub mod nifti;
mod sniff;

pub use error::ImagingError;
pub use limits::Limits;
pub use sniff::{Format, sniff};
