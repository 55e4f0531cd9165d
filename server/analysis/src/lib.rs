//! What is computed from one head to help the eye: values in, values out, with no files and no tasks.

mod midsagittal;

pub use midsagittal::{MidsagittalPlane, midsagittal_plane};
