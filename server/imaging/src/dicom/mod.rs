//! A series of DICOM images to a volume.
//!
//! Read: MR and CT slices, one a file, and Enhanced (multi-frame) MR and CT, legacy-converted ones included; found by
//! content, with and without the preamble of Part 10. Files are grouped by series; [`convert`] takes the three-dimensional
//! T1-like series, or the one that is named, and lists the others. Slices are sorted by their position along the normal,
//! never by name or number, and placed by Image Position and Image Orientation (PS3.3 C.7.6.2.1.1).
//!
//! Refused, with the slices named: missing, doubled and unevenly spaced slices, a tilted gantry, several acquisitions in
//! one series, mixed sizes and orientations. Siemens mosaics, colours and what is no stack of parallel slices are refused by
//! name.
//!
//! Nothing is parsed before a walk over the file's structure has compared every length with the bytes at hand; only then
//! are the few attributes that are wanted handed to `dicom-object`. Even so, parsers and decoders of strangers' files
//! belong into a process of their own, with limits on memory and time.
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
mod stack;
mod syntax;

pub use attributes::{Attributes, Instance};
pub use choose::{SeriesName, SeriesSummary};
pub use convert::{Converted, Files, Options, convert};
pub use error::DicomError;
