//! The voxels of the envelope, sorted by depth.

use glam::DVec3;
use rayon::prelude::*;

use crate::{DistanceMap, Grid};

/// A voxel of the envelope: its coordinates on the working grid, 10 bits each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ShellVoxel(u32);

impl ShellVoxel {
    fn new([x, y, z]: [usize; 3]) -> Self {
        Self((x | y << 10 | z << 20) as u32)
    }

    /// Coordinates on the working grid.
    #[inline]
    pub fn position(self) -> [u32; 3] {
        [self.0 & 0x3ff, self.0 >> 10 & 0x3ff, self.0 >> 20]
    }
}

/// The voxels of an envelope sorted by depth, so that a shell is a slice found by binary search (the paper's section
/// 3.3).
#[derive(Debug, Clone, PartialEq)]
pub struct ShellIndex {
    grid: Grid,
    voxels: Vec<ShellVoxel>,
    /// The distinct squared depths, ascending, each with the number of shallower voxels.
    depths: Vec<(u16, u32)>,
}

impl ShellIndex {
    /// Sorts the voxels of an envelope by depth; voxels of equal depth stay in the order of the grid.
    pub fn new(distance: &DistanceMap) -> Self {
        let (squared, inside) = (distance.squared(), distance.inside());
        let mut next = vec![0u32; 1 << 16];
        for (&squared, &is_inside) in squared.iter().zip(inside) {
            next[usize::from(squared)] += u32::from(is_inside);
        }
        let mut depths = Vec::new();
        let mut shallower = 0;
        for (squared, next) in next.iter_mut().enumerate() {
            let count = std::mem::replace(next, shallower);
            if count > 0 {
                depths.push((squared as u16, shallower));
                shallower += count;
            }
        }
        let [nx, ny, _] = distance.grid().size();
        let mut voxels = vec![ShellVoxel(0); shallower as usize];
        for (row, (squared, inside)) in squared
            .chunks_exact(nx)
            .zip(inside.chunks_exact(nx))
            .enumerate()
        {
            for x in (0..nx).filter(|&x| inside[x]) {
                let place = &mut next[usize::from(squared[x])];
                voxels[*place as usize] = ShellVoxel::new([x, row % ny, row / ny]);
                *place += 1;
            }
        }
        Self {
            grid: distance.grid().clone(),
            voxels,
            depths,
        }
    }

    /// The working grid.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// All voxels of the envelope, shallowest first.
    pub fn voxels(&self) -> &[ShellVoxel] {
        &self.voxels
    }

    /// The centroid in LPS mm of the voxels for which `is_part` of their centre; `None` if there is none.
    ///
    /// Sums of coordinates on the grid are whole numbers, so the result does not depend on the order of the voxels.
    pub fn centroid(&self, is_part: impl Fn(DVec3) -> bool + Sync) -> Option<DVec3> {
        let patient_from_voxel = self.grid.patient_from_voxel();
        let part = |voxel: &ShellVoxel| {
            let position = DVec3::from(voxel.position().map(f64::from));
            let is_part = is_part(patient_from_voxel.transform_point3(position));
            is_part.then_some((position, 1.0))
        };
        let parts = self.voxels.par_iter().filter_map(part);
        let (sum, count) = parts.reduce(
            || (DVec3::ZERO, 0.0),
            |(sum, count), (other, others)| (sum + other, count + others),
        );
        (count > 0.0).then(|| patient_from_voxel.transform_point3(sum / count))
    }

    /// The voxels with a depth in `[depth_mm, depth_mm + thickness_mm)`.
    pub fn shell(&self, depth_mm: f32, thickness_mm: f32) -> &[ShellVoxel] {
        let start = self.shallower_than(depth_mm);
        let end = self.shallower_than(depth_mm + thickness_mm).max(start);
        &self.voxels[start..end]
    }

    /// The number of voxels with a depth less than `depth_mm`.
    fn shallower_than(&self, depth_mm: f32) -> usize {
        // In the same arithmetic as the distance map, so that both agree on every voxel.
        let spacing_mm = self.grid.spacing_mm()[0] as f32;
        let is_shallower =
            |&(squared, _): &(u16, u32)| f32::from(squared).sqrt() * spacing_mm < depth_mm;
        let position = self.depths.partition_point(is_shallower);
        self.depths
            .get(position)
            .map_or(self.voxels.len(), |&(_, shallower)| shallower as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{distance_map, envelope, phantom};

    #[test]
    fn a_shell_holds_the_voxels_of_its_depths_and_no_others() {
        let distance =
            distance_map(&envelope(&phantom::ellipsoid([15.0, 12.0, 9.0], 0.8), 0.0).unwrap());
        let shells = ShellIndex::new(&distance);
        let index = |voxel: &ShellVoxel| {
            distance
                .grid()
                .index(voxel.position().map(|place| place as usize))
        };
        for (depth, thickness) in [
            (0.0, 1.6),
            (0.8, 0.8),
            (3.3, 1.6),
            (5.0, 100.0),
            (50.0, 1.0),
        ] {
            let mut found: Vec<usize> = shells.shell(depth, thickness).iter().map(index).collect();
            found.sort_unstable();
            let is_in_shell = |&index: &usize| {
                distance
                    .depth_mm(index)
                    .is_some_and(|there| there >= depth && there < depth + thickness)
            };
            let expected: Vec<usize> = (0..distance.inside().len()).filter(is_in_shell).collect();
            assert!(found == expected, "{depth} {thickness}");
        }
        let depths = shells
            .voxels()
            .iter()
            .map(|voxel| distance.squared()[index(voxel)]);
        assert!(depths.is_sorted());
    }
}
