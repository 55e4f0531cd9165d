//! The optimal-path forest of the second Euclidean transform.

use crate::{Core, DistanceMap, Grid};

/// For each voxel of the envelope its predecessor on an optimal path from the core.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Forest {
    size: [usize; 3],
    predecessor: Vec<u8>,
}

impl Forest {
    /// Code of a voxel outside of the envelope.
    pub const OUTSIDE: u8 = 255;
    /// Code of a root. Codes 0 to 26 but 13 are neighbours, `(dx+1) + 3 (dy+1) + 9 (dz+1)`.
    pub const ROOT: u8 = 13;

    /// A forest from codes stored before; `None` unless every path ends at a root.
    pub fn from_stored(grid: &Grid, predecessor: Vec<u8>) -> Option<Self> {
        let _ = (grid, predecessor);
        todo!()
    }

    /// Predecessor codes, x-fastest.
    pub fn predecessor(&self) -> &[u8] {
        &self.predecessor
    }
}

/// The second Euclidean transform: every voxel of the envelope joined to its nearest core voxel.
pub fn forest(distance: &DistanceMap, core: &Core) -> Forest {
    let _ = (distance, core);
    todo!()
}
