//! Compares a voxel with its surroundings and with the mirrored point on the other side.

use geometry::Grid;
use glam::{DAffine3, DMat3, DVec3, Vec3};

use crate::MidsagittalPlane;
use crate::block::{Block, Zone};
use crate::coarse::{Coarse, Pair};

/// The cell size for the sums of surroundings, in mm.
const STEP_MM: f64 = 2.0;
/// The least weight for a mirrored value.
const LEAST_MIRRORED: f32 = 0.02;
/// The least weight for surroundings; a defined voxel always has it.
const LEAST_RING: f32 = 1e-4;
/// The fraction of the smoothed tissue at a mirrored point that must lie inside.
const LEAST_INSIDE: f32 = 0.3;
/// The intensities of tissue; beyond are vessels and fluid, in tissue scale.
const INTENSITY_RANGE: [f32; 2] = [-1.5, 1.6];

/// Differences for each voxel of a block; NaN where one of the two values is undefined.
pub(crate) struct Differences {
    /// Own value minus the mean of the surroundings.
    pub(crate) from_ring: Vec<f32>,
    /// Own value minus the mirrored value.
    pub(crate) from_mirrored: Vec<f32>,
}

/// Widths of the Gaussians of surroundings and of the mirrored side, in mm.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Widths {
    pub(crate) ring_mm: f64,
    pub(crate) mirrored_mm: f64,
}

/// Compares a measure of the junction (NaN where it is undefined) with its surroundings and with the other side. Only
/// the mirrored side is smoothed.
pub(crate) fn differences(
    block: &Block,
    (values, weights): (&[f32], &[f32]),
    plane: &MidsagittalPlane,
    widths: Widths,
) -> Differences {
    let coarse = Coarse::new(block.size, block.spacing_mm, STEP_MM);
    let means = coarse.means(|index| {
        let (value, weight) = (values[index], weights[index]);
        if value.is_nan() {
            [0.0; 2]
        } else {
            [value * weight, weight]
        }
    });
    let around = coarse.smoothed(&means, widths.ring_mm);
    let mirrored = coarse.smoothed(&means, widths.mirrored_mm);
    drop(means);
    let less = |own: f32, [sum, weight]: Pair, least: f32| {
        if weight > least {
            own - sum / weight
        } else {
            f32::NAN
        }
    };
    let mut from_ring = vec![f32::NAN; block.voxel_count()];
    let mut from_mirrored = vec![f32::NAN; block.voxel_count()];
    let cell_from_voxel = coarse.through(mirrored_from_voxel(&block.grid, plane));
    for_each_pair(
        block,
        &coarse,
        &around,
        cell_from_voxel,
        |index, own, other| {
            let value = values[index];
            if !value.is_nan() {
                from_ring[index] = less(value, own, LEAST_RING);
                let mirrored = coarse.sample(&mirrored, other);
                from_mirrored[index] = less(value, mirrored, LEAST_MIRRORED);
            }
        },
    );
    Differences {
        from_ring,
        from_mirrored,
    }
}

/// The tissue scale minus its mirrored value, both smoothed by a Gaussian of `width_mm`, in voxels that are deep
/// enough.
pub(crate) fn intensity_differences(
    block: &Block,
    values: &[f32],
    plane: &MidsagittalPlane,
    width_mm: f64,
) -> Vec<f32> {
    let coarse = Coarse::new(block.size, block.spacing_mm, STEP_MM);
    let [least, most] = INTENSITY_RANGE;
    let means = coarse.means(|index| {
        let is_tissue = block.zones[index] >= Zone::Tissue;
        if is_tissue {
            [values[index].clamp(least, most), 1.0]
        } else {
            [0.0; 2]
        }
    });
    let smoothed = coarse.smoothed(&means, width_mm);
    let mean = |[sum, weight]: Pair| {
        if weight > LEAST_INSIDE {
            sum / weight
        } else {
            f32::NAN
        }
    };
    let mut differences = vec![f32::NAN; block.voxel_count()];
    let cell_from_voxel = coarse.through(mirrored_from_voxel(&block.grid, plane));
    for_each_pair(
        block,
        &coarse,
        &smoothed,
        cell_from_voxel,
        |index, own, other| {
            if block.zones[index] == Zone::Deep {
                differences[index] = mean(own) - mean(coarse.sample(&smoothed, other));
            }
        },
    );
    differences
}

/// Calls `visit` with the index of each voxel, its pair of numbers, and its position through an affine.
fn for_each_pair(
    block: &Block,
    coarse: &Coarse,
    pairs: &[Pair],
    cell_from_voxel: DAffine3,
    mut visit: impl FnMut(usize, Pair, Vec3),
) {
    let [nx, ny, nz] = block.size;
    let (along_row, mut mixed) = (coarse.along_row(), Vec::new());
    let step = cell_from_voxel.matrix3.x_axis.as_vec3();
    for number in 0..ny * nz {
        let start = DVec3::from_array([0, number % ny, number / ny].map(|place| place as f64));
        let start = cell_from_voxel.transform_point3(start).as_vec3();
        coarse.mixed_row(pairs, number, &mut mixed);
        for (x, between) in along_row.iter().enumerate() {
            visit(
                number * nx + x,
                between.of_row(&mixed),
                start + step * x as f32,
            );
        }
    }
}

/// From voxels of a grid to the mirrored position, in voxels of the same grid.
pub(crate) fn mirrored_from_voxel(grid: &Grid, plane: &MidsagittalPlane) -> DAffine3 {
    let normal = plane.normal();
    let turned = |axis: DVec3| axis - normal * (2.0 * normal.dot(axis));
    let reflection = DAffine3 {
        matrix3: DMat3::from_cols(turned(DVec3::X), turned(DVec3::Y), turned(DVec3::Z)),
        translation: normal * (2.0 * plane.offset_mm()),
    };
    grid.voxel_from_patient() * reflection * grid.patient_from_voxel()
}
