//! A smooth displacement of the mirrored side, which makes the two sides more alike.

use glam::{DAffine3, DVec3, Vec3};

use crate::block::{Block, Zone};
use crate::coarse::{Coarse, Pair};
use crate::convolve::{Kernel, smooth};
use crate::study::Ground;

/// The cell size of the displacements, in mm.
const STEP_MM: f64 = 4.0;
/// The Gaussian of the intensities that are compared, in mm.
const SMOOTHING_MM: f64 = 3.0;
/// The Gaussian that smooths displacements in each round, in mm, and the number of rounds.
const STIFFNESS_MM: f64 = 12.0;
const ROUNDS: usize = 60;
/// The greatest displacement, in mm.
const MOST_MM: f32 = 8.0;
/// The tissue scale outside the head.
const OUTSIDE: f32 = -1.0;

/// Displacements of mirrored points.
pub(super) struct Warp {
    coarse: Coarse,
    cell_from_voxel: DAffine3,
    /// Voxels of the block for each cell, along its three axes; the second numbers are unused.
    moves: [Vec<Pair>; 3],
}

impl Warp {
    /// The displacements at which the mirrored head is most like the head: the demons of Thirion ("Image matching as a
    /// diffusion process", Medical Image Analysis 2, 1998) with smooth displacements.
    pub(super) fn fitted(ground: &Ground<'_>, mirrored_from_voxel: DAffine3) -> Self {
        let block = &ground.block;
        let coarse = Coarse::new(block.size, block.spacing_mm, STEP_MM);
        let means = coarse.means(|index| [tissue(block, &ground.values, index), 1.0]);
        let image = coarse.smoothed(&means, SMOOTHING_MM);
        let size = coarse.size;
        let factor = DVec3::from_array(coarse.factor.map(|factor| factor as f64));
        let cell_from_voxel = coarse.through(DAffine3::IDENTITY);
        let mirrored_from_cell = coarse.through(mirrored_from_voxel) * cell_from_voxel.inverse();
        let stiff = coarse
            .spacing_mm
            .map(|spacing| Kernel::gaussian(STIFFNESS_MM / spacing));
        let most = coarse.spacing_mm.map(|spacing| MOST_MM / spacing as f32);
        let count = size.iter().product();
        let mut moves = [0, 1, 2].map(|_| vec![0.0f32; count]);
        let at = |place: Vec3| {
            let [sum, weight] = coarse.sample(&image, place);
            if weight > 0.05 { sum / weight } else { OUTSIDE }
        };
        let mut steps = moves.clone();
        for _ in 0..ROUNDS {
            for cell in 0..count {
                let place = [
                    cell % size[0],
                    cell / size[0] % size[1],
                    cell / size[0] / size[1],
                ];
                let place = DVec3::from_array(place.map(|along| along as f64));
                let moved = Vec3::from_array([0, 1, 2].map(|axis| moves[axis][cell]));
                let there = mirrored_from_cell.transform_point3(place).as_vec3() + moved;
                let difference = at(place.as_vec3()) - at(there);
                let slope = Vec3::from_array([Vec3::X, Vec3::Y, Vec3::Z].map(|axis| {
                    (at(there + axis * 0.5) - at(there - axis * 0.5)).clamp(-1.0, 1.0)
                }));
                let step = slope
                    * (difference / (slope.length_squared() + difference * difference + 1e-3));
                for axis in 0..3 {
                    steps[axis][cell] = step[axis];
                }
            }
            for axis in 0..3 {
                smooth(&mut steps[axis], size, &stiff);
                for (moved, step) in moves[axis].iter_mut().zip(&steps[axis]) {
                    *moved = (*moved + 2.0 * step).clamp(-most[axis], most[axis]);
                }
            }
        }
        let moves = [0, 1, 2].map(|axis| {
            let in_voxels = |&cells: &f32| [cells * factor[axis] as f32, 1.0];
            moves[axis].iter().map(in_voxels).collect()
        });
        Self {
            coarse,
            cell_from_voxel,
            moves,
        }
    }

    /// The displacement of the mirrored point of a voxel, in voxels.
    pub(super) fn at(&self, voxel: DVec3) -> DVec3 {
        let place = self.cell_from_voxel.transform_point3(voxel).as_vec3();
        DVec3::from_array(
            [0, 1, 2].map(|axis| f64::from(self.coarse.sample(&self.moves[axis], place)[0])),
        )
    }

    /// The correlation of the tissue scale, smoothed by 2 mm, with the mirrored side, without and with displacements,
    /// and the mean displacement in mm.
    pub(super) fn correlations(
        &self,
        ground: &Ground<'_>,
        mirrored_from_voxel: DAffine3,
    ) -> [f64; 3] {
        let block = &ground.block;
        let mut image: Vec<f32> = (0..block.voxel_count())
            .map(|index| tissue(block, &ground.values, index))
            .collect();
        smooth(
            &mut image,
            block.size,
            &block.in_voxels(2.0).map(Kernel::gaussian),
        );
        let mut sums = [[0.0f64; 6]; 2];
        let mut moved = 0.0;
        for index in (0..block.voxel_count()).step_by(7) {
            if block.zones[index] != Zone::Deep {
                continue;
            }
            let voxel = DVec3::from_array(block.grid.voxel(index).map(|along| along as f64));
            let move_ = self.at(voxel);
            let there = mirrored_from_voxel.transform_point3(voxel);
            let pair = [there, there + move_].map(|place| trilinear(block, &image, place));
            if let [Some(rigid), Some(warped)] = pair {
                moved += (move_ * DVec3::from_array(block.spacing_mm)).length();
                for (sums, other) in sums.iter_mut().zip([rigid, warped]) {
                    let (a, b) = (f64::from(image[index]), f64::from(other));
                    for (sum, value) in sums.iter_mut().zip([1.0, a, b, a * a, b * b, a * b]) {
                        *sum += value;
                    }
                }
            }
        }
        let [rigid, warped] = sums.map(|[n, a, b, aa, bb, ab]| {
            (ab - a * b / n) / ((aa - a * a / n) * (bb - b * b / n)).sqrt()
        });
        [rigid, warped, moved / sums[0][0]]
    }
}

fn tissue(block: &Block, values: &[f32], index: usize) -> f32 {
    if block.zones[index] >= Zone::Tissue {
        values[index].clamp(OUTSIDE, 1.5)
    } else {
        OUTSIDE
    }
}

fn trilinear(block: &Block, image: &[f32], place: DVec3) -> Option<f32> {
    let base = place.floor();
    let last = DVec3::from_array(block.size.map(|side| side as f64 - 2.0));
    if !(base.cmpge(DVec3::ZERO).all() && base.cmple(last).all()) {
        return None;
    }
    let part = (place - base).as_vec3();
    let first = base.to_array().map(|along| along as usize);
    let mut sum = 0.0;
    for corner in 0..8usize {
        let step = [corner & 1, corner >> 1 & 1, corner >> 2];
        let weight: f32 = (0..3)
            .map(|axis| {
                if step[axis] == 1 {
                    part[axis]
                } else {
                    1.0 - part[axis]
                }
            })
            .product();
        sum += weight
            * image[block
                .grid
                .index([0, 1, 2].map(|axis| first[axis] + step[axis]))];
    }
    Some(sum)
}
