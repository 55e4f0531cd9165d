//! From a series of DICOM images to a volume.
//!
//! Supported are MR and CT images with one slice per file, and Enhanced (multi-frame) MR and CT, including
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
//! parse the few wanted attributes. Even so, parsers and decoders of untrusted files belong in a separate process with
//! limits on memory and time.
//!
//! Source: the DICOM standard, parts 3, 5 and 10, at <https://www.dicomstandard.org>.

mod attributes;
mod choose;
mod convert;
mod error;
mod header;
mod jpeg_2000;
mod jpeg_lossless;
mod jpeg_ls;
mod pixels;
mod rle;
mod scan;
mod sequences;
mod series;
mod stack;
mod syntax;

pub use attributes::{Attributes, Instance};
pub use choose::SeriesName;
pub use convert::{Converted, Files, Options, convert};
pub use error::DicomError;
pub use series::SeriesSummary;
