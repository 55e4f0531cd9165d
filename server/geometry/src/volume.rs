//! MR intensities on their native grid.

use glam::Vec3;

use crate::{Envelope, GeometryError, Grid};

/// The linear map from stored 16-bit values to intensities: `slope * stored + intercept`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rescale {
    /// Intensity per stored unit.
    pub slope: f32,
    /// Intensity of the stored value 0.
    pub intercept: f32,
}

/// MR intensities on the grid on which they were acquired, 16 bits each.
///
/// Intensities are never resampled: interpolation blurs, and blur is the sign that is looked for. Every
/// picture samples these voxels once, through the affine.
#[derive(Debug, Clone, PartialEq)]
pub struct Volume {
    grid: Grid,
    voxels: Vec<u16>,
    rescale: Rescale,
}

impl Volume {
    /// A volume of stored values, x-fastest, and their rescaling to intensities.
    ///
    /// # Errors
    /// When the number of values is not that of the grid's voxels.
    pub fn new(grid: Grid, voxels: Vec<u16>, rescale: Rescale) -> Result<Self, GeometryError> {
        if voxels.len() != grid.voxel_count() {
            return Err(GeometryError::ValueCount {
                values: voxels.len(),
                voxels: grid.voxel_count(),
            });
        }
        Ok(Self {
            grid,
            voxels,
            rescale,
        })
    }

    /// Where the voxels are.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Stored values, x-fastest.
    pub fn voxels(&self) -> &[u16] {
        &self.voxels
    }

    /// How stored values become intensities.
    pub fn rescale(&self) -> Rescale {
        self.rescale
    }

    /// The intensity of a stored value.
    pub fn intensity(&self, stored: f32) -> f32 {
        self.rescale.slope * stored + self.rescale.intercept
    }

    /// Least and greatest intensity.
    pub fn intensity_range(&self) -> [f32; 2] {
        todo!()
    }

    /// The stored value at a position in voxel coordinates, trilinear between voxel centres.
    ///
    /// Outside of every voxel there is nothing: `None`. In the outer half of a border voxel it is that
    /// voxel's own value.
    pub fn sample(&self, position_in_voxel: Vec3) -> Option<f32> {
        let _ = position_in_voxel;
        todo!()
    }

    /// The intensities below which the given fractions of the volume's voxels inside `envelope` lie.
    ///
    /// `fractions` are in 0..=1. A voxel is inside when its centre is. `None` when no voxel is inside.
    pub fn percentiles_inside<const N: usize>(
        &self,
        envelope: &Envelope,
        fractions: [f64; N],
    ) -> Option<[f32; N]> {
        let _ = (envelope, fractions);
        todo!()
    }

    /// The smallest block of voxels that surrounds `region` with `margin_voxels` to spare, as a volume of its own.
    ///
    /// What of the block lies outside of this volume is left out. `None` when nothing of it is inside.
    pub fn crop_to(&self, region: &Grid, margin_voxels: usize) -> Option<Self> {
        let _ = (region, margin_voxels);
        todo!()
    }
}
