//! Shapes whose answers are known on paper, and a head with folded gyri, for tests, benches and the demonstration.

use crate::{Mask, Volume};

/// A made-up head and its brain mask.
#[derive(Debug, Clone)]
pub struct PhantomHead {
    /// T1-like intensities with skull and scalp.
    pub volume: Volume,
    /// The voxels of its brain.
    pub brain: Mask,
}

/// A head with two hemispheres, folded gyri, a cortical ribbon and a blurred lesion in the right frontal lobe.
///
/// `spacing_mm` is the edge of a voxel, 0.7 to 3 mm.
pub fn head(spacing_mm: f64) -> PhantomHead {
    let _ = spacing_mm;
    todo!()
}
