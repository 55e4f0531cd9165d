//! Whether the parts of a brain are to be believed.

use glam::DVec3;

use super::deep::DEEP;
use super::lattice::CELL_ML;
use super::parts::{CEREBELLUM, CEREBRUM, Parts, STEM};
use super::{Lattice, Sheet};
use crate::Head;

/// The shares of the cerebellum and of the brain stem of a brain, as volumes. Six heads have 0.103 to 0.118 and 0.021 to
/// 0.030.
const CEREBELLUM_SHARE: [f64; 2] = [0.07, 0.16];
const STEM_SHARE: [f64; 2] = [0.010, 0.050];
/// The least volume of the smaller half relative to the larger one. Six heads have at least 0.91 (cerebellum) and 0.97.
const CEREBELLUM_SYMMETRY: f64 = 0.75;
const CEREBRUM_SYMMETRY: f64 = 0.88;
/// The share of what is no cortex of the cerebrum, as volumes. Six heads have 0.041 to 0.054.
const DEEP_SHARE: [f64; 2] = [0.015, 0.12];
/// The least volume of its smaller half relative to the larger one. Six heads have at least 0.84.
const DEEP_SYMMETRY: f64 = 0.6;
/// The least cross-section of the neck, in cm². Six heads have at least 5.
const LEAST_NECK_CM2: f64 = 2.0;
/// The least width of the pons relative to the neck above it. Six heads have at least 1.7.
const PONS_TO_NECK: f64 = 1.15;
/// The least volume of each group of seeds, in ml. Six heads have at least 3.
const LEAST_SEEDS_ML: f64 = 1.0;
/// The greatest share of the border between cerebrum and cerebellum that is white matter.
const BRIGHT_SHARE: f64 = 0.2;
/// The tissue scale from which that border is white matter.
const BRIGHT_FROM: f32 = 0.5;
/// The greatest share of the cerebellum that lies within this distance of a cut of the volume.
const NEAR_CUT_SHARE: f64 = 0.01;
const NEAR_CUT_MM: f64 = 4.0;
/// The largest voxel spacing at which the tentorium is seen, in mm.
const MAX_SPACING_MM: f64 = 2.5;
/// The least share of the sheet between the hemispheres that lies in a fissure. Six heads have at least 0.76.
const FISSURE_SHARE: f64 = 0.4;

/// The least width of a brain relative to its length, as deviations of its cells. Six heads have 0.74 to 0.86, halves of one of them 0.39
/// and 0.41.
const LEAST_WIDTH: f64 = 0.55;

/// The measures of the parts of a brain.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RegionNumbers {
    /// The volumes inside the envelope, in ml.
    pub cerebrum_ml: f64,
    pub cerebellum_ml: f64,
    /// Of the brain stem, below its narrowest place.
    pub brain_stem_ml: f64,
    /// The smaller half of the cerebellum over the larger one, by volume.
    pub cerebellum_symmetry: f64,
    /// The smaller half of the cerebrum over the larger one, by volume.
    pub cerebrum_symmetry: f64,
    /// What is no cortex within the cerebrum, in ml, without the rim of the cut.
    pub deep_ml: f64,
    /// The smaller half of that over the larger one.
    pub deep_symmetry: f64,
    /// The cross-section of the brain stem where it is narrowest, in cm².
    pub neck_cm2: f64,
    /// The cross-section of the pons.
    pub pons_cm2: f64,
    /// The share of the border between cerebrum and cerebellum that is as bright as white matter.
    pub bright_share: f64,
    /// The share of the sheet between the hemispheres, within the envelope, that lies in a fissure.
    pub fissure_share: f64,
}

/// Why the parts of a brain are not to be believed.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RegionDoubt {
    /// The brain is too narrow for two hemispheres.
    #[error("the brain is only {:.0} % as wide as it is long, and at least 55 % are expected: one hemisphere seems to be missing", 100.0 * .width)]
    OneHemisphere {
        /// Its width over its length.
        width: f64,
    },
    /// The voxels are too large to show the tentorium.
    #[error(
        "the largest voxel spacing is {largest_mm:.2} mm; the tentorium is seen with at most 2.50 mm"
    )]
    CoarseVoxels {
        /// The largest edge of a voxel, in mm.
        largest_mm: f64,
    },
    /// The mask was not found by the network or supplied by a person.
    #[error("the brain mask was found by tree pruning, which is not certain below the tentorium")]
    PrunedMask,
    /// The brain has no axes.
    #[error("the axes of the brain are not determined")]
    NoAxes,
    /// A part of the brain is not where it should be.
    #[error("no white matter was found where the {part} should be")]
    NoSeeds { part: &'static str },
    /// The cerebellum is too small or too large.
    #[error("the cerebellum would be {:.1} % of the brain; 7 to 16 % are expected", 100.0 * .share)]
    CerebellumVolume { share: f64 },
    /// The brain stem is too small or too large.
    #[error("the brain stem would be {:.1} % of the brain; 1 to 5 % are expected", 100.0 * .share)]
    StemVolume { share: f64 },
    /// The halves of the cerebellum differ too much.
    #[error("one half of the cerebellum would be {:.0} % of the other; at least 75 % are expected", 100.0 * .symmetry)]
    CerebellumAsymmetric {
        /// The smaller half over the larger one.
        symmetry: f64,
    },
    /// The halves of the cerebrum differ too much: one is missing or deformed.
    #[error("one half of the cerebrum would be {:.0} % of the other; at least 88 % are expected", 100.0 * .symmetry)]
    CerebrumAsymmetric {
        /// The smaller half over the larger one.
        symmetry: f64,
    },
    /// Nuclei and ventricles are too small or too large.
    #[error("nuclei and ventricles would be {:.1} % of the cerebrum; 1.5 to 12 % are expected", 100.0 * .share)]
    DeepVolume { share: f64 },
    /// Nuclei and ventricles of the two sides differ too much.
    #[error("nuclei and ventricles of one side would be {:.0} % of those of the other; at least 60 % are expected", 100.0 * .symmetry)]
    DeepAsymmetric {
        /// The smaller side over the larger one.
        symmetry: f64,
    },
    /// The brain stem has no narrow place above the pons.
    #[error("the brain stem has no narrow place above the pons")]
    NoNeck,
    /// The cut runs through white matter.
    #[error("{:.0} % of the border of the cerebellum would be white matter; at most 20 % are expected", 100.0 * .share)]
    BrightBorder { share: f64 },
    /// The volume ends within the cerebellum.
    #[error("the volume ends within the cerebellum")]
    Cut,
    /// No fissure between the hemispheres was found.
    #[error("only {:.0} % of the sheet between the hemispheres lie in a fissure; at least 40 % are expected", 100.0 * .share)]
    NoFissure { share: f64 },
}

impl RegionDoubt {
    /// The stable name, for programs and translations: `cerebellum-volume`.
    pub fn code(self) -> &'static str {
        match self {
            Self::OneHemisphere { .. } => "one-hemisphere",
            Self::CoarseVoxels { .. } => "regions-coarse-voxels",
            Self::PrunedMask => "regions-pruned-mask",
            Self::NoAxes => "regions-no-axes",
            Self::NoSeeds { .. } => "regions-no-seeds",
            Self::CerebellumVolume { .. } => "cerebellum-volume",
            Self::StemVolume { .. } => "brain-stem-volume",
            Self::CerebellumAsymmetric { .. } => "cerebellum-asymmetric",
            Self::CerebrumAsymmetric { .. } => "cerebrum-asymmetric",
            Self::DeepVolume { .. } => "deep-volume",
            Self::DeepAsymmetric { .. } => "deep-asymmetric",
            Self::NoNeck => "brain-stem-no-neck",
            Self::BrightBorder { .. } => "cerebellum-bright-border",
            Self::Cut => "cerebellum-cut",
            Self::NoFissure { .. } => "no-fissure",
        }
    }
}

/// The first doubt about the voxels.
pub(super) fn of_voxels(head: Head<'_>) -> Option<RegionDoubt> {
    let spacing_mm = head.volume.grid().spacing_mm();
    let largest_mm = spacing_mm.into_iter().fold(0.0, f64::max);
    (largest_mm > MAX_SPACING_MM).then_some(RegionDoubt::CoarseVoxels { largest_mm })
}

/// The doubt that explains all others of half a brain.
pub(super) fn one_hemisphere(lattice: &Lattice) -> Option<RegionDoubt> {
    let inside = lattice
        .depths
        .iter()
        .enumerate()
        .filter(|(_, depth)| **depth >= 0.0);
    let (mut count, mut sum, mut squares) = (0u32, DVec3::ZERO, DVec3::ZERO);
    for (index, _) in inside {
        let place = lattice.position(index);
        count += 1;
        sum += place;
        squares += place * place;
    }
    let mean = sum / f64::from(count.max(1));
    let variance = squares / f64::from(count.max(1)) - mean * mean;
    let width = (variance.x / variance.y).sqrt();
    (width < LEAST_WIDTH).then_some(RegionDoubt::OneHemisphere { width })
}

pub(super) fn measure(
    lattice: &Lattice,
    (parts, deep): (&Parts, &[u8]),
    sheet: &Sheet,
) -> RegionNumbers {
    /// The place of the deep cells among the counts, after those of the parts.
    const ALSO_DEEP: u8 = STEM + 1;
    let mut counts = [[0u32; 2]; ALSO_DEEP as usize + 1];
    for (index, (&mark, &deep)) in parts.marks.iter().zip(deep).enumerate() {
        if (CEREBRUM..=STEM).contains(&mark) {
            let on_right = usize::from(sheet.left_of(lattice.position(index)) < 0.0);
            counts[usize::from(mark)][on_right] += 1;
            counts[usize::from(ALSO_DEEP)][on_right] += u32::from(deep == DEEP);
        }
    }
    let ml = |mark: u8| counts[usize::from(mark)].map(|count| f64::from(count) * CELL_ML);
    let whole = |mark: u8| ml(mark).iter().sum::<f64>();
    let symmetry = |mark: u8| {
        let [left, right] = ml(mark);
        left.min(right) / left.max(right).max(CELL_ML)
    };
    RegionNumbers {
        cerebrum_ml: whole(CEREBRUM),
        cerebellum_ml: whole(CEREBELLUM),
        brain_stem_ml: whole(STEM),
        cerebellum_symmetry: symmetry(CEREBELLUM),
        cerebrum_symmetry: symmetry(CEREBRUM),
        deep_ml: whole(ALSO_DEEP),
        deep_symmetry: symmetry(ALSO_DEEP),
        neck_cm2: parts.neck_cm2,
        pons_cm2: parts.pons_cm2,
        bright_share: bright_share(lattice, parts),
        fissure_share: sheet.fissure_share(),
    }
}

/// The share of the faces between cerebrum and cerebellum whose darker side is white matter.
fn bright_share(lattice: &Lattice, parts: &Parts) -> f64 {
    let (mut faces, mut bright) = (0u32, 0u32);
    let [nx, ny, nz] = lattice.size;
    for (index, &mark) in parts.marks.iter().enumerate() {
        if mark != CEREBRUM && mark != CEREBELLUM {
            continue;
        }
        let [x, y, z] = lattice.cell(index);
        let after = [(x + 1 < nx, 1), (y + 1 < ny, nx), (z + 1 < nz, nx * ny)];
        for (_, stride) in after.into_iter().filter(|(is_there, _)| *is_there) {
            let other = index + stride;
            let is_border =
                parts.marks[other] != mark && matches!(parts.marks[other], CEREBRUM | CEREBELLUM);
            if is_border {
                faces += 1;
                let darker = lattice.values[index].min(lattice.values[other]);
                bright += u32::from(darker > BRIGHT_FROM);
            }
        }
    }
    f64::from(bright) / f64::from(faces.max(1))
}

/// Everything that is not as expected.
pub(super) fn doubts(
    head: Head<'_>,
    lattice: &Lattice,
    parts: &Parts,
    numbers: &RegionNumbers,
) -> Vec<RegionDoubt> {
    let whole_ml = numbers.cerebrum_ml + numbers.cerebellum_ml + numbers.brain_stem_ml;
    let cerebellum = numbers.cerebellum_ml / whole_ml;
    let stem = numbers.brain_stem_ml / whole_ml;
    let deep = numbers.deep_ml / numbers.cerebrum_ml;
    let names = [
        "cerebrum",
        "cerebrum",
        "cerebellum",
        "cerebellum",
        "brain stem",
    ];
    let missing = parts
        .seeds_ml
        .iter()
        .zip(names)
        .find(|(ml, _)| **ml < LEAST_SEEDS_ML);
    let is_outside = |value: f64, [least, most]: [f64; 2]| !(least..=most).contains(&value);
    let has_neck =
        numbers.neck_cm2 >= LEAST_NECK_CM2 && numbers.pons_cm2 >= PONS_TO_NECK * numbers.neck_cm2;
    let (asymmetric, uneven) = (numbers.cerebellum_symmetry, numbers.cerebrum_symmetry);
    let doubts = [
        missing.map(|(_, part)| RegionDoubt::NoSeeds { part }),
        is_outside(cerebellum, CEREBELLUM_SHARE)
            .then_some(RegionDoubt::CerebellumVolume { share: cerebellum }),
        is_outside(stem, STEM_SHARE).then_some(RegionDoubt::StemVolume { share: stem }),
        (asymmetric < CEREBELLUM_SYMMETRY).then_some(RegionDoubt::CerebellumAsymmetric {
            symmetry: asymmetric,
        }),
        (uneven < CEREBRUM_SYMMETRY)
            .then_some(RegionDoubt::CerebrumAsymmetric { symmetry: uneven }),
        is_outside(deep, DEEP_SHARE).then_some(RegionDoubt::DeepVolume { share: deep }),
        (numbers.deep_symmetry < DEEP_SYMMETRY).then_some(RegionDoubt::DeepAsymmetric {
            symmetry: numbers.deep_symmetry,
        }),
        (!has_neck).then_some(RegionDoubt::NoNeck),
        (numbers.bright_share > BRIGHT_SHARE).then_some(RegionDoubt::BrightBorder {
            share: numbers.bright_share,
        }),
        is_cut(head, lattice, parts).then_some(RegionDoubt::Cut),
        (numbers.fissure_share < FISSURE_SHARE).then_some(RegionDoubt::NoFissure {
            share: numbers.fissure_share,
        }),
    ];
    doubts.into_iter().flatten().collect()
}

/// Whether the volume ends within the cerebellum.
fn is_cut(head: Head<'_>, lattice: &Lattice, parts: &Parts) -> bool {
    let cuts = head.depth.cuts();
    if cuts.is_empty() {
        return false;
    }
    let (mut cells, mut near) = (0u32, 0u32);
    for (index, _) in parts
        .marks
        .iter()
        .enumerate()
        .filter(|(_, mark)| **mark == CEREBELLUM)
    {
        let place = lattice
            .patient_from_head
            .transform_point3(lattice.position(index));
        cells += 1;
        near += u32::from(cuts.iter().any(|cut| cut.distance_mm(place) < NEAR_CUT_MM));
    }
    f64::from(near) > NEAR_CUT_SHARE * f64::from(cells)
}
