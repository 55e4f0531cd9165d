//! The density of voxels between grey and white matter.

use crate::block::{Block, Zone};
use crate::convolve::{Kernel, smooth_within};
use crate::tissue::TissueScale;

/// Edge of the cube, in mm.
const CUBE_MM: f64 = 5.0;

/// The fraction of a cube of 5 mm with intensities between mean grey + ½ SD and mean white − ½ SD.
///
/// It has no meaning in voxels that are not deep enough. Source: Huppertz et al., "Enhanced visualization of blurred gray-white
/// matter junctions in focal cortical dysplasia by voxel-based 3D MRI analysis", Epilepsy Research 67, 2005; there, the
/// mean of normal heads is subtracted; here it is not.
pub(crate) fn junction_density(block: &Block, values: &[f32], tissue: &TissueScale) -> Vec<f32> {
    let between = tissue.grey_sd / 2.0..1.0 - tissue.white_sd / 2.0;
    let is_deep = |zone: Zone| zone == Zone::Deep;
    let voxels = values.iter().zip(&block.zones);
    let mut density: Vec<f32> = voxels
        .map(|(value, &zone)| f32::from(u8::from(is_deep(zone) && between.contains(value))))
        .collect();
    let kernels = block.in_voxels(CUBE_MM).map(Kernel::mean);
    smooth_within(&mut density, &block.spans(Zone::Deep), &kernels);
    density
}
