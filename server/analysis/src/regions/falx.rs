//! The sheet between the hemispheres: a height field over the midsagittal plane.

use glam::{DAffine3, DVec3, Vec3};
use rayon::prelude::*;

use super::lattice::Lattice;
use crate::Head;
use crate::block::{Block, depth_at};

/// The distance of its columns, and of the heights that are tried, in mm.
const STEP_MM: f64 = 1.0;
/// The greatest distance of the sheet from the plane, in mm.
const REACH: usize = 10;
const HEIGHTS: usize = 2 * REACH + 1;
/// The cost of a step of 1 mm in height from one column to the next, in tissue scale.
const SLOPE_COST: f32 = 0.2;
/// The cost of 1 mm of height: among equals, the sheet lies in the plane.
const HEIGHT_COST: f32 = 0.004;
/// Up to this distance from the centroid, the sheet stays near the plane, or it would run through a ventricle; and how
/// near, and how much farther it may go for each mm farther out.
const MIDDLE_MM: f64 = 32.0;
const NEAR_MM: f64 = 2.5;
const FARTHER: f64 = 0.3;
/// The cost of a height beyond that.
const TOO_FAR: f32 = 4.0;
/// The tissue scale beyond which a place is no darker, or brighter.
const RANGE: [f32; 2] = [-0.8, 0.8];
/// The Gaussian of the heights, in columns.
const SMOOTH: f64 = 0.8;
/// The rounds in which the sheet is stretched over tissue, and the overrelaxation of each.
const STRETCH_ROUNDS: usize = 150;
const STRETCH_STEP: f32 = 1.9;
/// A column is dark below this tissue scale.
const DARK_BELOW: f32 = 0.0;

/// The sheet between the hemispheres.
///
/// It follows what is darkest near the fitted plane: the falx and the fluid beside it. Where it meets tissue or ventricles
/// (between the callosum and the brain stem) it is stretched between the fissures around.
#[derive(Debug, Clone, PartialEq)]
pub struct Sheet {
    /// To the axes of the head, in mm; x from the plane to the left.
    head_from_patient: DAffine3,
    /// The first column, along y and z of the head, in mm.
    first: [f64; 2],
    size: [usize; 2],
    /// The height of each column over the plane, in mm to the left, y-fastest.
    heights: Vec<f32>,
    /// What the sheet meets in each column.
    materials: Vec<Material>,
}

impl Sheet {
    /// How far a position (LPS mm) lies to the left of the sheet, in mm.
    pub fn left_mm(&self, position_in_patient: DVec3) -> f64 {
        self.left_of(self.head_from_patient.transform_point3(position_in_patient))
    }

    /// The same, for a position along the axes of the head.
    pub(super) fn left_of(&self, place: DVec3) -> f64 {
        if place.x.abs() > REACH as f64 * STEP_MM {
            return place.x;
        }
        let along = |axis: usize, value: f64| {
            let last = self.size[axis] as f64 - 1.0;
            let at = ((value - self.first[axis]) / STEP_MM).clamp(0.0, last);
            let base = (at as usize).min(self.size[axis].saturating_sub(2));
            (base, (at - base as f64) as f32)
        };
        let (y, v) = along(0, place.y);
        let (z, w) = along(1, place.z);
        let at = |dy: usize, dz: usize| {
            let y = (y + dy).min(self.size[0] - 1);
            let z = (z + dz).min(self.size[1] - 1);
            self.heights[y + self.size[0] * z]
        };
        let row = |dz: usize| at(0, dz) * (1.0 - v) + at(1, dz) * v;
        place.x - f64::from(row(0) * (1.0 - w) + row(1) * w)
    }

    /// The columns in which the sheet runs through tissue that joins the hemispheres, and fluid within it: tissue in the middle of the
    /// head, and what is connected to it by tissue at least three columns wide.
    ///
    /// Farther out, islands of tissue are gyri that touch across the falx.
    pub(super) fn joining(&self) -> Vec<bool> {
        let is_tissue = |index: usize| self.materials[index] == Material::Tissue;
        let is_middle = |index: usize| {
            let along = |axis: usize, place: usize| self.first[axis] + place as f64 * STEP_MM;
            let (y, z) = (index % self.size[0], index / self.size[0]);
            along(0, y).hypot(along(1, z)) <= MIDDLE_MM
        };
        let columns = 0..self.materials.len();
        let mut joining: Vec<bool> = columns
            .clone()
            .map(|index| is_tissue(index) && is_middle(index))
            .collect();
        let mut open: Vec<usize> = columns.filter(|&index| joining[index]).collect();
        while let Some(index) = open.pop() {
            if !around(index, self.size).all(is_tissue) {
                continue;
            }
            for other in around(index, self.size) {
                if !std::mem::replace(&mut joining[other], true) {
                    open.push(other);
                }
            }
        }
        joining
    }

    /// The number of the column of a position (LPS mm).
    pub(super) fn column(&self, position_in_patient: DVec3) -> usize {
        let place = self.head_from_patient.transform_point3(position_in_patient);
        let along = |axis: usize, value: f64| {
            let last = self.size[axis] as f64 - 1.0;
            ((value - self.first[axis]) / STEP_MM)
                .round()
                .clamp(0.0, last) as usize
        };
        along(0, place.y) + self.size[0] * along(1, place.z)
    }

    /// To the axes of the head.
    pub(super) fn head_from_patient(&self) -> DAffine3 {
        self.head_from_patient
    }

    /// Finds the sheet by semi-global dynamic programming: for each column, the height with the least sum of costs over
    /// the best sheets along four directions.
    ///
    /// Source of the search: Hirschmüller, "Stereo Processing by Semiglobal Matching and Mutual Information", IEEE
    /// Transactions on Pattern Analysis and Machine Intelligence 30, 2008.
    pub(super) fn new(head: Head<'_>, block: &Block, values: &[f32], lattice: &Lattice) -> Self {
        let (first, last) = lattice.bounds();
        let size = [1, 2].map(|axis: usize| ((last[axis] - first[axis]) / STEP_MM) as usize + 1);
        let column = |index: usize| {
            let y = first.y + (index % size[0]) as f64 * STEP_MM;
            let z = first.z + (index / size[0]) as f64 * STEP_MM;
            DVec3::new(0.0, y, z)
        };
        let tissue = Sampled::new(head, block, values, lattice.patient_from_head);
        let columns = (0..size[0] * size[1]).into_par_iter();
        let costs: Vec<[f32; HEIGHTS]> = columns.map(|index| tissue.costs(column(index))).collect();
        let totals = totals(&costs, size);
        let heights: Vec<f32> = totals.iter().map(least).collect();
        let mut heights = smoothed(heights, size);
        let materials = heights.iter().enumerate().map(|(index, &height)| {
            match tissue.at(column(index).with_x(f64::from(height))) {
                None => Material::Outside,
                Some(value) if value < DARK_BELOW => Material::Fissure,
                Some(_) => Material::Tissue,
            }
        });
        let materials = fissures(materials.collect(), size);
        stretch(&mut heights, &materials, size);
        Self {
            materials,
            head_from_patient: lattice.patient_from_head.inverse(),
            first: [first.y, first.z],
            size,
            heights,
        }
    }

    /// The share of the sheet within the envelope that lies in a fissure.
    pub(super) fn fissure_share(&self) -> f64 {
        let count = |material: Material| {
            self.materials
                .iter()
                .filter(|&&other| other == material)
                .count() as f64
        };
        let fissure = count(Material::Fissure);
        fissure / (fissure + count(Material::Tissue)).max(1.0)
    }
}

/// Marks the dark columns that are no fissure as tissue: those that are not connected to the outside by others, at least
/// three wide (ventricles).
fn fissures(mut materials: Vec<Material>, size @ [ny, nz]: [usize; 2]) -> Vec<Material> {
    let is_wide =
        |index: usize| around(index, size).all(|other| materials[other] != Material::Tissue);
    let wide: Vec<bool> = (0..ny * nz).map(is_wide).collect();
    let mut reached: Vec<bool> = materials
        .iter()
        .map(|&material| material == Material::Outside)
        .collect();
    let mut open: Vec<usize> = (0..reached.len()).filter(|&index| reached[index]).collect();
    while let Some(index) = open.pop() {
        for other in around(index, size) {
            if wide[other] && !reached[other] {
                reached[other] = true;
                open.push(other);
            }
        }
    }
    let near: Vec<bool> = (0..ny * nz)
        .map(|index| around(index, size).any(|other| reached[other]))
        .collect();
    for (material, is_near) in materials.iter_mut().zip(near) {
        if *material == Material::Fissure && !is_near {
            *material = Material::Tissue;
        }
    }
    materials
}

/// A column and the up to eight around it.
fn around(index: usize, [ny, nz]: [usize; 2]) -> impl Iterator<Item = usize> {
    let (y, z) = (index % ny, index / ny);
    let [ys, zs] =
        [(y, ny), (z, nz)].map(|(place, side)| place.saturating_sub(1)..=(place + 1).min(side - 1));
    zs.flat_map(move |z| ys.clone().map(move |y| y + ny * z))
}

/// Replaces the heights in tissue by a membrane that is held by those around.
fn stretch(heights: &mut [f32], materials: &[Material], [ny, nz]: [usize; 2]) {
    let held = |index: &usize| {
        let (y, z) = (index % ny, index / ny);
        materials[*index] == Material::Tissue
            && (1..ny - 1).contains(&y)
            && (1..nz - 1).contains(&z)
    };
    let free: Vec<usize> = (0..heights.len()).filter(held).collect();
    for _ in 0..STRETCH_ROUNDS {
        for &index in &free {
            let sum =
                heights[index - 1] + heights[index + 1] + heights[index - ny] + heights[index + ny];
            heights[index] += STRETCH_STEP * (sum / 4.0 - heights[index]);
        }
    }
}

/// What the sheet meets in a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Material {
    /// It is outside the envelope.
    Outside,
    /// Fluid or dura between the hemispheres.
    Fissure,
    /// Tissue, or fluid within it.
    Tissue,
}

/// The tissue scale of a head at positions along its axes.
struct Sampled<'a> {
    head: Head<'a>,
    block: &'a Block,
    values: &'a [f32],
    voxel_from_head: DAffine3,
    working_from_head: DAffine3,
}

impl<'a> Sampled<'a> {
    fn new(
        head: Head<'a>,
        block: &'a Block,
        values: &'a [f32],
        patient_from_head: DAffine3,
    ) -> Self {
        Self {
            head,
            block,
            values,
            voxel_from_head: block.grid.voxel_from_patient() * patient_from_head,
            working_from_head: head.depth.grid().voxel_from_patient() * patient_from_head,
        }
    }

    /// Trilinear; `None` outside the envelope or the block.
    fn at(&self, place: DVec3) -> Option<f32> {
        let working = self.working_from_head.transform_point3(place).as_vec3();
        (depth_at(self.head.depth, working) >= 0.0).then_some(())?;
        let voxel = self.voxel_from_head.transform_point3(place).as_vec3();
        let base = voxel.floor();
        let last = Vec3::from_array(self.block.size.map(|side| side as f32 - 1.0));
        let is_inside = base.cmpge(Vec3::ZERO).all() && base.cmplt(last).all();
        is_inside.then_some(())?;
        let part = voxel - base;
        let [nx, ny, _] = self.block.size;
        let [x, y, z] = base.to_array().map(|along| along as usize);
        let start = x + nx * (y + ny * z);
        let row = |at: usize| self.values[at] + (self.values[at + 1] - self.values[at]) * part.x;
        let slice = |at: usize| row(at) + (row(at + nx) - row(at)) * part.y;
        Some(slice(start) + (slice(start + nx * ny) - slice(start)) * part.z)
    }

    /// The costs of the heights of a column; the same everywhere outside the envelope.
    fn costs(&self, column: DVec3) -> [f32; HEIGHTS] {
        let most = NEAR_MM + FARTHER * (column.length() - MIDDLE_MM).max(0.0);
        std::array::from_fn(|number| {
            let height = (number as f64 - REACH as f64) * STEP_MM;
            let value = self.at(column.with_x(height)).unwrap_or_default();
            let beyond = if height.abs() > most { TOO_FAR } else { 0.0 };
            value.clamp(RANGE[0], RANGE[1]) + HEIGHT_COST * height.abs() as f32 + beyond
        })
    }
}

/// The sums of the costs of the best sheets through each height of each column, from four directions.
fn totals(costs: &[[f32; HEIGHTS]], [ny, nz]: [usize; 2]) -> Vec<[f32; HEIGHTS]> {
    let mut totals = vec![[0.0; HEIGHTS]; costs.len()];
    let mut along = |columns: &mut dyn Iterator<Item = usize>| {
        let mut before = [0.0; HEIGHTS];
        for column in columns {
            let mut here = nearest_best(before);
            for (here, cost) in here.iter_mut().zip(&costs[column]) {
                *here += cost;
            }
            let least = here.iter().copied().fold(f32::INFINITY, f32::min);
            for (total, here) in totals[column].iter_mut().zip(&mut here) {
                *here -= least;
                *total += *here;
            }
            before = here;
        }
    };
    for z in 0..nz {
        along(&mut (0..ny).map(|y| y + ny * z));
        along(&mut (0..ny).rev().map(|y| y + ny * z));
    }
    for y in 0..ny {
        along(&mut (0..nz).map(|z| y + ny * z));
        along(&mut (0..nz).rev().map(|z| y + ny * z));
    }
    totals
}

/// For each height, the least cost of another one with the cost of the way to it.
fn nearest_best(mut costs: [f32; HEIGHTS]) -> [f32; HEIGHTS] {
    for height in 1..HEIGHTS {
        costs[height] = costs[height].min(costs[height - 1] + SLOPE_COST);
    }
    for height in (1..HEIGHTS).rev() {
        costs[height - 1] = costs[height - 1].min(costs[height] + SLOPE_COST);
    }
    costs
}

/// The height of the least cost, in mm, between the heights by a parabola; among equals, the one nearest to the plane.
fn least(costs: &[f32; HEIGHTS]) -> f32 {
    let from_plane = |number: usize| number.abs_diff(REACH);
    let best = (0..HEIGHTS).min_by(|&a, &b| {
        let by_cost = costs[a].total_cmp(&costs[b]);
        by_cost.then(from_plane(a).cmp(&from_plane(b)))
    });
    let best = best.expect("there are heights");
    let between = if best > 0 && best + 1 < HEIGHTS {
        let [before, here, after] = [costs[best - 1], costs[best], costs[best + 1]];
        let bend = before - 2.0 * here + after;
        if bend > 1e-6 {
            (before - after) / (2.0 * bend)
        } else {
            0.0
        }
    } else {
        0.0
    };
    (best as f32 - REACH as f32 + between.clamp(-0.5, 0.5)) * STEP_MM as f32
}

/// Heights after a Gaussian along y and z; the ends are repeated.
fn smoothed(heights: Vec<f32>, [ny, nz]: [usize; 2]) -> Vec<f32> {
    let reach = (3.0 * SMOOTH).ceil() as isize;
    let taps: Vec<f32> = (-reach..=reach)
        .map(|place| (-0.5 * (place as f64 / SMOOTH).powi(2)).exp() as f32)
        .collect();
    let total: f32 = taps.iter().sum();
    let pass = |heights: &[f32], stride: usize, side: usize| -> Vec<f32> {
        let at = |index: usize| {
            let place = (index / stride % side) as isize;
            let sum: f32 = taps
                .iter()
                .zip(-reach..)
                .map(|(tap, off)| {
                    let there = (place + off).clamp(0, side as isize - 1);
                    tap * heights[index.wrapping_add_signed((there - place) * stride as isize)]
                })
                .sum();
            sum / total
        };
        (0..heights.len()).map(at).collect()
    };
    pass(&pass(&heights, 1, ny), ny, nz)
}
