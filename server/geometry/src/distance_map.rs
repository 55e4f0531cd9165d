//! The depth of each voxel below the envelope.

use std::sync::Arc;

use glam::DVec3;
use rayon::prelude::*;

use crate::transform::{MAX_DISTANCE, transformed};
use crate::{Envelope, Fenced, Grid};

/// The limit of distances outside the envelope, in voxels; further out they stay at this value.
const OUTSIDE_REACH: u8 = 6;

/// Exact Euclidean distances of voxel centres to the nearest centre of a border voxel, squared, in voxels.
///
/// A border voxel is a voxel of the envelope with a 6-neighbour outside; its depth is 0. This corresponds to the first
/// Euclidean image foresting transform of the paper. Its propagation over 26 neighbours is not always exact; the
/// separable transform used here is.
///
/// If the volume cuts the brain, the distance to that cut is not a depth: see [`DistanceMap::is_known`].
#[derive(Debug, Clone, PartialEq)]
pub struct DistanceMap {
    envelope: Envelope,
    squared: Vec<u16>,
    deepest: u32,
    fenced: Option<Arc<Fenced>>,
}

impl DistanceMap {
    /// The working grid.
    pub fn grid(&self) -> &Grid {
        self.envelope.grid()
    }

    /// The envelope.
    pub fn envelope(&self) -> &Envelope {
        &self.envelope
    }

    /// Squared distances to the nearest border voxel, in voxels, x-fastest.
    ///
    /// Exact inside the envelope, and outside up to a distance of 6 voxels; beyond, 36.
    pub fn squared(&self) -> &[u16] {
        &self.squared
    }

    /// Whether each voxel is inside the envelope, x-fastest.
    pub fn inside(&self) -> &[bool] {
        self.envelope.mask().voxels()
    }

    /// Whether the depth of a voxel is known: `false` if a face of the volume that cuts the brain, or a fence, is nearer than any
    /// dura, so that the distance is not a depth.
    pub fn is_known(&self, index: usize) -> bool {
        if self.envelope.cuts().is_empty() && self.fenced.is_none() {
            return true;
        }
        let grid = self.grid();
        let voxel = grid.voxel(index);
        if let Some(fenced) = &self.fenced
            && fenced.contains(voxel.map(|place| place as i64))
        {
            return false;
        }
        let voxel = DVec3::from_array(voxel.map(|place| place as f64));
        let position = grid.patient_from_voxel().transform_point3(voxel);
        self.envelope
            .cuts_leave(position, self.depth_mm_of(self.squared[index]))
    }

    /// The voxels whose depth a fence makes unknown, inside the envelope and beside it; `None` if there are none.
    pub(crate) fn fenced(&self) -> Option<&Arc<Fenced>> {
        self.fenced.as_ref()
    }

    /// Depth of a voxel in mm, whether known or not; `None` outside the envelope.
    pub fn depth_mm(&self, index: usize) -> Option<f32> {
        self.inside()[index].then(|| self.depth_mm_of(self.squared[index]))
    }

    /// Index of the deepest voxel; among equals, the first.
    pub fn deepest(&self) -> usize {
        self.deepest as usize
    }

    /// Depth of the deepest voxel, in mm.
    pub fn max_depth_mm(&self) -> f32 {
        self.depth_mm_of(self.squared[self.deepest()])
    }

    /// Converts a squared distance to a depth: the only place where voxels become millimetres.
    pub fn depth_mm_of(&self, squared: u16) -> f32 {
        f32::from(squared).sqrt() * self.envelope.spacing_mm() as f32
    }
}

/// The exact distance map of an envelope.
pub fn distance_map(envelope: &Envelope) -> DistanceMap {
    let size = envelope.grid().size();
    let inside = envelope.mask().voxels();
    let mut bounds = bounds(size, inside);
    // The axes of the bounds are x, z, y, and x, y, z again after this.
    let [nx, ny, nz] = size;
    let squared = transformed([nx, nz, ny], &mut bounds, 0, |squared| squared);
    let deepest = deepest_inside(inside, &squared);
    let fenced = Fenced::new(size, envelope.fence(), &squared);
    DistanceMap {
        fenced: fenced.map(Arc::new),
        envelope: envelope.clone(),
        squared,
        deepest,
    }
}

/// Bounds of the distances: 0 at a border voxel, and the limits elsewhere. Their axes are x, z, y.
///
/// There is a border voxel between each voxel inside and each one outside, so the two bounds do not mix. The mask does
/// not touch the faces of the grid.
fn bounds([nx, ny, nz]: [usize; 3], inside: &[bool]) -> Vec<u8> {
    let mut bounds = vec![OUTSIDE_REACH; inside.len()];
    bounds
        .par_chunks_mut(nx * nz)
        .enumerate()
        .filter(|&(y, _)| (1..ny - 1).contains(&y))
        .for_each(|(y, slab)| {
            for (z, row) in slab.chunks_exact_mut(nx).enumerate().take(nz - 1).skip(1) {
                bound_row(&inside[nx * (y + ny * z) - nx * ny..], [nx, nx * ny], row);
            }
        });
    bounds
}

/// The bounds of a row, which begins one plane after the start of `inside`.
fn bound_row(inside: &[bool], [nx, plane]: [usize; 2], bounds: &mut [u8]) {
    let shifted = |offset: isize| inside[plane.wrapping_add_signed(offset)..].iter();
    let (nx, plane) = (nx as isize, plane as isize);
    let along_x = shifted(-1).zip(shifted(1)).map(|(a, b)| a & b);
    let along_y = shifted(-nx).zip(shifted(nx)).map(|(a, b)| a & b);
    let along_z = shifted(-plane).zip(shifted(plane)).map(|(a, b)| a & b);
    let surrounded = along_x
        .zip(along_y)
        .zip(along_z)
        .map(|((x, y), z)| x & y & z);
    for ((bound, &here), surrounded) in bounds.iter_mut().zip(shifted(0)).zip(surrounded) {
        *bound = match (here, surrounded) {
            (false, _) => OUTSIDE_REACH,
            (true, false) => 0,
            (true, true) => MAX_DISTANCE,
        };
    }
}

/// The first of the deepest voxels; 0 if nothing is inside.
fn deepest_inside(inside: &[bool], squared: &[u16]) -> u32 {
    let depth = |(&inside, &squared): (&bool, &u16)| if inside { squared } else { 0 };
    let deepest = inside
        .iter()
        .zip(squared)
        .map(depth)
        .max()
        .unwrap_or_default();
    let mut voxels = inside.iter().zip(squared);
    voxels
        .position(|(&inside, &squared)| inside && squared == deepest)
        .unwrap_or_default() as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{envelope, phantom};

    /// The definition: border voxels by their six neighbours, and the least distance to one of them.
    fn brute_force(envelope: &Envelope) -> Vec<Option<f64>> {
        let grid = envelope.grid();
        let inside = envelope.mask().voxels();
        let neighbours = |[x, y, z]: [usize; 3]| {
            [
                [x - 1, y, z],
                [x + 1, y, z],
                [x, y - 1, z],
                [x, y + 1, z],
                [x, y, z - 1],
                [x, y, z + 1],
            ]
        };
        let all = || {
            (0..inside.len())
                .filter(|&index| inside[index])
                .map(|index| grid.voxel(index))
        };
        let is_border = |voxel: &[usize; 3]| {
            neighbours(*voxel)
                .into_iter()
                .any(|neighbour| !inside[grid.index(neighbour)])
        };
        let border: Vec<_> = all().filter(is_border).collect();
        let distance = |index: usize| {
            let voxel = grid.voxel(index);
            let squared = |other: &[usize; 3]| -> usize {
                (0..3)
                    .map(|axis| voxel[axis].abs_diff(other[axis]).pow(2))
                    .sum()
            };
            let nearest = border.iter().map(squared).min().unwrap_or_default();
            inside[index].then(|| (nearest as f64).sqrt() * grid.spacing_mm()[0])
        };
        (0..inside.len()).map(distance).collect()
    }

    #[test]
    fn depths_are_those_of_brute_force() {
        for brain in [
            phantom::ball(9.0),
            phantom::ellipsoid([11.0, 7.0, 5.5], 0.7),
            phantom::two_lobes([7.0, 5.0], 11.0, 2.0),
        ] {
            let envelope = envelope(&brain, 1.5).unwrap();
            let distance = distance_map(&envelope);
            for (index, expected) in brute_force(&envelope).into_iter().enumerate() {
                match (distance.depth_mm(index), expected) {
                    (Some(depth), Some(expected)) => {
                        assert!((f64::from(depth) - expected).abs() < 1e-4);
                    }
                    (depth, expected) => assert!(depth.is_none() && expected.is_none()),
                }
            }
        }
    }

    #[test]
    fn in_a_large_box_depth_is_the_way_to_the_nearest_face() {
        let size = [131, 97, 110];
        let grid = Grid::aligned(size, [0.9; 3], glam::DVec3::ZERO).unwrap();
        let mask = crate::Mask::new(grid.clone(), vec![true; grid.voxel_count()]).unwrap();
        let brain = crate::BrainMask::from_mask(&mask, &grid).unwrap();
        let distance = distance_map(&envelope(&brain, 0.0).unwrap());
        let working = distance.grid();
        let native_from_working = grid.voxel_from_patient() * working.patient_from_voxel();
        for index in 0..distance.inside().len() {
            let Some(depth) = distance.depth_mm(index) else {
                continue;
            };
            let voxel = glam::DVec3::from_array(working.voxel(index).map(|place| place as f64));
            let native = native_from_working.transform_point3(voxel);
            let to_face = |axis: usize| native[axis].min((size[axis] - 1) as f64 - native[axis]);
            let nearest = (0..3).map(to_face).fold(f64::INFINITY, f64::min) * 0.9;
            assert!(
                (f64::from(depth) - nearest).abs() < 0.009,
                "{depth} {nearest}"
            );
        }
    }

    #[test]
    fn in_a_large_ball_depth_is_the_distance_to_the_nearest_border_voxel() {
        let radius = 60.0;
        let distance = distance_map(&envelope(&phantom::ball(radius), 0.0).unwrap());
        let grid = distance.grid();
        let inside = (0..grid.voxel_count()).filter(|&index| distance.inside()[index]);
        let border: Vec<_> = inside
            .clone()
            .filter(|&index| distance.squared()[index] == 0)
            .map(|index| grid.voxel(index).map(|place| place as i32))
            .collect();
        let middle = grid.size().map(|side| (side - 1) as f64 / 2.0);
        for index in inside.step_by(2003) {
            let voxel = grid.voxel(index).map(|place| place as i32);
            let squared =
                |other: &[i32; 3]| (0..3).map(|i| (voxel[i] - other[i]).pow(2)).sum::<i32>();
            let nearest = f64::from(border.iter().map(squared).min().unwrap()).sqrt();
            let depth = f64::from(distance.depth_mm(index).unwrap());
            assert!((depth - nearest).abs() < 0.01);
            // The centres of border voxels lie on the sphere or up to a voxel inside it, and not on every radius.
            let from_centre = (0..3)
                .map(|i| (f64::from(voxel[i]) - middle[i]).powi(2))
                .sum::<f64>();
            assert!((-0.9..=1.0).contains(&(radius - from_centre.sqrt() - depth)));
        }
        assert!((59.0..=60.0).contains(&distance.max_depth_mm()));
    }

    #[test]
    fn distances_outside_are_followed_for_a_few_voxels() {
        let distance = distance_map(&envelope(&phantom::ball(12.0), 0.0).unwrap());
        let grid = distance.grid();
        let [nx, ny, nz] = grid.size();
        let at = |x: usize| distance.squared()[grid.index([x, ny / 2, nz / 2])];
        let first = (0..nx)
            .find(|&x| distance.inside()[grid.index([x, ny / 2, nz / 2])])
            .unwrap();
        assert_eq!([at(first), at(first - 1), at(first - 2)], [0, 1, 4]);
        assert_eq!(
            distance.depth_mm(grid.index([first - 1, ny / 2, nz / 2])),
            None
        );
    }
}
