//! From a series of DICOM images to a volume.
//!
//! Supported are MR, CT and PET images with one slice per file, and Enhanced (multi-frame) ones, including
//! legacy-converted ones. Files are recognised by content, with or without the preamble of Part 10, and grouped by
//! series. [`convert`] chooses the three-dimensional T1-like series, or the named one, and lists the others. Slices are
//! sorted by their position along the normal, never by name or number, and placed by Image Position and Image
//! Orientation (PS3.3 C.7.6.2.1.1).
//!
//! Missing, doubled and unevenly spaced slices, a tilted gantry, several acquisitions in one series, and mixed sizes or
//! orientations are rejected, and the error lists the slices. Siemens mosaics, colour images and anything but a stack
//! of parallel slices are rejected by name.
//!
//! A walk over the structure of each file compares every length with the available bytes. Only then does `dicom-object`
//! parse the few wanted attributes. Even so, untrusted files belong in a separate process with limits.
//!
//! Source: the DICOM standard, parts 3, 5 and 10, at <https://www.dicomstandard.org>.

mod attributes;
mod characters;
mod choose;
mod code;
mod convert;
mod deidentify;
mod error;
mod fingerprint;
mod frames;
mod header;
mod identity;
mod jpeg_2000;
mod jpeg_lossless;
mod jpeg_ls;
mod label;
mod loss;
mod marks;
mod numbers;
mod pet;
mod pixels;
mod rejection;
mod rle;
mod scan;
mod sequences;
mod series;
mod stack;
mod syntax;
pub mod write;

pub use attributes::{Attributes, Instance, attributes};
pub use choose::{Purpose, SeriesName, sequence_name};
pub use convert::{Converted, Files, MOST_LISTED, Options, convert};
pub use deidentify::{deidentified_file, kind_of_series, replaced_uid};
pub use error::DicomError;
pub use fingerprint::{Fingerprint, fingerprint};
pub use header::IMAGE_CLASSES;
pub use identity::{Identity, identify, series_of};
pub use marks::{Mark, MarkedPatient, Side, StandardText, marks};
pub use rejection::{RejectedSeries, Rejection};
pub use series::{SeriesSummary, UnreadFile};
pub use syntax::TRANSFER_SYNTAXES;
