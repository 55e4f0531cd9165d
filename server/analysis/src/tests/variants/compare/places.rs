//! Places of the junction, their scores and marks.

use glam::{DVec3, Vec3};

use crate::block::{Block, depth_at};
use crate::coarse::Pair;
use crate::convolve::{Kernel, smooth};
use crate::study::{Ground, Mark};

/// The least distance of two marks, in mm.
const APART_MM: f64 = 10.0;
/// The greatest number of marks.
const MARKS: usize = 60;

/// A part of a block.
pub(super) fn part_of(block: &Block, first: [usize; 3], size: [usize; 3]) -> Block {
    let grid = block.grid.block(first.map(|voxel| voxel as i64), size);
    let grid = grid.expect("a part of a grid is a grid");
    let zone = |index: usize| {
        let voxel = grid.voxel(index);
        block.zones[block
            .grid
            .index([0, 1, 2].map(|axis| voxel[axis] + first[axis]))]
    };
    Block {
        first: [0, 1, 2].map(|axis| block.first[axis] + first[axis]),
        size,
        spacing_mm: block.spacing_mm,
        zones: (0..grid.voxel_count()).map(zone).collect(),
        grid,
    }
}

pub(super) fn pair(value: f32, weight: f32) -> Pair {
    if value.is_nan() {
        [0.0; 2]
    } else {
        [value * weight, weight]
    }
}

pub(super) fn less(own: f32, [sum, weight]: Pair, least: f32) -> f32 {
    if weight > least {
        own - sum / weight
    } else {
        f32::NAN
    }
}

pub(super) fn in_voxels(block: &Block, voxel: usize) -> DVec3 {
    DVec3::from_array(block.grid.voxel(voxel).map(|along| along as f64))
}

pub(super) fn position(block: &Block, voxel: usize) -> DVec3 {
    block
        .grid
        .patient_from_voxel()
        .transform_point3(in_voxels(block, voxel))
}

pub(super) fn depth(ground: &Ground<'_>, position: DVec3) -> f32 {
    let depth = ground.head.depth;
    let place: Vec3 = depth
        .grid()
        .voxel_from_patient()
        .transform_point3(position)
        .as_vec3();
    depth_at(depth, place)
}

/// Scores over the junction, smoothed over the junction alone.
pub(super) fn smoothed(
    block: &Block,
    junction: &[u32],
    scores: &[f32],
    [sigma_mm, prior]: [f64; 2],
) -> Vec<f32> {
    let kernels = block.in_voxels(sigma_mm).map(Kernel::gaussian);
    let mut sums = vec![0.0; block.voxel_count()];
    let mut weights = vec![0.0; block.voxel_count()];
    for (&voxel, &score) in junction.iter().zip(scores) {
        if !score.is_nan() {
            sums[voxel as usize] = score;
            weights[voxel as usize] = 1.0;
        }
    }
    smooth(&mut sums, block.size, &kernels);
    smooth(&mut weights, block.size, &kernels);
    let mean =
        |&voxel: &u32| sums[voxel as usize] / (weights[voxel as usize] + prior as f32).max(1e-6);
    junction.iter().map(mean).collect()
}

/// Two descending sequences as one.
pub(super) fn merged(
    a: impl Iterator<Item = (f32, DVec3)>,
    b: impl Iterator<Item = (f32, DVec3)>,
) -> impl Iterator<Item = (f32, DVec3)> {
    let (mut a, mut b) = (a.peekable(), b.peekable());
    std::iter::from_fn(move || match (a.peek(), b.peek()) {
        (Some(x), Some(y)) if x.0 >= y.0 => a.next(),
        (Some(_), None) => a.next(),
        _ => b.next(),
    })
}

/// Marks of descending scores, each at least 10 mm from every higher one.
pub(super) fn greedy(places: impl Iterator<Item = (f32, DVec3)>) -> Vec<Mark> {
    let mut marks: Vec<Mark> = Vec::new();
    for (score, position_in_patient) in places {
        let is_apart = marks.iter().all(|mark| {
            mark.position_in_patient
                .distance_squared(position_in_patient)
                >= APART_MM * APART_MM
        });
        if is_apart {
            marks.push(Mark {
                position_in_patient,
                score,
            });
        }
        if marks.len() == MARKS {
            break;
        }
    }
    marks
}
