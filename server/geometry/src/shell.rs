//! The envelope's voxels in the order of their depth.

use crate::{DistanceMap, Grid};

/// A voxel of the envelope: its coordinates on the working grid, 10 bits each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ShellVoxel(u32);

impl ShellVoxel {
    /// Coordinates on the working grid.
    pub fn position(self) -> [u32; 3] {
        [self.0 & 0x3ff, self.0 >> 10 & 0x3ff, self.0 >> 20]
    }
}

/// The voxels of an envelope sorted by depth, so that a shell is a slice found by binary search (the paper's section 3.3).
#[derive(Debug, Clone, PartialEq)]
pub struct ShellIndex {
    grid: Grid,
    voxels: Vec<ShellVoxel>,
}

impl ShellIndex {
    /// Sorts the envelope's voxels by depth; voxels of one depth stay in the order of the grid.
    pub fn new(distance: &DistanceMap) -> Self {
        let _ = distance;
        todo!()
    }

    /// The working grid.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// The voxels whose depth is in `[depth_mm, depth_mm + thickness_mm)`.
    pub fn shell(&self, depth_mm: f32, thickness_mm: f32) -> &[ShellVoxel] {
        let _ = (depth_mm, thickness_mm, &self.voxels);
        todo!()
    }
}
