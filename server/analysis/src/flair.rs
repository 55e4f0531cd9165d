//! A FLAIR of the same head, compared with its surroundings and with the other side.
//!
//! Its intensities are averaged over the junction of grey and white matter and over the white matter below it. Both means are
//! compared by the rule of `blur`, with the opposite sign: a place is suspicious if it is brighter than its surroundings and than
//! the other side. Nothing here was tuned on acquired heads.

use geometry::Volume;
use glam::{DAffine3, DVec3, Vec3};

use crate::block::{Block, Zone};
use crate::candidates::{Candidate, Scores, candidates};
use crate::coarse::Coarse;
use crate::gradient::weighted_gradient;
use crate::maps::{Terms, lowered};
use crate::mirror::Places;
use crate::regions::{RegionDoubt, Regions, regions};
use crate::sharpness::{Sharpness, sharpness};
use crate::stored::{MapKind, StoredMap};
use crate::tissue::{TissueScale, tissue_of};
use crate::undefined::MapsUndefined;
use crate::{Head, MidsagittalPlane};

/// The largest voxel edge of the layer, in mm: beyond, a slice averages over more than a cortex and its white matter.
const MAX_SPACING_MM: f64 = 3.0;
/// The cell size of the means, in mm, and their Gaussian.
const STEP_MM: f64 = 2.0;
const WIDTH_MM: f64 = 3.0;
/// The cell size of the bias field, in mm, its Gaussian, and its limits relative to the mean of white matter.
const BIAS_STEP_MM: f64 = 5.0;
const BIAS_MM: f64 = 20.0;
const BIAS_RANGE: [f32; 2] = [0.5, 2.0];
/// The least share of white matter under that Gaussian.
const LEAST_FIELD: f32 = 1e-3;
/// White matter, in the tissue scale of the head.
const WHITE_FROM: f32 = 0.75;
/// Fluid, as a share of its mean in that scale.
const FLUID_SHARE: f32 = 0.7;
/// The fewest voxels of fluid that are compared with white matter.
const LEAST_FLUID: usize = 200;
/// The least share of junction and of white matter under the Gaussian of the means.
const LEAST_WEIGHT: f32 = 0.02;
/// The least share of the junction that the layer must show.
const LEAST_SHOWN: f32 = 0.5;
/// The share of the white matter below the junction; the rest is the junction itself.
const WHITE_SHARE: f32 = 0.5;
/// The least spread of both, in units of the mean of white matter. A smaller spread is rounding, not anatomy.
const LEAST_SPREAD: f32 = 0.01;
/// The stored value of undefined voxels.
const UNDEFINED: u16 = 0;

/// A FLAIR of a head.
#[derive(Debug, Clone, Copy)]
pub struct Flair<'a> {
    /// Its intensities on the grid of their acquisition; a stored 0 is undefined.
    pub volume: &'a Volume,
    /// Its place in the patient space of the head.
    pub case_from_layer: DAffine3,
}

/// The map of a FLAIR, and the places that it lists.
#[derive(Debug, Clone, PartialEq)]
pub struct FlairMap {
    /// How much brighter each place is than its surroundings and the other side, in robust deviations.
    pub map: StoredMap,
    /// The brightest places of the cerebrum, and those elsewhere; highest first.
    pub places: [Vec<Candidate>; 2],
    /// The regions of the brain.
    pub regions: Regions,
}

/// Why there is no map of a FLAIR.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FlairUndefined {
    /// The head has no maps.
    #[error(transparent)]
    OfHead(#[from] MapsUndefined),
    /// The voxels of the layer are too large.
    #[error(
        "the largest voxel spacing of the FLAIR is {largest_mm:.2} mm; its map needs at most 3.00 mm"
    )]
    CoarseVoxels {
        /// The largest edge of a voxel, in mm.
        largest_mm: f64,
    },
    /// It shows too little of the brain.
    #[error(
        "the FLAIR shows {percent:.0} % of the junction of grey and white matter; its map needs at least 50 %"
    )]
    ShowsTooLittle {
        /// The share of the junction, in percent.
        percent: f32,
    },
    /// White matter has no positive intensity.
    #[error(
        "white matter has no positive intensity in the FLAIR; its map needs intensities as the scanner gave them"
    )]
    NoSignal,
    #[error(
        "fluid is brighter than white matter in this layer; it is not a FLAIR. State its true `contrast`"
    )]
    BrightFluid,
}

impl FlairUndefined {
    /// The stable name, for programs and translations: `flair-coarse-voxels`.
    pub fn code(self) -> &'static str {
        match self {
            Self::OfHead(reason) => reason.code(),
            Self::CoarseVoxels { .. } => "flair-coarse-voxels",
            Self::ShowsTooLittle { .. } => "flair-shows-too-little",
            Self::NoSignal => "flair-no-signal",
            Self::BrightFluid => "flair-bright-fluid",
        }
    }
}

/// Computes the map of a FLAIR: where its intensities at the junction of grey and white matter and in the white matter below are
/// higher than around and than on the other side, whichever difference is less.
///
/// Junction, white matter and regions are those of the head itself. The map is on the block of the native grid of the head that
/// contains the brain.
///
/// # Errors
/// If the head has no maps, or the layer is unsuitable.
pub fn flair_map(
    head: Head<'_>,
    flair: Flair<'_>,
    doubt: Option<RegionDoubt>,
) -> Result<FlairMap, FlairUndefined> {
    let spacing_mm = flair.volume.grid().spacing_mm();
    let largest_mm = spacing_mm.into_iter().fold(0.0, f64::max);
    if largest_mm > MAX_SPACING_MM + 1e-6 {
        return Err(FlairUndefined::CoarseVoxels { largest_mm });
    }
    let (block, values, tissue) = tissue_of(head)?;
    let regions = regions(head, &block, &values, doubt);
    let weighted = weighted_gradient(&block, &values, tissue.noise);
    let mut sharpness = sharpness(&block, weighted);
    let whole_junction = sharpness.count_only(&regions);
    let mut intensities = intensities(&block, flair);
    check_extent(&intensities, &sharpness.junction)?;
    divide_by_bias(&mut intensities, &block, &values)?;
    check_fluid(&intensities, (&block, &values), &tissue)?;
    let compared = (&intensities[..], &values[..]);
    let mut map = bright(&block, compared, &sharpness, head.plane);
    drop((intensities, values));
    let scores = Scores::smoothed(&block, &whole_junction, &mut map);
    let defined = &sharpness.defined;
    let at_defined = defined.iter().map(|&voxel| map[voxel as usize]);
    let stored = StoredMap::new(MapKind::Flair, &block.grid, defined, at_defined);
    let places = candidates(&block, &scores, head, &regions, MapKind::Flair);
    Ok(FlairMap {
        map: stored,
        places,
        regions,
    })
}

/// The intensity of the layer at each voxel of tissue of the block; NaN elsewhere, and where the layer is undefined.
fn intensities(block: &Block, flair: Flair<'_>) -> Vec<f32> {
    let layer_from_voxel = flair.volume.grid().voxel_from_patient()
        * flair.case_from_layer.inverse()
        * block.grid.patient_from_voxel();
    let step = layer_from_voxel.matrix3.x_axis;
    let [nx, ny, _] = block.size;
    let mut intensities = vec![f32::NAN; block.voxel_count()];
    for (number, row) in intensities.chunks_exact_mut(nx).enumerate() {
        let start = DVec3::new(0.0, (number % ny) as f64, (number / ny) as f64);
        let start = layer_from_voxel.transform_point3(start);
        for (x, intensity) in row.iter_mut().enumerate() {
            if block.zones[number * nx + x] >= Zone::Tissue {
                let place = (start + step * x as f64).as_vec3();
                *intensity = intensity_at(flair.volume, place);
            }
        }
    }
    intensities
}

/// The intensity at a position in voxels, trilinear; NaN outside, and beside an undefined voxel.
fn intensity_at(volume: &Volume, place: Vec3) -> f32 {
    let size = volume.grid().size();
    let last = Vec3::from_array(size.map(|side| side as f32 - 1.0));
    let is_beside_undefined = || {
        let [low, high] = [place.floor(), place.ceil()].map(|end| end.clamp(Vec3::ZERO, last));
        (0..8).any(|corner| {
            let at = |axis: usize| {
                let end = if corner >> axis & 1 > 0 { high } else { low };
                end[axis] as usize
            };
            let index = volume.grid().index([at(0), at(1), at(2)]);
            volume.voxels()[index] == UNDEFINED
        })
    };
    match volume.sample(place) {
        Some(stored) if !is_beside_undefined() => volume.intensity(stored),
        _ => f32::NAN,
    }
}

/// Checks that the layer shows enough of the junction.
fn check_extent(intensities: &[f32], junction: &[u32]) -> Result<(), FlairUndefined> {
    let is_shown = |voxel: &&u32| !intensities[**voxel as usize].is_nan();
    let shown = junction.iter().filter(is_shown).count() as f32 / junction.len().max(1) as f32;
    if shown < LEAST_SHOWN {
        let percent = 100.0 * shown;
        return Err(FlairUndefined::ShowsTooLittle { percent });
    }
    Ok(())
}

/// Divides the intensities by the mean of white matter around each voxel, so that white matter is about 1 everywhere.
fn divide_by_bias(
    intensities: &mut [f32],
    block: &Block,
    tissue: &[f32],
) -> Result<(), FlairUndefined> {
    let coarse = Coarse::new(block.size, block.spacing_mm, BIAS_STEP_MM);
    let (mut total, mut count) = (0.0, 0.0_f64);
    let means = coarse.means(|index| {
        let intensity = intensities[index];
        if intensity.is_nan() || tissue[index] < WHITE_FROM {
            return [0.0; 2];
        }
        total += f64::from(intensity);
        count += 1.0;
        [intensity, 1.0]
    });
    let overall = (total / count) as f32;
    // Also if it shows no white matter.
    if overall.is_nan() || overall <= 0.0 {
        return Err(FlairUndefined::NoSignal);
    }
    let field = coarse.smoothed(&means, BIAS_MM);
    let [nx, _, _] = block.size;
    let (along_row, mut mixed) = (coarse.along_row(), Vec::new());
    for (number, row) in intensities.chunks_exact_mut(nx).enumerate() {
        coarse.mixed_row(&field, number, &mut mixed);
        for (intensity, along) in row.iter_mut().zip(&along_row) {
            let [sum, weight] = along.of_row(&mixed);
            let [least, most] = BIAS_RANGE.map(|share| share * overall);
            let white = if weight > LEAST_FIELD {
                (sum / weight).clamp(least, most)
            } else {
                overall
            };
            *intensity /= white;
        }
    }
    Ok(())
}

/// Checks that fluid is darker than white matter, which is 1.
fn check_fluid(
    intensities: &[f32],
    (block, tissue): (&Block, &[f32]),
    scale: &TissueScale,
) -> Result<(), FlairUndefined> {
    let voxels = intensities.iter().zip(tissue).zip(&block.zones);
    let in_fluid = voxels.filter_map(|((&intensity, &tissue), &zone)| {
        let is_fluid = zone == Zone::Deep && tissue < FLUID_SHARE * scale.fluid;
        (is_fluid && !intensity.is_nan()).then_some(f64::from(intensity))
    });
    let (sum, count) = in_fluid.fold((0.0, 0), |(sum, count), value| (sum + value, count + 1));
    if count >= LEAST_FLUID && sum / count as f64 > 1.0 {
        return Err(FlairUndefined::BrightFluid);
    }
    Ok(())
}

/// How much brighter each voxel of the block is than around it and than the other side, in robust deviations over the junction
/// that counts; NaN where it is undefined.
fn bright(
    block: &Block,
    (intensities, tissue): (&[f32], &[f32]),
    sharpness: &Sharpness,
    plane: &MidsagittalPlane,
) -> Vec<f32> {
    let coarse = Coarse::new(block.size, block.spacing_mm, STEP_MM);
    let means = coarse.means(|index| {
        let intensity = intensities[index];
        if intensity.is_nan() {
            return [0.0; 4];
        }
        let weight = sharpness.weights[index];
        let white = f32::from(u8::from(tissue[index] >= WHITE_FROM));
        [intensity * weight, weight, intensity * white, white]
    });
    let smoothed = coarse.smoothed(&means, WIDTH_MM);
    // Of opposite sign, because the rule looks for what is lower.
    let mut measures = [0; 2].map(|_| vec![f32::NAN; block.voxel_count()]);
    let mut defined = Vec::with_capacity(sharpness.defined.len());
    let places = Places::new(block, &coarse, plane);
    places.visit(
        &sharpness.defined,
        &smoothed,
        |index, [junction, weight, white, white_weight], _| {
            if weight > LEAST_WEIGHT && white_weight > LEAST_WEIGHT {
                measures[0][index] = -junction / weight;
                measures[1][index] = -white / white_weight;
                defined.push(index as u32);
            }
        },
    );
    let is_shown = |voxel: &&u32| !measures[0][**voxel as usize].is_nan();
    let junction: Vec<u32> = sharpness
        .junction
        .iter()
        .filter(is_shown)
        .copied()
        .collect();
    let terms = Terms {
        spreads: [LEAST_SPREAD; 2],
        second_share: WHITE_SHARE,
    };
    let [first, second] = &measures;
    let [bright, _] = lowered(
        block,
        (&defined, &junction),
        ([first, second], &sharpness.weights),
        plane,
        terms,
    );
    let mut everywhere = vec![f32::NAN; block.voxel_count()];
    for (&voxel, value) in defined.iter().zip(bright) {
        everywhere[voxel as usize] = value;
    }
    everywhere
}

#[cfg(test)]
mod tests {
    use std::sync::OnceLock;

    use geometry::{Grid, Rescale};

    use super::*;
    use crate::phantom::{Scan, turned};
    use crate::regions::phantom::{BrainPhantom, SimulatedLayer, grid};

    /// The head, scanned once.
    fn head() -> &'static Scan {
        static HEAD: OnceLock<Scan> = OnceLock::new();
        HEAD.get_or_init(|| BrainPhantom::PLAIN.scan(&grid()))
    }

    /// The map of a layer whose space is that of the head turned and moved.
    fn of_layer(layer: SimulatedLayer) -> Result<FlairMap, FlairUndefined> {
        let case_from_layer = turned(6.0, -4.0, DVec3::new(5.0, -8.0, 3.0));
        let layer = SimulatedLayer {
            case_from_layer,
            ..layer
        };
        of_volume(&BrainPhantom::PLAIN.other_contrast(&layer), case_from_layer)
    }

    fn of_volume(volume: &Volume, case_from_layer: DAffine3) -> Result<FlairMap, FlairUndefined> {
        let flair = Flair {
            volume,
            case_from_layer,
        };
        flair_map(head().head(), flair, None)
    }

    #[test]
    fn a_bright_place_comes_first_in_two_contrasts_and_at_two_resolutions() {
        for contrast in [SimulatedLayer::FLAIR, SimulatedLayer::WEAK_FLAIR] {
            for spacing_mm in [[1.5; 3], [1.5, 1.5, 3.0]] {
                let sound = SimulatedLayer {
                    spacing_mm,
                    ..contrast
                };
                let ill = SimulatedLayer {
                    brighter: 0.25,
                    ..sound
                };
                let [sound, ill] = [sound, ill].map(|layer| of_layer(layer).unwrap());
                let [highest, first] = [&sound, &ill].map(|map| map.places[0][0]);
                println!("{spacing_mm:?}: {} and {}", highest.score, first.score);
                let away_mm = first.position_in_patient.distance(contrast.lesion.0);
                assert!(away_mm < 9.0, "{away_mm} mm away");
                assert!(first.score > highest.score + 0.8, "{}", first.score);
                assert_eq!([highest, first].map(|place| place.unusual), [None; 2]);
                assert_eq!(sound.map.grid(), ill.map.grid());
            }
        }
    }

    #[test]
    fn a_darker_place_is_not_suspicious() {
        let layer = SimulatedLayer {
            spacing_mm: [2.0; 3],
            brighter: -0.25,
            ..SimulatedLayer::FLAIR
        };
        let dark = of_layer(layer).unwrap();
        let lesion = layer.lesion.0;
        let near = |place: &&Candidate| place.position_in_patient.distance(lesion) < 9.0;
        assert_eq!(dark.places[0].iter().take(20).find(near), None);
    }

    #[test]
    fn what_is_no_flair_or_shows_too_little_has_no_map_and_a_reason() {
        let code = |found: Result<FlairMap, FlairUndefined>| found.unwrap_err().code();
        let with = |spacing_mm, layer| SimulatedLayer {
            spacing_mm,
            ..layer
        };
        let thick = of_layer(with([1.5, 1.5, 3.1], SimulatedLayer::FLAIR));
        assert_eq!(code(thick), "flair-coarse-voxels");
        let t2 = of_layer(with([2.0; 3], SimulatedLayer::T2));
        assert_eq!(code(t2), "flair-bright-fluid");
        let layer = with([2.0; 3], SimulatedLayer::FLAIR);
        let volume = BrainPhantom::PLAIN.other_contrast(&layer);
        let away = DAffine3::from_translation(DVec3::new(0.0, 110.0, 0.0));
        assert_eq!(code(of_volume(&volume, away)), "flair-shows-too-little");
        let rescale = Rescale {
            slope: 1.0,
            intercept: -5000.0,
        };
        let negative = Volume::new(volume.grid().clone(), volume.voxels().to_vec(), rescale);
        let negative = of_volume(&negative.unwrap(), DAffine3::IDENTITY);
        assert_eq!(code(negative), "flair-no-signal");
    }

    #[test]
    fn nothing_is_known_beside_undefined_voxels() {
        let grid = Grid::aligned([4; 3], [1.0; 3], DVec3::ZERO).unwrap();
        let mut voxels = vec![7; 64];
        voxels[grid.index([1, 1, 1])] = UNDEFINED;
        let rescale = Rescale {
            slope: 2.0,
            intercept: 1.0,
        };
        let volume = Volume::new(grid, voxels, rescale).unwrap();
        let at = |place: f32| intensity_at(&volume, Vec3::splat(place));
        assert!(at(1.5).is_nan() && at(1.0).is_nan() && at(-2.0).is_nan());
        assert_eq!([at(2.0), at(2.5), at(3.2)], [15.0; 3]);
    }
}
