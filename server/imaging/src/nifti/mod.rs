//! NIfTI-1 and NIfTI-2 in a single file, gzipped or not, in either byte order; and [MGH](mgh), wherever NIfTI is read.
//!
//! Supported are integers and floating-point numbers of 8 to 64 bits and one volume, placed by the sform (if its code
//! is set) or the qform. Rejected are files that do not state which side of the head is left (Analyze 7.5, and NIfTI
//! without either form), forms that contradict each other about it, about sizes or about angles, complex numbers, colours, pairs of
//! `.hdr` and `.img`, several volumes, and files shorter than their header describes, or longer by a slice. A gzip stream is read to
//! its end, so that its checksums are verified.
//!
//! Source: the headers `nifti1.h` (2007) and `nifti2.h` (2011) of the NIfTI Data Format Working Group, at
//! <https://nifti.nimh.nih.gov>.

mod affine;
mod datatype;
mod element;
mod file;
mod header;
mod mask;
mod mgh;
mod outliers;
mod range;
mod source;
mod start;
mod stored;
mod values;
mod write;

pub(crate) use source::GZIP_MAGIC;
pub(crate) use start::{LONGEST_HEADER, looks_like_header};

pub use affine::{Form, lps_from_ras};
pub use mask::read_mask;
pub use outliers::{SAMPLE, kept_range};
pub use stored::{Replaced, read_counted, read_grid, read_volume};
pub use values::{Values, are_axes_assumed, is_in_scanner_space, read_values};
pub(crate) use write::{comment_of, write_commented, write_samples};
pub use write::{keeping_form, write_labels, write_mask, write_numbers, write_volume};
