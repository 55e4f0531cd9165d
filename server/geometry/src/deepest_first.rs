//! Exact search for the nearest voxel that is deep enough.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::Vec3;

use crate::DistanceMap;
use crate::grid::voxel_at;

/// A pyramid of the greatest squared depths over blocks of voxels, to skip blocks that are too shallow.
pub(crate) struct DepthPyramid<'a> {
    distance: &'a DistanceMap,
    levels: Vec<Level>,
}

/// Blocks of `2^level` voxels a side.
struct Level {
    size: [usize; 3],
    greatest: Vec<u16>,
}

impl Level {
    fn at(&self, [x, y, z]: [usize; 3]) -> u16 {
        self.greatest[x + self.size[0] * (y + self.size[1] * z)]
    }

    /// The level of blocks twice as large.
    fn halved(&self) -> Self {
        let size = self.size.map(|side| side.div_ceil(2));
        let mut greatest = vec![0; size.iter().product()];
        for (index, &value) in self.greatest.iter().enumerate() {
            let [x, y, z] = voxel_at(index, self.size).map(|place| place / 2);
            let block = &mut greatest[x + size[0] * (y + size[1] * z)];
            *block = (*block).max(value);
        }
        Self { size, greatest }
    }
}

impl<'a> DepthPyramid<'a> {
    pub(crate) fn new(distance: &'a DistanceMap) -> Self {
        let inside = distance.inside().iter();
        let greatest = distance.squared().iter().zip(inside);
        let greatest = greatest.map(|(&squared, &is_inside)| if is_inside { squared } else { 0 });
        let mut levels = vec![Level {
            size: distance.grid().size(),
            greatest: greatest.collect(),
        }];
        while let Some(last) = levels.last().filter(|level| level.size != [1; 3]) {
            let next = last.halved();
            levels.push(next);
        }
        Self { distance, levels }
    }

    /// The centre of the voxel nearest to a position that is at least `depth_mm` deep, in voxel coordinates.
    ///
    /// Blocks are opened in the order of their distance; the first voxel is the nearest.
    pub(crate) fn nearest_deeper(&self, position: Vec3, depth_mm: f32) -> Option<Vec3> {
        let spacing = self.distance.grid().spacing_mm()[0];
        let least = (f64::from(depth_mm) / spacing).max(0.0).powi(2);
        let mut queue = BinaryHeap::new();
        queue.push(Reverse((0u64, self.levels.len() - 1, [0usize; 3])));
        while let Some(Reverse((_, level, block))) = queue.pop() {
            if level == 0 {
                return Some(Vec3::from_array(block.map(|place| place as f32)));
            }
            let below = &self.levels[level - 1];
            for corner in 0..8 {
                let part = [0, 1, 2].map(|axis| 2 * block[axis] + (corner >> axis & 1));
                let is_there = (0..3).all(|axis| part[axis] < below.size[axis]);
                if is_there && f64::from(below.at(part)) >= least && below.at(part) > 0 {
                    queue.push(Reverse((
                        distance_to_block(position, level - 1, part),
                        level - 1,
                        part,
                    )));
                }
            }
        }
        None
    }
}

/// Squared distance from a position to the nearest centre in a block, in 1/1024 of a squared voxel.
fn distance_to_block(position: Vec3, level: usize, block: [usize; 3]) -> u64 {
    let squared: f64 = (0..3)
        .map(|axis| {
            let first = (block[axis] << level) as f64;
            let last = first + ((1u64 << level) - 1) as f64;
            let along = f64::from(position[axis]);
            (first - along).max(along - last).max(0.0).powi(2)
        })
        .sum();
    (squared * 1024.0) as u64
}
