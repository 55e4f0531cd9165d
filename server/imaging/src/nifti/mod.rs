//! NIfTI-1 and NIfTI-2, in a single file, packed or not, in either byte order.
//!
//! Read: integers and real numbers of 8 to 64 bits, one volume, placed by the sform (where its code is set) or else
//! the qform. Refused in words: what does not say which side of the head is left (Analyze 7.5, and NIfTI with neither
//! form), forms that contradict each other about it, complex numbers, colours, pairs of `.hdr` and `.img`, several
//! volumes, voxels that are not numbers, and files shorter or longer than their header says. A gzip stream is read to
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
mod range;
mod source;
mod stored;
mod write;

pub(crate) use header::{LONGEST_HEADER, looks_like_header};
pub(crate) use source::GZIP_MAGIC;

pub use mask::read_mask;
pub use stored::{read_grid, read_volume};
pub(crate) use write::write_samples;
pub use write::{write_depth_map, write_mask, write_volume};
