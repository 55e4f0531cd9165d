//! Measures of the junction that variants of the maps compare.

use crate::TissueScale;
use crate::block::{Block, Zone};
use crate::convolve::{Kernel, smooth};
use crate::detail::{Band, detail};
use crate::gradient::{Slope, weighted_gradient};
use crate::sharpness::{Sharpness, sharpness};

/// A measure of the junction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Measure {
    /// The mean gradient: the Gaussian of the derivatives and of the mean, in mm.
    Sharpness {
        /// Of the derivatives.
        gradient_mm: f64,
        /// Of the mean.
        window_mm: f64,
    },
    /// The deviation between two Gaussians, and the Gaussian of its mean, in mm.
    Detail {
        /// The two Gaussians.
        band_mm: [f64; 2],
        /// Of the mean.
        window_mm: f64,
    },
    /// The mean tissue scale of white matter around a place.
    White {
        /// The Gaussian of the mean, in mm.
        window_mm: f64,
    },
    /// The mean distance of the outer end of grey matter from white matter, in mm.
    Thickness {
        /// The Gaussian of the mean, in mm.
        window_mm: f64,
    },
    /// The mean tissue scale, whatever the tissue.
    Tissue {
        /// The Gaussian of the mean, in mm.
        window_mm: f64,
    },
}

/// A head or a box of it, with its measures.
pub(super) struct Part {
    pub(super) block: Block,
    pub(super) weights: Vec<f32>,
    pub(super) density: Vec<f32>,
    /// The mean tissue scale within 4 mm.
    pub(super) white: Vec<f32>,
    pub(super) junction: Vec<u32>,
    measures: Vec<(Measure, Vec<f32>)>,
}

/// The gradient and the window that define the junction, in mm.
const GRADIENT_MM: f64 = 0.65;
const WINDOW_MM: f64 = 2.5;
const HALF_WIDTH: f32 = 0.5;

impl Part {
    pub(super) fn of(
        block: Block,
        values: &[f32],
        tissue: &TissueScale,
        measures: &[Measure],
    ) -> Self {
        let sharpness_of = |gradient_mm, window_mm| {
            let slope = Slope {
                sigma_mm: gradient_mm,
                half_width: HALF_WIDTH,
                noise: tissue.noise,
            };
            sharpness(&block, weighted_gradient(&block, values, slope), window_mm)
        };
        let standard = sharpness_of(GRADIENT_MM, WINDOW_MM);
        let white = mean_tissue(&block, values, 4.0);
        let measures = measures
            .iter()
            .map(|&measure| {
                let mut found = match measure {
                    Measure::Sharpness {
                        gradient_mm,
                        window_mm,
                    } if (gradient_mm, window_mm) == (GRADIENT_MM, WINDOW_MM) => {
                        standard.values.clone()
                    }
                    Measure::Sharpness {
                        gradient_mm,
                        window_mm,
                    } => {
                        let other = sharpness_of(gradient_mm, window_mm).values;
                        filled(other, &standard.values)
                    }
                    Measure::Detail {
                        band_mm: [finest_mm, coarsest_mm],
                        window_mm,
                    } => {
                        let band = Band {
                            finest_mm,
                            coarsest_mm,
                            window_mm,
                        };
                        detail(&block, values, &standard.density, tissue.noise, band)
                    }
                    Measure::White { window_mm } => white_matter(&block, values, window_mm),
                    Measure::Thickness { window_mm } => thickness(&block, values, window_mm),
                    Measure::Tissue { window_mm } => mean_tissue(&block, values, window_mm),
                };
                for (found, sharpness) in found.iter_mut().zip(&standard.values) {
                    if sharpness.is_nan() {
                        *found = f32::NAN;
                    }
                }
                (measure, found)
            })
            .collect();
        let Sharpness {
            weights,
            density,
            junction,
            ..
        } = standard;
        Self {
            block,
            weights,
            density,
            white,
            junction,
            measures,
        }
    }

    pub(super) fn measure(&self, measure: Measure) -> &[f32] {
        let found = self.measures.iter().find(|(other, _)| *other == measure);
        &found.expect("computed").1
    }

    pub(super) fn measures(&self) -> Vec<Measure> {
        self.measures.iter().map(|(measure, _)| *measure).collect()
    }
}

/// Values, where undefined those of another measure.
fn filled(mut values: Vec<f32>, others: &[f32]) -> Vec<f32> {
    for (value, other) in values.iter_mut().zip(others) {
        if value.is_nan() {
            *value = *other;
        }
    }
    values
}

/// The weighted mean of values around each voxel; 0 where there is no weight.
fn weighted_mean(
    block: &Block,
    pair_at: impl Fn(usize) -> [f32; 2],
    window_mm: f64,
    else_: f32,
) -> Vec<f32> {
    let (mut sums, mut weights): (Vec<f32>, Vec<f32>) = (0..block.voxel_count())
        .map(pair_at)
        .map(|[value, weight]: [f32; 2]| (value * weight, weight))
        .unzip();
    let kernels = block.in_voxels(window_mm).map(Kernel::gaussian);
    smooth(&mut sums, block.size, &kernels);
    smooth(&mut weights, block.size, &kernels);
    for (sum, weight) in sums.iter_mut().zip(weights) {
        *sum = if weight > 1e-3 { *sum / weight } else { else_ };
    }
    sums
}

fn mean_tissue(block: &Block, values: &[f32], window_mm: f64) -> Vec<f32> {
    let pair = |index: usize| {
        let is_tissue = block.zones[index] >= Zone::Tissue;
        [
            values[index].clamp(-1.0, 1.5),
            f32::from(u8::from(is_tissue)),
        ]
    };
    weighted_mean(block, pair, window_mm, 0.0)
}

/// The tissue scale smoothed by 0.7 mm.
fn smooth_tissue(block: &Block, values: &[f32]) -> Vec<f32> {
    let mut tissue: Vec<f32> = values.iter().map(|value| value.clamp(-1.0, 1.5)).collect();
    smooth(
        &mut tissue,
        block.size,
        &block.in_voxels(0.7).map(Kernel::gaussian),
    );
    tissue
}

fn white_matter(block: &Block, values: &[f32], window_mm: f64) -> Vec<f32> {
    let tissue = smooth_tissue(block, values);
    let pair = |index: usize| {
        let weight = ((tissue[index] - 0.6) / 0.2).clamp(0.0, 1.0);
        let is_tissue = block.zones[index] >= Zone::Tissue;
        [tissue[index], if is_tissue { weight } else { 0.0 }]
    };
    weighted_mean(block, pair, window_mm, 0.8)
}

/// The greatest distance from white matter, in mm.
const FARTHEST_MM: f32 = 6.0;
/// The tissue scale below which there is fluid.
const FLUID_BELOW: f32 = -0.6;

/// The mean distance of the outer end of grey matter from white matter.
///
/// The outer end is where no neighbour of a voxel is clearly farther from white matter: beside fluid, or in the middle
/// between two banks that touch.
fn thickness(block: &Block, values: &[f32], window_mm: f64) -> Vec<f32> {
    let tissue = smooth_tissue(block, values);
    let [nx, ny, nz] = block.size;
    let spacing = block.spacing_mm.map(|spacing| spacing as f32);
    let stride = [1, nx, nx * ny];
    let is_tissue = |index: usize| block.zones[index] >= Zone::Tissue;
    let is_white = |index: usize| is_tissue(index) && tissue[index] > 0.5;
    let is_grey = |index: usize| is_tissue(index) && (FLUID_BELOW..=0.5).contains(&tissue[index]);
    let mut distance = vec![FARTHEST_MM; values.len()];
    let reach = spacing.map(|spacing| (FARTHEST_MM / spacing).ceil() as i64);
    let mut offsets = Vec::new();
    for z in -reach[2]..=reach[2] {
        for y in -reach[1]..=reach[1] {
            for x in -reach[0]..=reach[0] {
                let [dx, dy, dz] = [0, 1, 2].map(|axis| [x, y, z][axis] as f32 * spacing[axis]);
                let length = (dx * dx + dy * dy + dz * dz).sqrt();
                if length > 0.0 && length <= FARTHEST_MM {
                    offsets.push((x + nx as i64 * (y + ny as i64 * z), length));
                }
            }
        }
    }
    let margin = |axis: usize| reach[axis] as usize;
    let inner = |axis: usize| margin(axis)..block.size[axis].saturating_sub(margin(axis));
    let _ = nz;
    for (z, y) in inner(2).flat_map(|z| inner(1).map(move |y| (z, y))) {
        for x in inner(0) {
            let index = x + nx * (y + ny * z);
            if !is_white(index) {
                continue;
            }
            let beside =
                |step: i64, axis: usize| (index as i64 + step * stride[axis] as i64) as usize;
            let at_border =
                (0..3).any(|axis| !is_white(beside(1, axis)) || !is_white(beside(-1, axis)));
            if !at_border {
                continue;
            }
            let slope = (0..3)
                .map(|axis| {
                    (tissue[beside(1, axis)] - tissue[beside(-1, axis)]) / (2.0 * spacing[axis])
                })
                .map(|slope| slope * slope)
                .sum::<f32>()
                .sqrt();
            let inside = ((tissue[index] - 0.5) / slope.max(0.05)).clamp(0.0, 1.0);
            for &(offset, length) in &offsets {
                let there = &mut distance[(index as i64 + offset) as usize];
                *there = there.min(length - inside);
            }
        }
    }
    let near_mm = 1.8 * spacing[0].max(spacing[1]).max(spacing[2]);
    let neighbours: Vec<(i64, f32)> = offsets
        .iter()
        .copied()
        .filter(|&(_, length)| length <= near_mm)
        .collect();
    // From the outer end inwards, each voxel takes the mean thickness of its neighbours farther out.
    let mut order: Vec<u32> = (0..values.len() as u32)
        .filter(|&index| {
            let distance = distance[index as usize];
            is_grey(index as usize) && distance < FARTHEST_MM
        })
        .collect();
    order.sort_unstable_by(|a, b| {
        distance[*b as usize]
            .total_cmp(&distance[*a as usize])
            .then(a.cmp(b))
    });
    let mut thick = vec![0.0f32; values.len()];
    for &index in &order {
        let own = distance[index as usize];
        let (mut sum, mut count) = (0.0, 0.0);
        for &(offset, length) in &neighbours {
            let other = (i64::from(index) + offset) as usize;
            let rise = distance
                .get(other)
                .map_or(0.0, |farther| (farther - own) / length);
            if rise > 0.6 && thick.get(other).is_some_and(|thick| *thick > 0.0) {
                sum += rise * thick[other];
                count += rise;
            }
        }
        thick[index as usize] = if count > 0.0 { sum / count } else { own };
    }
    let pair = |index: usize| {
        let is_inner = thick[index] > 0.0 && distance[index] < 1.6;
        [thick[index], f32::from(u8::from(is_inner))]
    };
    weighted_mean(block, pair, window_mm, 2.5)
}
