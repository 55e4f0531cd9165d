//! Which voxels belong to the brain.

use crate::{GeometryError, Grid};

/// A set of voxels of a grid, as it was supplied: on any grid, in any orientation.
#[derive(Debug, Clone, PartialEq)]
pub struct Mask {
    grid: Grid,
    voxels: Vec<bool>,
}

impl Mask {
    /// A mask of the voxels that are `true`, x-fastest.
    ///
    /// # Errors
    /// When the number of values is not that of the grid's voxels.
    pub fn new(grid: Grid, voxels: Vec<bool>) -> Result<Self, GeometryError> {
        if voxels.len() != grid.voxel_count() {
            return Err(GeometryError::ValueCount {
                values: voxels.len(),
                voxels: grid.voxel_count(),
            });
        }
        Ok(Self { grid, voxels })
    }

    /// Where the voxels are.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Whether each voxel belongs to the set, x-fastest.
    pub fn voxels(&self) -> &[bool] {
        &self.voxels
    }
}

/// The voxels of the brain on the working grid: one component without holes.
///
/// The working grid is isotropic, lies along the patient axes and surrounds the brain with a margin.
#[derive(Debug, Clone, PartialEq)]
pub struct BrainMask(pub(crate) Mask);

impl BrainMask {
    /// Brings a mask from its own grid to the working grid of a volume, through the affines.
    ///
    /// The working grid has the volume's smallest spacing, or what brings its longest side down to
    /// [`MAX_WORKING_SIZE`](crate::MAX_WORKING_SIZE). Where the volume's grid is isotropic and lies along the patient axes, its voxel
    /// centres are the volume's own. The largest component is kept and its holes are filled.
    ///
    /// # Errors
    /// When the mask is empty, or when less than half of it lies inside of the volume.
    pub fn from_mask(mask: &Mask, volume_grid: &Grid) -> Result<Self, GeometryError> {
        let _ = (mask, volume_grid);
        todo!()
    }

    /// The mask on the working grid.
    pub fn mask(&self) -> &Mask {
        &self.0
    }
}
