//! The sharpness of the junction of grey and white matter.

use crate::block::{Block, Zone};
use crate::convolve::{Kernel, smooth};
use crate::gradient::Weighted;

/// The least weight around a voxel for its sharpness to be defined.
const LEAST_WEIGHT: f32 = 0.02;
/// The least weight of a voxel of the junction itself.
const JUNCTION_FROM: f32 = 0.6;
/// The least fraction of junction around a voxel for the maps to be defined. A straight junction reaches it up to about
/// 4 mm away; specks of noise in white matter never do.
const LEAST_NEAR: f32 = 0.08;

/// The sharpness of each voxel of a block, and the voxels of the junction.
pub(crate) struct Sharpness {
    /// The sharpness, per mm; NaN where it is undefined.
    pub(crate) values: Vec<f32>,
    /// The nearness of each voxel to the middle between grey and white, 0 to 1.
    pub(crate) weights: Vec<f32>,
    /// The weights after the Gaussian of the window.
    pub(crate) density: Vec<f32>,
    /// The voxels of the junction, ascending.
    pub(crate) junction: Vec<u32>,
}

/// The mean gradient around each voxel, weighted by nearness to the junction and by a Gaussian of `window_mm`.
pub(crate) fn sharpness(block: &Block, weighted: Weighted, window_mm: f64) -> Sharpness {
    let Weighted {
        weights,
        gradients: mut values,
    } = weighted;
    let kernels = block.in_voxels(window_mm).map(Kernel::gaussian);
    let mut density = weights.clone();
    let is_junction = |weight: &f32| f32::from(u8::from(*weight > JUNCTION_FROM));
    let mut near: Vec<f32> = weights.iter().map(is_junction).collect();
    rayon::join(
        || smooth(&mut values, block.size, &kernels),
        || {
            smooth(&mut density, block.size, &kernels);
            smooth(&mut near, block.size, &kernels);
        },
    );
    let mut junction = Vec::new();
    for (index, value) in values.iter_mut().enumerate() {
        let is_defined = block.zones[index] == Zone::Deep
            && density[index] > LEAST_WEIGHT
            && near[index] > LEAST_NEAR;
        *value = if is_defined {
            *value / density[index]
        } else {
            f32::NAN
        };
        if is_defined && weights[index] > JUNCTION_FROM {
            junction.push(index as u32);
        }
    }
    Sharpness {
        values,
        weights,
        density,
        junction,
    }
}
