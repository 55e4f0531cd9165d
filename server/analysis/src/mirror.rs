//! Compares a voxel with its surroundings and with the mirrored point on the other side.

use geometry::Grid;
use glam::{DAffine3, DMat3, DVec3, Vec3};

use crate::MidsagittalPlane;
use crate::block::{Block, Zone};
use crate::coarse::{Coarse, Pair, Sums};

/// The cell size for the sums of surroundings, in mm.
const STEP_MM: f64 = 2.0;
/// The Gaussian of the surroundings, in mm.
const RING_MM: f64 = 8.0;
/// The Gaussian that smooths the mirrored side, in mm.
const MIRRORED_MM: f64 = 3.0;
/// The Gaussian that smooths intensities on both sides, in mm.
const INTENSITY_MM: f64 = 4.0;
/// The least weight for a mirrored value.
pub(crate) const LEAST_MIRRORED: f32 = 0.02;
/// The least weight for surroundings; a defined voxel always has it.
const LEAST_RING: f32 = 1e-4;
/// The fraction of the smoothed tissue at a mirrored point that must lie inside.
const LEAST_INSIDE: f32 = 0.3;
/// The intensities of tissue; beyond are vessels and fluid, in tissue scale.
const INTENSITY_RANGE: [f32; 2] = [-1.5, 1.6];

/// Differences of a measure at some voxels of a block; NaN where one of the two values is undefined.
#[derive(Debug, Default)]
pub(crate) struct Differences {
    /// Own value minus the mean of the surroundings.
    pub(crate) from_ring: Vec<f32>,
    /// Own value minus the mirrored value.
    pub(crate) from_mirrored: Vec<f32>,
}

/// Compares two measures of the junction with their surroundings and with the other side, at the voxels at which they
/// are defined (ascending); elsewhere, the first is NaN. Only the mirrored side is smoothed.
pub(crate) fn differences(
    block: &Block,
    voxels: &[u32],
    (measures, weights): ([&[f32]; 2], &[f32]),
    plane: &MidsagittalPlane,
) -> [Differences; 2] {
    let coarse = Coarse::new(block.size, block.spacing_mm, STEP_MM);
    let [first, second] = measures;
    let means = coarse.means(|index| {
        if first[index].is_nan() {
            [0.0; 3]
        } else {
            let weight = weights[index];
            [first[index] * weight, second[index] * weight, weight]
        }
    });
    let around = coarse.smoothed(&means, RING_MM);
    let mirrored = coarse.smoothed(&means, MIRRORED_MM);
    drop(means);
    let less = |own: f32, sum: f32, weight: f32, least: f32| {
        if weight > least {
            own - sum / weight
        } else {
            f32::NAN
        }
    };
    let mut differences = measures.map(|_| Differences {
        from_ring: Vec::with_capacity(voxels.len()),
        from_mirrored: Vec::with_capacity(voxels.len()),
    });
    let places = Places::new(block, &coarse, plane);
    places.visit(voxels, &around, |index, own, other| {
        let other = coarse.sample(&mirrored, other);
        for ((differences, measure), place) in differences.iter_mut().zip(measures).zip(0..) {
            let value = measure[index];
            let from_ring = less(value, own[place], own[2], LEAST_RING);
            let from_mirrored = less(value, other[place], other[2], LEAST_MIRRORED);
            differences.from_ring.push(from_ring);
            differences.from_mirrored.push(from_mirrored);
        }
    });
    differences
}

/// The tissue scale minus its mirrored value, both smoothed, at some voxels (ascending).
pub(crate) fn intensity_differences(
    block: &Block,
    values: &[f32],
    voxels: &[u32],
    plane: &MidsagittalPlane,
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
    let smoothed = coarse.smoothed(&means, INTENSITY_MM);
    let mean = |[sum, weight]: Pair| {
        if weight > LEAST_INSIDE {
            sum / weight
        } else {
            f32::NAN
        }
    };
    let places = Places::new(block, &coarse, plane);
    let mut differences = Vec::with_capacity(voxels.len());
    places.visit(voxels, &smoothed, |_, own, other| {
        differences.push(mean(own) - mean(coarse.sample(&smoothed, other)));
    });
    differences
}

/// The places of voxels of a block among cells.
pub(crate) struct Places<'a> {
    block: &'a Block,
    coarse: &'a Coarse,
    /// To the mirrored position.
    cell_from_mirrored: DAffine3,
}

impl<'a> Places<'a> {
    pub(crate) fn new(block: &'a Block, coarse: &'a Coarse, plane: &MidsagittalPlane) -> Self {
        Self {
            block,
            coarse,
            cell_from_mirrored: coarse.through(mirrored_from_voxel(&block.grid, plane)),
        }
    }

    /// Calls `visit` with the index of each of the voxels (ascending), the sums of the cells there, and the mirrored
    /// position in cells.
    pub(crate) fn visit<const N: usize>(
        &self,
        mut voxels: &[u32],
        cells: &[Sums<N>],
        mut visit: impl FnMut(usize, Sums<N>, Vec3),
    ) {
        let [nx, ny, _] = self.block.size;
        let (along_row, mut mixed) = (self.coarse.along_row(), Vec::new());
        let step = self.cell_from_mirrored.matrix3.x_axis.as_vec3();
        while let Some(&first) = voxels.first() {
            let number = first as usize / nx;
            let begin = number * nx;
            let count = voxels.partition_point(|&voxel| (voxel as usize) < begin + nx);
            let (row, rest) = voxels.split_at(count);
            let start = DVec3::from_array([0, number % ny, number / ny].map(|place| place as f64));
            let start = self.cell_from_mirrored.transform_point3(start).as_vec3();
            self.coarse.mixed_row(cells, number, &mut mixed);
            for index in row.iter().map(|&voxel| voxel as usize) {
                let x = index - begin;
                let own = along_row[x].of_row(&mixed);
                visit(index, own, start + step * x as f32);
            }
            voxels = rest;
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
