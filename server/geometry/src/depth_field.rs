//! Depth as a continuous function of position.

use glam::Vec3;

use crate::{DistanceMap, Grid};

/// Signed depth on the working grid, to be sampled between voxel centres: positive inside, negative outside.
///
/// Stored in 1/128 of a voxel, so that a case takes two bytes a voxel; rounding is at most 1/256 voxel.
/// Since the working grid lies along the patient axes, directions in voxel and patient space are the same.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthField {
    grid: Grid,
    values: Vec<i16>,
}

impl DepthField {
    /// Steps of the stored values in a voxel.
    pub const STEPS_PER_VOXEL: f32 = 128.0;

    /// The field of a distance map.
    pub fn new(distance: &DistanceMap) -> Self {
        let _ = distance;
        todo!()
    }

    /// The field smoothed by a Gaussian of `sigma_voxels`, for normals in which the voxel staircase does not show.
    pub fn smoothed(&self, sigma_voxels: f32) -> Self {
        let _ = sigma_voxels;
        todo!()
    }

    /// The working grid.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Signed depths in 1/128 of a voxel, x-fastest.
    pub fn values(&self) -> &[i16] {
        &self.values
    }

    /// Signed depth in mm at a position in voxel coordinates, trilinear; beyond the grid, that of its nearest face.
    pub fn depth_mm(&self, position_in_voxel: Vec3) -> f32 {
        let _ = position_in_voxel;
        todo!()
    }

    /// Gradient of the depth at a position in voxel coordinates: trilinear between central differences at voxel centres.
    ///
    /// Without unit (mm per mm), along L, P and S, pointing inwards; its length is near 1 but on ridges.
    pub fn gradient(&self, position_in_voxel: Vec3) -> Vec3 {
        let _ = position_in_voxel;
        todo!()
    }
}
