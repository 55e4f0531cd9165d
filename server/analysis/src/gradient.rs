//! The gradient of the tissue scale, weighted by nearness to the middle between grey and white.

use glam::DMat3;
use multiversion::multiversion;

use crate::block::{Block, Zone};
use crate::convolve::Kernel;

/// The Gaussian for the derivatives, in mm.
const SIGMA_MM: f64 = 0.65;
/// The greatest distance from the middle between grey and white at which a voxel counts, in tissue scale.
pub(crate) const HALF_WIDTH: f32 = 0.5;

/// The weight of each voxel, and its gradient (per mm) times its weight. Both are 0 in voxels that are not deep enough.
pub(crate) struct Weighted {
    pub(crate) weights: Vec<f32>,
    pub(crate) gradients: Vec<f32>,
}

/// The least width of the Gaussian, in voxels; below it a sampled derivative depends on the direction.
const LEAST_VOXELS: f64 = 0.6;

/// The width of the Gaussian for voxels of these edges, in mm.
pub(crate) fn sigma_for(spacing_mm: [f64; 3]) -> f64 {
    let largest = spacing_mm.into_iter().fold(0.0, f64::max);
    SIGMA_MM.max(LEAST_VOXELS * largest)
}

/// The gradient of the tissue scale at the junction.
///
/// Derivatives of one Gaussian are sampled along the three axes, so that the gradient of an edge does not depend on its
/// direction; central differences after a narrow Gaussian are larger across a diagonal. `noise` is the standard deviation of the
/// noise, which adds to every gradient.
pub(crate) fn weighted_gradient(block: &Block, values: &[f32], noise: f32) -> Weighted {
    let sigma = block.in_voxels(sigma_for(block.spacing_mm));
    let kernels = Kernels {
        smoothing: sigma.map(Kernel::gaussian),
        derivative: sigma.map(Kernel::derivative),
    };
    let metric = Metric::of(block);
    let weigh = Weigh {
        noise: metric.noise(&kernels) * noise * noise,
        per_half_width: 1.0 / HALF_WIDTH,
        metric,
    };
    let [nx, ny, _] = block.size;
    let mut weights = vec![0.0; values.len()];
    let mut gradients = vec![0.0; values.len()];
    let mut plane = Plane::new(nx, ny);
    let outs = weights
        .chunks_exact_mut(nx * ny)
        .zip(gradients.chunks_exact_mut(nx * ny));
    for (z, (weights, gradients)) in outs.enumerate() {
        let zones = &block.zones[z * nx * ny..][..nx * ny];
        if zones.contains(&Zone::Deep) {
            plane.differentiate(values, z, &kernels);
            weigh_plane(&weigh, zones, &plane, [weights, gradients]);
        }
    }
    Weighted { weights, gradients }
}

/// The derivatives of one plane, per voxel.
struct Plane {
    nx: usize,
    padded: Vec<f32>,
    /// Smoothed along z, and differentiated along z.
    even: Vec<f32>,
    odd: Vec<f32>,
    /// The same after the pass along y: smoothed, differentiated along y, differentiated along z.
    passes: [Vec<f32>; 3],
    smooth: Vec<f32>,
    along: [Vec<f32>; 3],
}

impl Plane {
    fn new(nx: usize, ny: usize) -> Self {
        let empty = || vec![0.0; nx * ny];
        Self {
            nx,
            padded: Vec::new(),
            even: empty(),
            odd: empty(),
            passes: [empty(), empty(), empty()],
            smooth: empty(),
            along: [empty(), empty(), empty()],
        }
    }

    /// Computes the derivatives of plane `z`; beyond the faces, values of the faces are repeated.
    fn differentiate(&mut self, values: &[f32], z: usize, kernels: &Kernels) {
        let plane = self.even.len();
        let last = values.len() / plane - 1;
        let reach = kernels.smoothing[2].reach();
        self.padded.clear();
        for place in z..=z + 2 * reach {
            let there = place.saturating_sub(reach).min(last) * plane;
            self.padded.extend_from_slice(&values[there..][..plane]);
        }
        kernels.smoothing[2].apply(&self.padded, plane, &mut self.even);
        kernels.derivative[2].apply(&self.padded, plane, &mut self.odd);
        let nx = self.nx;
        let [smoothing, derivative] = [&kernels.smoothing[1], &kernels.derivative[1]];
        pad_with_ends(&mut self.padded, &self.even, nx, smoothing.reach());
        smoothing.apply(&self.padded, nx, &mut self.passes[0]);
        derivative.apply(&self.padded, nx, &mut self.passes[1]);
        pad_with_ends(&mut self.padded, &self.odd, nx, smoothing.reach());
        smoothing.apply(&self.padded, nx, &mut self.passes[2]);
        let [smoothing, derivative] = [&kernels.smoothing[0], &kernels.derivative[0]];
        let reach = smoothing.reach();
        for row in (0..plane).step_by(nx).map(|start| start..start + nx) {
            let [smooth, along_y, along_z] = self.passes.each_ref().map(|pass| &pass[row.clone()]);
            pad_with_ends(&mut self.padded, smooth, 1, reach);
            smoothing.apply(&self.padded, 1, &mut self.smooth[row.clone()]);
            derivative.apply(&self.padded, 1, &mut self.along[0][row.clone()]);
            pad_with_ends(&mut self.padded, along_y, 1, reach);
            smoothing.apply(&self.padded, 1, &mut self.along[1][row.clone()]);
            pad_with_ends(&mut self.padded, along_z, 1, reach);
            smoothing.apply(&self.padded, 1, &mut self.along[2][row]);
        }
    }
}

/// The kernels along the three axes.
struct Kernels {
    smoothing: [Kernel; 3],
    derivative: [Kernel; 3],
}

/// Rows of `stride` values, the first and the last repeated `reach` times.
fn pad_with_ends(padded: &mut Vec<f32>, rows: &[f32], stride: usize, reach: usize) {
    padded.clear();
    for _ in 0..reach {
        padded.extend_from_slice(&rows[..stride]);
    }
    padded.extend_from_slice(rows);
    for _ in 0..reach {
        padded.extend_from_slice(&rows[rows.len() - stride..]);
    }
}

/// The quadratic form from a gradient per voxel to a squared length per mm²: the coefficients of xx, yy, zz, xy, xz and
/// yz.
#[derive(Clone, Copy)]
struct Metric([f32; 6]);

impl Metric {
    fn of(block: &Block) -> Self {
        let axes = block.grid.patient_from_voxel().matrix3;
        let inverse: DMat3 = (axes.transpose() * axes).inverse();
        let at = |row: usize, column: usize| inverse.col(column)[row];
        let coefficients = [
            at(0, 0),
            at(1, 1),
            at(2, 2),
            2.0 * at(0, 1),
            2.0 * at(0, 2),
            2.0 * at(1, 2),
        ];
        Self(coefficients.map(|coefficient| coefficient as f32))
    }

    /// The squared length that white noise of unit variance adds across the direction of an edge: two thirds of the
    /// total.
    fn noise(self, kernels: &Kernels) -> f32 {
        let gain = |axis: usize| {
            let beside = (0..3).filter(|&other| other != axis);
            let beside: f64 = beside
                .map(|other| kernels.smoothing[other].noise_gain())
                .product();
            f64::from(self.0[axis]) * kernels.derivative[axis].noise_gain() * beside
        };
        ((gain(0) + gain(1) + gain(2)) * 2.0 / 3.0) as f32
    }
}

/// Converts derivatives to weights and weighted gradients.
struct Weigh {
    metric: Metric,
    /// The squared length to subtract for noise.
    noise: f32,
    /// The inverse of the half-width of the weight.
    per_half_width: f32,
}

/// The weights and weighted gradients of a plane, from its smoothed values and its derivatives.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "x86_64+sse4.1"))]
fn weigh_plane(weigh: &Weigh, zones: &[Zone], plane: &Plane, outs: [&mut [f32]; 2]) {
    let [xx, yy, zz, xy, xz, yz] = weigh.metric.0;
    let [weights, gradients] = outs;
    let [along_x, along_y, along_z] = plane.along.each_ref().map(|along| &along[..zones.len()]);
    let smooth = &plane.smooth[..zones.len()];
    let (weights, gradients) = (&mut weights[..zones.len()], &mut gradients[..zones.len()]);
    for place in 0..zones.len() {
        let (x, y, z) = (along_x[place], along_y[place], along_z[place]);
        let squared = x * x * xx + y * y * yy + z * z * zz + x * y * xy + x * z * xz + y * z * yz;
        let is_deep = zones[place] as u8 == Zone::Deep as u8;
        let weight = weight(smooth[place], weigh.per_half_width);
        let weight = if is_deep { weight } else { 0.0 };
        weights[place] = weight;
        gradients[place] = (squared - weigh.noise).max(0.0).sqrt() * weight;
    }
}

/// The weight of a tissue scale: 1 in the middle between grey and white, 0 from the half-width on (Tukey's biweight).
///
/// It is 0 in pure tissue, so that noise off the junction has no influence.
#[inline(always)]
pub(crate) fn weight(tissue: f32, per_half_width: f32) -> f32 {
    let apart = (tissue - 0.5) * per_half_width;
    let within = (1.0 - apart * apart).max(0.0);
    within * within
}
