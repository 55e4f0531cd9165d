//! All maps of a head. The widths of their filters belong to [`crate::MAP_FORMAT`].

use geometry::Grid;

use crate::MidsagittalPlane;
use crate::block::Block;
use crate::candidates::HeadDoubts;
use crate::candidates::{Candidate, Scores, candidates};
use crate::detail::detail;
use crate::gradient::weighted_gradient;
use crate::head::Head;
use crate::junction::junction_density;
use crate::mirror::{differences, intensity_differences};
use crate::regions::{Division, NoDivision, RegionDoubt, Regions, regions};
use crate::robust::Robust;
use crate::sharpness::{Sharpness, sharpness};
use crate::slant::{DepthBand, depth_bands};
use crate::stored::{MapKind, StoredMap};
use crate::thickness::Thickness;
use crate::tissue::{TissueScale, tissue_of};
use crate::undefined::MapsUndefined;
use crate::width::{WidthTable, width_table};

/// The least spread of sharpness, per mm, and of intensity, in tissue scale. A smaller spread is rounding, not anatomy.
///
/// Four real heads have 0.04 to 0.06 per mm, and 0.13 to 0.17.
const LEAST_SPREAD: f32 = 0.03;
/// The same for detail, of which four real heads have 0.019 to 0.025.
const LEAST_DETAIL_SPREAD: f32 = 0.01;
/// The same for the weighted mean of robust deviations, of which real heads have about 1.
const LEAST_MEAN_SPREAD: f32 = 0.5;

/// The share of detail in `blur`, 0 to 1; the rest is sharpness.
const DETAIL_SHARE: f32 = 0.7;

/// The maps of a head, with candidates and tissue parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Maps {
    grid: Grid,
    maps: Vec<StoredMap>,
    /// The most blurred places of the cerebrum, highest first.
    pub candidates: Vec<Candidate>,
    /// The most blurred places elsewhere, highest first.
    pub elsewhere: Vec<Candidate>,
    /// The places of the cerebrum with the thickest cortex compared with the other side, and those elsewhere; highest first.
    pub thick: [Vec<Candidate>; 2],
    /// The regions of the brain.
    pub regions: Regions,
    /// How slantwise isosurfaces meet the junction, by depth.
    pub depth_bands: Vec<DepthBand>,
    pub tissue: TissueScale,
    /// The table from sharpness to the width of a junction, for these voxels.
    pub widths: WidthTable,
    /// Why scores mean less than in other heads.
    pub doubts: HeadDoubts,
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

    /// All maps, in the order of [`MapKind::OF_HEAD`].
    pub fn into_maps(self) -> Vec<StoredMap> {
        self.maps
    }
}

/// Computes the maps of a head: the sharpness of its junction of grey and white matter, and where it is less sharp than
/// expected.
///
/// The statistics of the maps count the junction of the cerebrum alone, and so do the candidates, if its regions are not in
/// doubt. The maps depend on this head alone. They are on the block of its native grid that contains the brain; lengths are in
/// mm.
///
/// `doubt` is one about the regions of the brain that is known before, from its mask.
///
/// # Errors
/// If the voxels, the contrast or the envelope are unsuitable.
pub fn maps(head: Head<'_>, doubt: Option<RegionDoubt>) -> Result<Maps, MapsUndefined> {
    let (block, values, tissue) = tissue_of(head)?;
    let doubts = HeadDoubts::of(head, &block, &tissue)?;
    let regions = regions(head, &block, &values, doubt);
    let maps = maps_of(head, (block, values, tissue), regions);
    Ok(Maps { doubts, ..maps })
}

/// The maps of a head, and its parts, for which the same regions are found.
///
/// # Errors
/// As [`maps`]; the parts have their own reason.
pub fn maps_and_division(
    head: Head<'_>,
    doubt: Option<RegionDoubt>,
) -> Result<(Maps, Result<Division, NoDivision>), MapsUndefined> {
    let (block, values, tissue) = tissue_of(head)?;
    let doubts = HeadDoubts::of(head, &block, &tissue)?;
    let regions = regions(head, &block, &values, doubt);
    let division = Division::of(head, (&block, &values), &regions);
    let maps = maps_of(head, (block, values, tissue), regions);
    Ok((Maps { doubts, ..maps }, division))
}

fn maps_of(
    head: Head<'_>,
    (block, values, tissue): (Block, Vec<f32>, TissueScale),
    regions: Regions,
) -> Maps {
    let store = |kind, voxels: &[u32], values: &[f32]| {
        let values = voxels.iter().map(|&voxel| values[voxel as usize]);
        StoredMap::new(kind, &block.grid, voxels, values)
    };
    let deep = block.deep_voxels();
    let junction_density = junction_density(&block, &values, &tissue);
    let junction_map = store(MapKind::Junction, &deep, &junction_density);
    drop(junction_density);
    let mut intensities = intensity_differences(&block, &values, &deep, head.plane);
    let weighted = weighted_gradient(&block, &values, tissue.noise);
    let thickness = Thickness::new(&block, (&values, tissue.fluid), &weighted);
    let mut sharpness = sharpness(&block, weighted);
    let whole_junction = sharpness.count_only(&regions);
    let sharpness_map = store(MapKind::Sharpness, &sharpness.defined, &sharpness.values);
    let junction = places_among(&sharpness.junction, &deep);
    into_z(&mut intensities, &junction, LEAST_SPREAD);
    let intensity_map =
        StoredMap::new(MapKind::IntensityAsymmetry, &block.grid, &deep, intensities);
    drop((deep, junction));

    let detail = detail(&block, &values, &sharpness.density, tissue.noise);
    let depth_bands = depth_bands(head, &block, &values, &regions);
    drop(values);
    let measures = Measures {
        sharpness: &sharpness,
        detail,
    };
    let Comparison {
        mut blur,
        asymmetry,
    } = compare(&block, measures, head.plane);
    let defined = &sharpness.defined;
    let asymmetry_map = StoredMap::new(MapKind::Asymmetry, &block.grid, defined, asymmetry);
    let scores = Scores::smoothed(&block, &whole_junction, &mut blur);
    let blur_map = store(MapKind::Blur, defined, &blur);
    drop(blur);
    let [blurred, elsewhere] = candidates(&block, &scores, head, &regions, MapKind::Blur);
    drop(scores);
    let mut thick = compared_thickness(&block, &thickness, &sharpness, head.plane);
    drop(thickness);
    let scores = Scores::smoothed(&block, &whole_junction, &mut thick);
    let thickness_map = store(MapKind::Thickness, defined, &thick);
    let thick = candidates(&block, &scores, head, &regions, MapKind::Thickness);
    Maps {
        maps: vec![
            sharpness_map,
            junction_map,
            asymmetry_map,
            intensity_map,
            blur_map,
            thickness_map,
        ],
        candidates: blurred,
        elsewhere,
        thick,
        regions,
        depth_bands,
        tissue,
        widths: width_table(block.spacing_mm),
        doubts: HeadDoubts::default(),
        grid: block.grid,
    }
}

/// The score for a thick cortex at each voxel of a block, NaN where it is undefined.
pub(crate) fn compared_thickness(
    block: &Block,
    thickness: &Thickness,
    sharpness: &Sharpness,
    plane: &MidsagittalPlane,
) -> Vec<f32> {
    let voxels = &sharpness.defined;
    let junction = places_among(&sharpness.junction, voxels);
    let mut everywhere = vec![f32::NAN; block.voxel_count()];
    let at_voxels = thickness.compared(block, (voxels, &junction), plane);
    for (&voxel, value) in voxels.iter().zip(at_voxels) {
        everywhere[voxel as usize] = value;
    }
    everywhere
}

/// The measures of a head that a blurred junction lowers.
pub(crate) struct Measures<'a> {
    pub(crate) sharpness: &'a Sharpness,
    /// Detail around each voxel, in tissue scale.
    pub(crate) detail: Vec<f32>,
}

/// The measures compared with their surroundings and the other side.
pub(crate) struct Comparison {
    /// How far sharpness and detail are below their surroundings, or below the other side, whichever is less; in robust
    /// deviations. NaN where sharpness is undefined.
    pub(crate) blur: Vec<f32>,
    /// How far sharpness is above the other side, in robust deviations, at the voxels at which sharpness is defined.
    pub(crate) asymmetry: Vec<f32>,
}

/// Compares the junction of a head with its surroundings and with the other side.
pub(crate) fn compare(
    block: &Block,
    measures: Measures<'_>,
    plane: &MidsagittalPlane,
) -> Comparison {
    let Measures { sharpness, detail } = measures;
    let terms = Terms {
        spreads: [LEAST_SPREAD, LEAST_DETAIL_SPREAD],
        second_share: DETAIL_SHARE,
    };
    let voxels = &sharpness.defined;
    let measured = [&sharpness.values[..], &detail];
    let [lowered, asymmetry] = lowered(
        block,
        (voxels, &sharpness.junction),
        (measured, &sharpness.weights),
        plane,
        terms,
    );
    let mut everywhere = vec![f32::NAN; block.voxel_count()];
    for (&voxel, value) in voxels.iter().zip(lowered) {
        everywhere[voxel as usize] = value;
    }
    Comparison {
        blur: everywhere,
        asymmetry,
    }
}

/// How two measures become one deviation.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Terms {
    /// The least spread of each.
    pub(crate) spreads: [f32; 2],
    /// The share of the second one, 0 to 1.
    pub(crate) second_share: f32,
}

/// How far two measures are below their surroundings, or below the other side, whichever is less, at some voxels (ascending)
/// at which both are defined; in robust deviations over the junction, a part of these voxels. Then how far the first one is
/// above the other side.
pub(crate) fn lowered(
    block: &Block,
    (voxels, junction): (&[u32], &[u32]),
    measured: ([&[f32]; 2], &[f32]),
    plane: &MidsagittalPlane,
    terms: Terms,
) -> [Vec<f32>; 2] {
    let junction = places_among(junction, voxels);
    let [mut first, mut second] = differences(block, voxels, measured, plane);
    for (of_measure, least_spread) in [&mut first, &mut second].into_iter().zip(terms.spreads) {
        into_z(&mut of_measure.from_ring, &junction, least_spread);
        into_z(&mut of_measure.from_mirrored, &junction, least_spread);
    }
    let mean = |second: Vec<f32>, first: &[f32]| {
        let mut mean = second;
        for (mean, first) in mean.iter_mut().zip(first) {
            *mean = terms.second_share * *mean + (1.0 - terms.second_share) * first;
        }
        into_z(&mut mean, &junction, LEAST_MEAN_SPREAD);
        mean
    };
    let mut lowered = mean(second.from_ring, &first.from_ring);
    let from_mirrored = mean(second.from_mirrored, &first.from_mirrored);
    for (lowered, from_mirrored) in lowered.iter_mut().zip(from_mirrored) {
        // Without a mirrored value only the surroundings count: the minimum of a number and NaN is the number.
        *lowered = if lowered.is_nan() {
            *lowered
        } else {
            (-*lowered).min(-from_mirrored)
        };
    }
    [lowered, first.from_mirrored]
}

/// The places of some voxels among others, of which they are a part; both ascend.
fn places_among(part: &[u32], voxels: &[u32]) -> Vec<u32> {
    let mut places = (0..).zip(voxels);
    part.iter()
        .filter_map(|wanted| places.find(|(_, voxel)| *voxel == wanted))
        .map(|(place, _)| place)
        .collect()
}

/// Values as robust deviations from the values at the junction, by their places.
fn into_z(values: &mut [f32], junction: &[u32], least_spread: f32) {
    let at_junction = junction.iter().map(|&place| values[place as usize]);
    let robust = Robust::of(at_junction, least_spread);
    for value in values {
        *value = robust.z(*value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_of_the_voxels_is_found_among_them() {
        assert_eq!(places_among(&[4, 9, 12], &[1, 4, 7, 9, 12]), [1, 3, 4]);
        assert!(places_among(&[], &[1, 4]).is_empty());
    }
}
