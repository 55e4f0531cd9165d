//! The seeds of the second transform.

use crate::DistanceMap;

/// The deepest places of the envelope, where its shrinking ends.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Core {
    voxels: Vec<u32>,
}

impl Core {
    /// Indices of the core voxels on the working grid, ascending; at least one.
    pub fn voxels(&self) -> &[u32] {
        &self.voxels
    }
}

/// The regional maxima of a distance map (26-neighbourhood) that are at least half as deep as its deepest voxel.
pub fn core(distance: &DistanceMap) -> Core {
    let _ = distance;
    todo!()
}
