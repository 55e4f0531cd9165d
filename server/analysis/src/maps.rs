//! All maps of a head.

use geometry::Grid;

use crate::MidsagittalPlane;
use crate::block::Block;
use crate::candidates::{Candidate, Choice, Scores, candidates};
use crate::gradient::{Slope, weighted_gradient};
use crate::head::Head;
use crate::junction::junction_density;
use crate::mirror::{Differences, Widths, differences, intensity_differences};
use crate::robust::Robust;
use crate::sharpness::{Sharpness, sharpness};
use crate::stored::{MapKind, StoredMap};
use crate::tissue::{TissueScale, tissue_scale};
use crate::undefined::MapsUndefined;
use crate::width::{EdgeFilters, WidthTable};

/// The largest voxel edge at which a blur of 1 to 2 mm is visible, in mm.
const MAX_SPACING_MM: f64 = 2.0;
/// The least spread of sharpness, per mm, and of intensity, in tissue scale. A smaller spread is rounding, not anatomy.
///
/// Four real heads have 0.04 to 0.06 per mm, and 0.13 to 0.17.
const LEAST_SPREAD: f32 = 0.025;

/// Widths of all filters. The standard ones belong to [`crate::MAP_FORMAT`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapParameters {
    /// The Gaussian for the derivatives, in mm; at least 0.6 of the largest voxel edge.
    pub gradient_mm: f64,
    /// The greatest distance from the middle between grey and white at which a voxel counts, in tissue scale.
    pub half_width: f32,
    /// The Gaussian that averages sharpness, in mm.
    pub window_mm: f64,
    /// The Gaussian of the surroundings, in mm.
    pub ring_mm: f64,
    /// The Gaussian that smooths the mirrored side, in mm.
    pub mirrored_mm: f64,
    /// The Gaussian that smooths intensities on both sides, in mm.
    pub intensity_mm: f64,
    /// The Gaussian that smooths `blur` before candidates are chosen, in mm.
    pub candidate_mm: f64,
    /// The least distance between two candidates, in mm.
    pub apart_mm: f64,
    /// The greatest number of candidates.
    pub candidate_limit: usize,
}

impl MapParameters {
    /// The standard parameters, for the maps of every case.
    pub const STANDARD: Self = Self {
        gradient_mm: 0.65,
        half_width: 0.5,
        window_mm: 2.5,
        ring_mm: 8.0,
        mirrored_mm: 3.0,
        intensity_mm: 4.0,
        candidate_mm: 2.5,
        apart_mm: 10.0,
        candidate_limit: 60,
    };
}

/// The maps of a head, with candidates and tissue parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Maps {
    grid: Grid,
    maps: Vec<StoredMap>,
    /// The most blurred places, highest first.
    pub candidates: Vec<Candidate>,
    /// The tissue scale.
    pub tissue: TissueScale,
    /// The table from sharpness to the width of a junction, for these voxels.
    pub widths: WidthTable,
}

impl Maps {
    /// The grid of the maps: the block of the grid of the volume that contains the brain.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// One of the maps.
    pub fn map(&self, kind: MapKind) -> &StoredMap {
        &self.maps[kind as usize]
    }

    /// All maps, in the order of [`MapKind::ALL`].
    pub fn into_maps(self) -> Vec<StoredMap> {
        self.maps
    }
}

/// Computes the maps of a head: the sharpness of its junction of grey and white matter, and where it is less sharp than
/// expected.
///
/// The maps depend on this head alone. They are on the block of its native grid that contains the brain; lengths are in
/// mm.
///
/// # Errors
/// If the voxels, the contrast or the envelope are unsuitable.
pub fn maps(head: Head<'_>, parameters: &MapParameters) -> Result<Maps, MapsUndefined> {
    let (block, values, tissue) = tissue_of(head)?;
    let store = |kind, values: &[f32]| StoredMap::new(kind, &block.grid, values.iter().copied());

    let junction_map = store(
        MapKind::Junction,
        &junction_density(&block, &values, &tissue),
    );
    let mut intensities =
        intensity_differences(&block, &values, head.plane, parameters.intensity_mm);
    let weighted = weighted_gradient(&block, &values, parameters.slope(&tissue));
    drop(values);

    let sharpness = sharpness(&block, weighted, parameters.window_mm);
    let sharpness_map = store(MapKind::Sharpness, &sharpness.values);
    into_z(&mut intensities, &sharpness.junction);
    let intensity_map = store(MapKind::IntensityAsymmetry, &intensities);
    drop(intensities);

    let Comparison { blur, asymmetry } = compare(&block, &sharpness, head.plane, parameters);
    let asymmetry_map = store(MapKind::Asymmetry, &asymmetry);
    drop(asymmetry);
    let blur_map = store(MapKind::Blur, &blur);
    let scores = Scores::smoothed(&block, &sharpness.junction, &blur, parameters.candidate_mm);
    let candidates = candidates(&block, &scores, head, parameters.choice());
    Ok(Maps {
        maps: vec![
            sharpness_map,
            junction_map,
            asymmetry_map,
            intensity_map,
            blur_map,
        ],
        candidates,
        tissue,
        widths: parameters.width_table(block.spacing_mm),
        grid: block.grid,
    })
}

/// The block of a head, its tissue scale and its parameters.
pub(crate) fn tissue_of(head: Head<'_>) -> Result<(Block, Vec<f32>, TissueScale), MapsUndefined> {
    let spacing_mm = head.volume.grid().spacing_mm();
    let largest_mm = spacing_mm.into_iter().fold(0.0, f64::max);
    if largest_mm > MAX_SPACING_MM + 1e-6 {
        return Err(MapsUndefined::CoarseVoxels { largest_mm });
    }
    let block = Block::new(head.volume, head.depth).ok_or(MapsUndefined::NothingDeep)?;
    let (values, tissue) = tissue_scale(head.volume, &block)?;
    Ok((block, values, tissue))
}

/// Sharpness compared with its surroundings and the other side; NaN where sharpness is undefined.
pub(crate) struct Comparison {
    /// How far sharpness is below its surroundings, or below the other side, whichever is less; in robust deviations.
    pub(crate) blur: Vec<f32>,
    /// How far sharpness is above the other side, in robust deviations.
    pub(crate) asymmetry: Vec<f32>,
}

/// Compares the sharpness of a head with its surroundings and with the other side.
pub(crate) fn compare(
    block: &Block,
    sharpness: &Sharpness,
    plane: &MidsagittalPlane,
    parameters: &MapParameters,
) -> Comparison {
    let widths = Widths {
        ring_mm: parameters.ring_mm,
        mirrored_mm: parameters.mirrored_mm,
    };
    let Differences {
        from_ring: mut blur,
        from_mirrored: mut asymmetry,
    } = differences(block, sharpness, plane, widths);
    into_z(&mut blur, &sharpness.junction);
    into_z(&mut asymmetry, &sharpness.junction);
    for (blur, &asymmetry) in blur.iter_mut().zip(&asymmetry) {
        // Without a mirrored value only the surroundings count: the minimum of a number and NaN is the number.
        *blur = if blur.is_nan() {
            *blur
        } else {
            (-*blur).min(-asymmetry)
        };
    }
    Comparison { blur, asymmetry }
}

/// Values as robust deviations from the values at the junction.
fn into_z(values: &mut [f32], junction: &[u32]) {
    let at_junction = junction.iter().map(|&voxel| values[voxel as usize]);
    let robust = Robust::of(at_junction, LEAST_SPREAD);
    for value in values {
        *value = robust.z(*value);
    }
}

impl MapParameters {
    pub(crate) fn choice(&self) -> Choice {
        Choice {
            apart_mm: self.apart_mm,
            limit: self.candidate_limit,
        }
    }

    pub(crate) fn slope(&self, tissue: &TissueScale) -> Slope {
        Slope {
            sigma_mm: self.gradient_mm,
            half_width: self.half_width,
            noise: tissue.noise,
        }
    }

    /// From sharpness to the width of a junction, for voxels of these edges.
    pub fn width_table(&self, spacing_mm: [f64; 3]) -> WidthTable {
        WidthTable::new(EdgeFilters {
            gradient_mm: Slope::sigma_for(self.gradient_mm, spacing_mm),
            half_width: self.half_width,
            window_mm: self.window_mm,
        })
    }
}
