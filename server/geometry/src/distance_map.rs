//! How deep each voxel lies below the envelope.

use crate::{Envelope, Grid};

/// Exact Euclidean distances of the envelope's voxels to the envelope's border, squared, in voxels.
///
/// A border voxel is one of the envelope with a 6-neighbour outside; its depth is 0.
#[derive(Debug, Clone, PartialEq)]
pub struct DistanceMap {
    envelope: Envelope,
    squared: Vec<u16>,
    max_squared: u16,
}

impl DistanceMap {
    /// The working grid.
    pub fn grid(&self) -> &Grid {
        self.envelope.grid()
    }

    /// The envelope below which depth is counted.
    pub fn envelope(&self) -> &Envelope {
        &self.envelope
    }

    /// Squared distances to the nearest border voxel, in voxels, x-fastest; outside of the envelope too.
    pub fn squared(&self) -> &[u16] {
        &self.squared
    }

    /// Depth of a voxel in mm; `None` outside of the envelope.
    pub fn depth_mm(&self, index: usize) -> Option<f32> {
        let _ = index;
        todo!()
    }

    /// Depth of the deepest voxel, in mm.
    pub fn max_depth_mm(&self) -> f32 {
        let _ = self.max_squared;
        todo!()
    }
}

/// The exact distance map of an envelope.
pub fn distance_map(envelope: &Envelope) -> DistanceMap {
    let _ = envelope;
    todo!()
}
