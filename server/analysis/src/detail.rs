//! The fine detail of the intensities around the junction of grey and white matter.

use crate::block::{Block, Zone};
use crate::convolve::{Kernel, smooth_within};

/// The intensities of tissue, in tissue scale; fluid and vessels beyond them would outweigh every junction.
const TISSUE_RANGE: [f32; 2] = [-0.5, 1.5];
/// The least weight around a voxel; a voxel with a sharpness has more.
const LEAST_WEIGHT: f32 = 1e-6;

/// The Gaussians between which intensities are detail, in mm: what is finer is noise; what is coarser does not depend on the width of a
/// junction.
const BAND_MM: [f64; 2] = [0.5, 1.2];
/// The Gaussian that averages detail, in mm.
const WINDOW_MM: f64 = 2.0;

/// The standard deviation of the tissue scale between two Gaussians, in a window around each voxel, weighted by
/// nearness to the junction. The share of the noise is subtracted. It has no meaning in voxels that are not deep enough.
///
/// A blurred junction has less detail than a sharp one, whatever the direction of the junction and whether it is
/// straight or a thin fold, for which a mean gradient is small as well.
pub(crate) fn detail(block: &Block, values: &[f32], near_junction: &[f32], noise: f32) -> Vec<f32> {
    let [fine, coarse] = BAND_MM.map(|width_mm| block.in_voxels(width_mm).map(Kernel::gaussian));
    let noise = noise_in_band(&fine, &coarse) as f32 * noise * noise;
    let mut energy: Vec<f32> = (values.iter())
        .map(|value| value.clamp(TISSUE_RANGE[0], TISSUE_RANGE[1]))
        .collect();
    let mut coarser = energy.clone();
    let [tissue, deep] = [Zone::Tissue, Zone::Deep].map(|zone| block.spans(zone));
    rayon::join(
        || smooth_within(&mut energy, &tissue, &fine),
        || smooth_within(&mut coarser, &tissue, &coarse),
    );
    // From here on, the second buffer holds the weights.
    for (index, (energy, coarser)) in energy.iter_mut().zip(&mut coarser).enumerate() {
        let is_tissue = block.zones[index] >= Zone::Tissue;
        let weight = if is_tissue { near_junction[index] } else { 0.0 };
        *energy = (*energy - *coarser).powi(2) * weight;
        *coarser = weight;
    }
    let mut weights = coarser;
    let window = block.in_voxels(WINDOW_MM).map(Kernel::gaussian);
    rayon::join(
        || smooth_within(&mut energy, &deep, &window),
        || smooth_within(&mut weights, &deep, &window),
    );
    for (energy, weight) in energy.iter_mut().zip(&weights) {
        let variance = *energy / weight.max(LEAST_WEIGHT) - noise;
        *energy = variance.max(0.0).sqrt();
    }
    energy
}

/// The variance of white noise between two Gaussians, as a factor of its variance.
fn noise_in_band(fine: &[Kernel; 3], coarse: &[Kernel; 3]) -> f64 {
    let product = |a: &[Kernel; 3], b: &[Kernel; 3]| -> f64 {
        a.iter().zip(b).map(|(a, b)| a.shared_noise(b)).product()
    };
    product(fine, fine) - 2.0 * product(fine, coarse) + product(coarse, coarse)
}
