//! The sharpness of the junction of grey and white matter.

use crate::block::{Block, Zone};
use crate::convolve::{Kernel, smooth_within};
use crate::gradient::Weighted;
use crate::regions::{Region, Regions};

/// The Gaussian that averages sharpness, in mm.
pub(crate) const WINDOW_MM: f64 = 2.5;
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
    /// The weights after the Gaussian of the window, in tissue; it has no meaning elsewhere.
    pub(crate) density: Vec<f32>,
    /// The voxels at which it is defined, ascending.
    pub(crate) defined: Vec<u32>,
    /// The voxels of the junction, a part of them, ascending.
    pub(crate) junction: Vec<u32>,
}

impl Sharpness {
    /// Keeps only the junction that counts, and returns the whole one; keeps all if none counts.
    pub(crate) fn count_only(&mut self, regions: &Regions) -> Vec<u32> {
        let counts = |voxel: &&u32| {
            let region = Region::from_code(regions.codes()[**voxel as usize]);
            region.is_none_or(Region::counts)
        };
        let counted: Vec<u32> = self.junction.iter().filter(counts).copied().collect();
        if counted.is_empty() {
            return self.junction.clone();
        }
        std::mem::replace(&mut self.junction, counted)
    }
}

/// The mean gradient around each voxel, weighted by nearness to the junction and by a Gaussian.
pub(crate) fn sharpness(block: &Block, weighted: Weighted) -> Sharpness {
    let Weighted {
        weights,
        gradients: mut values,
    } = weighted;
    let kernels = block.in_voxels(WINDOW_MM).map(Kernel::gaussian);
    let deep = block.spans(Zone::Deep);
    let mut density = weights.clone();
    let is_junction = |weight: &f32| f32::from(u8::from(*weight > JUNCTION_FROM));
    let mut near: Vec<f32> = weights.iter().map(is_junction).collect();
    rayon::join(
        || smooth_within(&mut values, &deep, &kernels),
        || {
            smooth_within(&mut density, &block.spans(Zone::Tissue), &kernels);
            smooth_within(&mut near, &deep, &kernels);
        },
    );
    let (mut defined, mut junction) = (Vec::new(), Vec::new());
    for (index, value) in values.iter_mut().enumerate() {
        let is_defined = block.zones[index] == Zone::Deep
            && density[index] > LEAST_WEIGHT
            && near[index] > LEAST_NEAR;
        *value = if is_defined {
            *value / density[index]
        } else {
            f32::NAN
        };
        if is_defined {
            defined.push(index as u32);
            if weights[index] > JUNCTION_FROM {
                junction.push(index as u32);
            }
        }
    }
    Sharpness {
        values,
        weights,
        density,
        defined,
        junction,
    }
}
