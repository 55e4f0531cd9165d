//! The part of an envelope whose depth is unknown because a fence is as near as the dura.

use crate::grid::voxel_at;
use crate::transform::transformed;

/// The voxels whose nearest border voxel belongs to a fence, in their bounding box.
///
/// A fence is a border through tissue. A depth that counts from it is not a depth below the dura, as with the faces of a
/// volume that cut a brain.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fenced {
    first: [usize; 3],
    size: [usize; 3],
    voxels: Vec<bool>,
}

impl Fenced {
    /// The voxels as near to a voxel of `fence` as to the border that `squared` counts from. `None` if there are none.
    pub(crate) fn new(size: [usize; 3], fence: &[u32], squared: &[u16]) -> Option<Self> {
        if fence.is_empty() {
            return None;
        }
        let greatest = squared.iter().copied().max().unwrap_or_default();
        // Distances beyond the greatest depth do not matter. It is below 255, because it is in the map.
        let bound = (f32::from(greatest).sqrt() as u8).saturating_add(1);
        let [nx, ny, nz] = size;
        let mut bounds = vec![bound; squared.len()];
        for &index in fence {
            let [x, y, z] = voxel_at(index as usize, size);
            bounds[x + nx * (z + nz * y)] = 0;
        }
        // The axes of the bounds are x, z, y, and x, y, z again after this.
        let to_fence = transformed([nx, nz, ny], &mut bounds, 0, |squared| squared);
        let is_fenced = |index: usize| to_fence[index] <= squared[index];
        let [first, last] = bounds_of(size, is_fenced)?;
        let size = [0, 1, 2].map(|axis| last[axis] + 1 - first[axis]);
        let voxel = |index: usize| {
            let [x, y, z] = voxel_at(index, size);
            is_fenced(first[0] + x + nx * (first[1] + y + ny * (first[2] + z)))
        };
        Some(Self {
            first,
            size,
            voxels: (0..size.iter().product()).map(voxel).collect(),
        })
    }

    /// Whether the depth of a voxel of the working grid is unknown.
    pub fn contains(&self, voxel: [i64; 3]) -> bool {
        let there = [0, 1, 2].map(|axis| voxel[axis] - self.first[axis] as i64);
        let is_within = (0..3).all(|axis| (0..self.size[axis] as i64).contains(&there[axis]));
        let [nx, ny, _] = self.size;
        let [x, y, z] = there.map(|along| along as usize);
        is_within && self.voxels[x + nx * (y + ny * z)]
    }

    /// Whether the depth is unknown at a position in voxels of the working grid: at least half of what lies there, trilinear between
    /// voxel centres.
    pub fn covers(&self, position_in_voxel: [f32; 3]) -> bool {
        let base = position_in_voxel.map(f32::floor);
        let is_beside = (0..3).any(|axis| {
            let along = base[axis] - self.first[axis] as f32;
            !(-1.0..self.size[axis] as f32).contains(&along)
        });
        if is_beside {
            return false;
        }
        let part = [0, 1, 2].map(|axis| position_in_voxel[axis] - base[axis]);
        let base = base.map(|along| along as i64);
        let weight = |corner: usize| {
            let after = [0, 1, 2].map(|axis| corner >> axis & 1);
            let along = |axis: usize| match after[axis] {
                0 => 1.0 - part[axis],
                _ => part[axis],
            };
            let voxel = [0, 1, 2].map(|axis| base[axis] + after[axis] as i64);
            if self.contains(voxel) {
                along(0) * along(1) * along(2)
            } else {
                0.0
            }
        };
        (0..8).map(weight).sum::<f32>() >= 0.5
    }

    /// Its memory in bytes.
    pub fn bytes(&self) -> usize {
        self.voxels.len()
    }
}

/// First and last voxel of a set.
fn bounds_of(size: [usize; 3], is_in: impl Fn(usize) -> bool) -> Option<[[usize; 3]; 2]> {
    let mut first = [usize::MAX; 3];
    let mut last = [0; 3];
    for index in (0..size.iter().product()).filter(|&index| is_in(index)) {
        let voxel = voxel_at(index, size);
        for axis in 0..3 {
            first[axis] = first[axis].min(voxel[axis]);
            last[axis] = last[axis].max(voxel[axis]);
        }
    }
    (first[0] <= last[0]).then_some([first, last])
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use crate::{DepthField, Envelope, Grid, Mask, distance_map};

    /// A box of 30 × 24 × 20 voxels. What lies at x = 5 and y below 12 is a fence.
    fn fenced_box() -> Envelope {
        let grid = Grid::aligned([40, 34, 30], [0.8; 3], DVec3::ZERO).unwrap();
        let is_inside = |index: usize| {
            let [x, y, z] = grid.voxel(index);
            (5..35).contains(&x) && (5..29).contains(&y) && (5..25).contains(&z)
        };
        let voxels = (0..grid.voxel_count()).map(is_inside).collect();
        let fence = (0..grid.voxel_count() as u32).filter(|&index| {
            let [x, y, _] = grid.voxel(index as usize);
            is_inside(index as usize) && x == 5 && y < 12
        });
        let fence = fence.collect();
        let envelope = Envelope::from_stored(Mask::new(grid.clone(), voxels).unwrap());
        envelope.unwrap().with_fence(fence)
    }

    #[test]
    fn a_depth_is_unknown_where_the_nearest_border_voxel_is_a_fence() {
        let envelope = fenced_box();
        let distance = distance_map(&envelope);
        let plain = distance_map(&envelope.clone().with_fence(Vec::new()));
        assert_eq!(distance.squared(), plain.squared());
        let grid = envelope.grid();
        let inside = envelope.mask().voxels();
        let squared_to = |from: [usize; 3], to: u32| {
            let to = grid.voxel(to as usize);
            (0..3)
                .map(|axis| from[axis].abs_diff(to[axis]).pow(2))
                .sum::<usize>()
        };
        let mut unknown = 0;
        for index in (0..inside.len()).filter(|&index| inside[index]) {
            let voxel = grid.voxel(index);
            let to_fence = envelope.fence().iter().map(|&to| squared_to(voxel, to));
            let is_fenced = to_fence.min().unwrap() <= usize::from(distance.squared()[index]);
            assert_eq!(distance.is_known(index), !is_fenced, "{voxel:?}");
            assert!(plain.is_known(index));
            unknown += usize::from(is_fenced);
        }
        assert!(unknown > 300, "{unknown}");
    }

    #[test]
    fn a_position_is_covered_as_the_voxels_around_it_are() {
        let distance = distance_map(&fenced_box());
        let field = DepthField::new(&distance);
        let fenced = field.fenced().unwrap();
        for index in 0..distance.inside().len() {
            let [x, y, z] = distance.grid().voxel(index).map(|along| along as f32);
            let is_known = !fenced.covers([x, y, z]);
            assert_eq!(is_known, distance.is_known(index), "{x} {y} {z}");
        }
        // At the fence, and half a voxel in front of it and beside it.
        assert!(fenced.covers([5.4, 8.0, 14.0]) && fenced.covers([4.2, 8.0, 14.0]));
        assert!(!fenced.covers([5.0, 12.6, 14.0]));
        for far in [-1e9, 1e9, f32::NAN] {
            assert!(!fenced.covers([far, 8.0, 14.0]));
        }
        assert_eq!(field.smoothed(1.5).fenced(), Some(fenced));
    }
}
