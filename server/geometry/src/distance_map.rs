//! How deep each voxel lies below the envelope.

use rayon::prelude::*;

use crate::transform::{MAX_DISTANCE, squared_distances};
use crate::{Envelope, Grid};

/// How far outside of the envelope distances are followed, in voxels; further out they are this.
const OUTSIDE_REACH: u8 = 6;

/// Exact Euclidean distances of voxel centres to the nearest centre of a border voxel, squared, in voxels.
///
/// A border voxel is one of the envelope with a 6-neighbour outside; its depth is 0. This is the paper's
/// first Euclidean image foresting transform, whose propagation over 26 neighbours is not always exact;
/// the separable transform used here is.
#[derive(Debug, Clone, PartialEq)]
pub struct DistanceMap {
    envelope: Envelope,
    squared: Vec<u16>,
    deepest: u32,
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

    /// Squared distances to the nearest border voxel, in voxels, x-fastest.
    ///
    /// Exact inside of the envelope, and outside of it up to 6 voxels away; beyond, 36.
    pub fn squared(&self) -> &[u16] {
        &self.squared
    }

    /// Whether each voxel is inside of the envelope, x-fastest.
    pub fn inside(&self) -> &[bool] {
        self.envelope.mask().voxels()
    }

    /// Depth of a voxel in mm; `None` outside of the envelope.
    pub fn depth_mm(&self, index: usize) -> Option<f32> {
        self.inside()[index].then(|| self.depth_mm_of(self.squared[index]))
    }

    /// Index of the deepest voxel; of several, the first.
    pub fn deepest(&self) -> usize {
        self.deepest as usize
    }

    /// Depth of the deepest voxel, in mm.
    pub fn max_depth_mm(&self) -> f32 {
        self.depth_mm_of(self.squared[self.deepest()])
    }

    /// The depth that a squared distance stands for: the one place where voxels become millimetres.
    pub fn depth_mm_of(&self, squared: u16) -> f32 {
        f32::from(squared).sqrt() * self.envelope.spacing_mm() as f32
    }
}

/// The exact distance map of an envelope.
pub fn distance_map(envelope: &Envelope) -> DistanceMap {
    let size = envelope.grid().size();
    let inside = envelope.mask().voxels();
    // Between a voxel inside and one outside lies a border voxel, so that the two bounds do not mix.
    let mut bounds: Vec<u8> = inside
        .par_iter()
        .map(|&is_inside| {
            if is_inside {
                MAX_DISTANCE
            } else {
                OUTSIDE_REACH
            }
        })
        .collect();
    mark_border(size, inside, &mut bounds);
    let squared = squared_distances(size, &bounds);
    let deepest = deepest_inside(inside, &squared);
    DistanceMap {
        envelope: envelope.clone(),
        squared,
        deepest,
    }
}

/// Sets the bound of each border voxel to 0. The mask does not reach the faces of the grid.
fn mark_border([nx, ny, _]: [usize; 3], inside: &[bool], bounds: &mut [u8]) {
    let plane = nx * ny;
    let interior = plane..inside.len() - plane;
    bounds[interior.clone()]
        .par_chunks_mut(nx)
        .enumerate()
        .for_each(|(row, bounds)| {
            let start = plane + row * nx;
            let neighbours = [start - nx, start + nx, start - plane, start + plane];
            let [above, below, before, behind] = neighbours.map(|start| &inside[start..start + nx]);
            let here = &inside[start - 1..start + nx + 1];
            for x in 0..nx {
                let surrounded =
                    here[x] & here[x + 2] & above[x] & below[x] & before[x] & behind[x];
                if here[x + 1] & !surrounded {
                    bounds[x] = 0;
                }
            }
        });
}

fn deepest_inside(inside: &[bool], squared: &[u16]) -> u32 {
    let depth = |index: usize| {
        if inside[index] {
            i32::from(squared[index])
        } else {
            -1
        }
    };
    let deepest = (0..squared.len())
        .into_par_iter()
        .reduce_with(|a, b| if (depth(b), a) > (depth(a), b) { b } else { a })
        .unwrap_or_default();
    deepest as u32
}
