//! Results as DICOM objects: Secondary Capture, Segmentation, Comprehensive 3D SR, Encapsulated PDF, and rejection notes
//! (Key Object Selection).
//!
//! Patient and study are those of the source. Texts are written in UTF-8, the transfer syntax is Explicit VR Little
//! Endian without compression, and the same values give the same bytes.
//!
//! Source: the DICOM standard, part 3, A.8.1, A.35.4, A.35.13, A.45.1 and A.51, at <https://www.dicomstandard.org>.

mod common;
mod content;
mod encapsulated;
mod item;
mod key_object;
mod measurement_report;
mod picture;
mod segmentation;
mod syntax;
mod uid;

pub(in crate::dicom) use common::written;
pub use common::{Head, IMPLEMENTATION_CLASS_UID, IMPLEMENTATION_VERSION_NAME, WriteError};
pub use encapsulated::encapsulated_pdf;
pub(in crate::dicom) use item::Code;
pub use key_object::{KeyObjectTitle, Listed, key_object};
pub use measurement_report::{Conclusion, measurement_report};
pub use picture::{Laterality, Picture, picture};
pub use segmentation::{About, Algorithm, Property, Segment, segmentation};
pub use syntax::{FileHead, file_head, implicit_file};
pub use uid::uid_of;

/// The class of a picture.
pub const PICTURE: &str = dicom_dictionary_std::uids::SECONDARY_CAPTURE_IMAGE_STORAGE;

/// The class of a segmentation.
pub const SEGMENTATION: &str = dicom_dictionary_std::uids::SEGMENTATION_STORAGE;

/// The class of a measurement report.
pub const MEASUREMENT_REPORT: &str = dicom_dictionary_std::uids::COMPREHENSIVE3_DSR_STORAGE;

/// The class of a report as PDF.
pub const REPORT: &str = dicom_dictionary_std::uids::ENCAPSULATED_PDF_STORAGE;

/// The class of a rejection note.
pub const KEY_OBJECT: &str = dicom_dictionary_std::uids::KEY_OBJECT_SELECTION_DOCUMENT_STORAGE;
