//! The most blurred places of the junction.

use std::collections::HashSet;

use glam::DVec3;

use crate::block::{Block, Zone, depth_at};
use crate::convolve::{Kernel, smooth_within};
use crate::regions::Regions;
use crate::slices::{LEAST_SHARE, USUAL_SHARE, least_detail};
use crate::{Head, MapKind, MapsUndefined, Region, TissueScale};

/// The score of `blur` above which a place is unusual, and the one from which it is nearly so.
///
/// The highest places of the cerebra of six heads without a lesion have 1.80, 1.82, 2.01, 2.05, 2.27 and 2.60: two are above
/// the first limit, four above the second one. Of eight other heads, whose regions were not known, one was above the first.
pub const UNUSUAL_ABOVE: f32 = 2.25;
/// See [`UNUSUAL_ABOVE`].
pub const BORDERLINE_FROM: f32 = 2.0;

/// The limits of unusual scores of a map. They belong to [`crate::MAP_FORMAT`].
///
/// `flair` has none: no FLAIR of a head without a lesion was measured, and folds of a phantom without a lesion score up to 3.0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScoreLimits {
    /// Scores above this are unusual.
    pub unusual_above: f32,
    /// Scores from this on are borderline.
    pub borderline_from: f32,
}

impl ScoreLimits {
    pub const BLUR: Self = Self {
        unusual_above: UNUSUAL_ABOVE,
        borderline_from: BORDERLINE_FROM,
    };
    /// Of `thickness`. The highest places of the cerebra of four heads without a lesion have 4.75, 5.26, 5.30 and 5.53.
    pub const THICKNESS: Self = Self {
        unusual_above: 5.5,
        borderline_from: 5.0,
    };
}

/// The longest edge of a voxel up to which the limits hold, in mm. They were read off voxels of 0.67 to 1 mm; of sound heads averaged to
/// coarser ones, many have a place above them (`lab/docs/study.md`).
const LIMITS_HOLD_TO_MM: f64 = 1.0;
/// Edges differ by some hundredths from what they are called.
const EDGE_TOLERANCE_MM: f64 = 0.05;

/// What is to be known about the scores of a map before one is believed to be unusual.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ScoreCaveat {
    /// The map is that of a FLAIR.
    #[error(
        "no limit is known for this map, because no FLAIR of a head without a lesion was measured: no place is called unusual, and the brightest places are listed of every head"
    )]
    UntestedFlair,
    /// The voxels are too coarse for the limits of `thickness`.
    #[error(
        "with voxels of {largest_mm} mm, no limit is known for this map: no place is called unusual, and the highest places are listed of every head. The limits of voxels up to {LIMITS_HOLD_TO_MM} mm were exceeded in all of four heads without a lesion that were averaged to 2 mm, by 1 to 8 places"
    )]
    CoarseThickness {
        /// The longest edge of a voxel.
        largest_mm: f64,
    },
    /// The volume shows less detail along one axis.
    #[error(
        "along one axis the volume has only {:.0} % of the fine detail that it has along another, as if its slices had been interpolated: that a place stands out, or that none does, means less", 100.0 * .share
    )]
    InterpolatedSlices {
        /// The least fine detail along an axis, as a share of the greatest.
        share: f32,
    },
    /// The contrast is low.
    #[error(
        "the contrast between grey and white matter is only {contrast:.1} times the noise: noise makes places stand out in `thickness`, and hides them in `blur`. The limits were read off heads with more contrast"
    )]
    LowContrast {
        /// The contrast, in deviations of the noise.
        contrast: f32,
    },
    /// The voxels are too coarse for the limits of `blur` to mean the same.
    #[error(
        "with voxels of {largest_mm} mm, a place that stands out means less: of four heads without a lesion, none had one at 1 mm; averaged to 1.1 to 1.5 mm, 7 of 24 lists had one, and to 1.75 to 2 mm, 11 of 16"
    )]
    CoarseBlur {
        /// The longest edge of a voxel.
        largest_mm: f64,
    },
}

/// What is unusual about a head, so that its scores mean less. Nothing in most.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct HeadDoubts {
    /// The least fine detail along an axis as a share of the greatest, if it is low.
    pub detail_share: Option<f32>,
    /// The contrast between grey and white matter in deviations of the noise, if it is low.
    pub contrast: Option<f32>,
}

/// The contrast below which scores mean less, in deviations of the noise. Eight heads without a lesion have more.
const USUAL_CONTRAST: f32 = 7.0;

impl HeadDoubts {
    /// # Errors
    /// If the slices of the head were interpolated.
    pub(crate) fn of(
        head: Head<'_>,
        block: &Block,
        tissue: &TissueScale,
    ) -> Result<Self, MapsUndefined> {
        let share = least_detail(head.volume, block).unwrap_or(1.0);
        if share < LEAST_SHARE {
            return Err(MapsUndefined::InterpolatedSlices { share });
        }
        let contrast = 1.0 / tissue.noise;
        Ok(Self {
            detail_share: (share < USUAL_SHARE).then_some(share as f32),
            contrast: (contrast < USUAL_CONTRAST).then_some(contrast),
        })
    }
}

impl ScoreCaveat {
    pub fn code(self) -> &'static str {
        match self {
            Self::UntestedFlair => "untested-flair",
            Self::CoarseThickness { .. } => "thickness-coarse-voxels",
            Self::CoarseBlur { .. } => "blur-coarse-voxels",
            Self::InterpolatedSlices { .. } => "interpolated",
            Self::LowContrast { .. } => "scores-low-contrast",
        }
    }
}

/// What is known about the scores of a map at the voxels of a head.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Judgement {
    /// The limits of unusual scores; `None` if none is known.
    pub limits: Option<ScoreLimits>,
    /// Why none is known, or why they mean less than in other heads.
    pub caveat: Option<ScoreCaveat>,
}

impl Judgement {
    /// Of a map of a head with voxels of these edges, in mm, and these doubts. Maps that list no places have no limits.
    pub fn of(kind: MapKind, spacing_mm: [f64; 3], doubts: HeadDoubts) -> Self {
        let largest_mm = spacing_mm.into_iter().fold(0.0, f64::max);
        let is_coarse = largest_mm > LIMITS_HOLD_TO_MM + EDGE_TOLERANCE_MM;
        let largest_mm = (largest_mm * 100.0).round() / 100.0;
        let (limits, caveat) = match kind {
            MapKind::Blur => (
                Some(ScoreLimits::BLUR),
                is_coarse.then_some(ScoreCaveat::CoarseBlur { largest_mm }),
            ),
            MapKind::Thickness if is_coarse => {
                (None, Some(ScoreCaveat::CoarseThickness { largest_mm }))
            }
            MapKind::Thickness => (Some(ScoreLimits::THICKNESS), None),
            MapKind::Flair => (None, Some(ScoreCaveat::UntestedFlair)),
            _ => (None, None),
        };
        let of_head = || {
            let smooth =
                (doubts.detail_share).map(|share| ScoreCaveat::InterpolatedSlices { share });
            smooth.or((doubts.contrast).map(|contrast| ScoreCaveat::LowContrast { contrast }))
        };
        Self {
            caveat: caveat.or_else(|| limits.and_then(|_| of_head())),
            limits,
        }
    }
}

/// Whether the score of a place is higher than those of heads without a lesion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Unusual {
    /// Above the upper limit.
    Yes,
    /// From the lower limit on.
    Borderline,
    No,
}

impl Unusual {
    pub fn of(score: f32, limits: ScoreLimits) -> Self {
        match score {
            _ if score > limits.unusual_above => Self::Yes,
            _ if score >= limits.borderline_from => Self::Borderline,
            _ => Self::No,
        }
    }
}

/// A place at which the junction is less sharp than around it and on the other side, or the cortex thicker than on the other
/// side. Most such places are normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// The position, LPS mm.
    pub position_in_patient: DVec3,
    /// The depth below the envelope, in mm.
    pub depth_mm: f32,
    /// The smoothed map, in deviations over the junction of this head; lower where there is little junction.
    pub score: f32,
    /// The diameter of a ball with the volume of the connected part of the junction above half of the score, in mm.
    pub size_mm: f32,
    /// The region of the brain.
    pub region: Region,
    /// Whether its score is higher than those of heads without a lesion; `None` if the map has no limits.
    pub unusual: Option<Unusual>,
}

/// The Gaussian that smooths a map before candidates are chosen, in mm.
const SMOOTHED_MM: f64 = 2.0;
/// The least distance between a candidate and every higher one, in mm.
const APART_MM: f64 = 10.0;
/// The greatest number of candidates.
const LIMIT: usize = 60;
/// The greatest depth of a candidate, in mm, if the regions are in doubt. Deeper are nuclei and the brain stem, which have a
/// blurred border in everybody.
const DEEPEST_MM: f32 = 30.0;
/// The least weight of the junction for a mean over it.
const LEAST_WEIGHT: f32 = 1e-6;
/// The weight of junction with a score of 0 that is added at each place. A straight junction has a weight of about 0.2;
/// specks in white or in grey matter have less than 0.03, and would be high by chance.
const PRIOR_WEIGHT: f32 = 0.05;
/// The number of voxels that are sorted first, because few places are high.
const FIRST_SORTED: usize = 20_000;

/// The scores over the junction.
pub(crate) struct Scores<'a> {
    /// The voxels of the junction, ascending.
    pub(crate) junction: &'a [u32],
    pub(crate) scores: Vec<f32>,
}

impl<'a> Scores<'a> {
    /// A map over the junction, smoothed by a Gaussian over the junction alone, and lower where there is little junction.
    ///
    /// The mean over the junction replaces the values of the map beside the junction: there, detail also falls with the distance.
    pub(crate) fn smoothed(block: &Block, junction: &'a [u32], map: &mut [f32]) -> Self {
        let kernels = block.in_voxels(SMOOTHED_MM).map(Kernel::gaussian);
        let mut sums = vec![0.0; block.voxel_count()];
        let mut weights = vec![0.0; block.voxel_count()];
        for &voxel in junction {
            let value = map[voxel as usize];
            if !value.is_nan() {
                sums[voxel as usize] = value;
                weights[voxel as usize] = 1.0;
            }
        }
        let deep = block.spans(Zone::Deep);
        rayon::join(
            || smooth_within(&mut sums, &deep, &kernels),
            || smooth_within(&mut weights, &deep, &kernels),
        );
        let mean = |voxel: usize| sums[voxel] / weights[voxel].max(LEAST_WEIGHT);
        let score = |voxel: usize| sums[voxel] / (weights[voxel] + PRIOR_WEIGHT);
        let at_junction = |&voxel: &u32| (score(voxel as usize), map[voxel as usize]);
        let (scores, own): (Vec<f32>, Vec<f32>) = junction.iter().map(at_junction).unzip();
        for (voxel, value) in map.iter_mut().enumerate() {
            if !value.is_nan() && weights[voxel] > LEAST_WEIGHT {
                *value = mean(voxel);
            }
        }
        for (&voxel, own) in junction.iter().zip(own) {
            map[voxel as usize] = own;
        }
        Self { junction, scores }
    }

    /// The highest eligible places (by their index in the junction), each at least [`APART_MM`] from every higher one,
    /// highest first.
    fn maxima(&self, block: &Block, is_eligible: impl Fn(DVec3) -> bool) -> Vec<usize> {
        let mut order: Vec<u32> = (0..self.junction.len() as u32).collect();
        // Equal scores are in voxel order, so that the order is the same on every machine.
        let higher = |a: &u32, b: &u32| {
            let [score_a, score_b] = [a, b].map(|place| self.scores[*place as usize]);
            score_b.total_cmp(&score_a).then(a.cmp(b))
        };
        let mut found: Vec<(usize, DVec3)> = Vec::new();
        let mut sorted = 0;
        while sorted < order.len() && found.len() < LIMIT {
            let rest = &mut order[sorted..];
            let count = rest.len().min(FIRST_SORTED.max(sorted));
            if count < rest.len() {
                rest.select_nth_unstable_by(count, higher);
            }
            rest[..count].sort_unstable_by(higher);
            for &place in &rest[..count] {
                let position = self.position(block, place as usize);
                let is_apart = found
                    .iter()
                    .all(|(_, other)| other.distance_squared(position) >= APART_MM.powi(2));
                if is_apart && found.len() < LIMIT && is_eligible(position) {
                    found.push((place as usize, position));
                }
            }
            sorted += count;
        }
        found.into_iter().map(|(place, _)| place).collect()
    }

    fn position(&self, block: &Block, place: usize) -> DVec3 {
        let voxel = block.grid.voxel(self.junction[place] as usize);
        let voxel = DVec3::from_array(voxel.map(|along| along as f64));
        block.grid.patient_from_voxel().transform_point3(voxel)
    }

    /// The number of voxels of the junction above half the score of a place and connected to it (26-neighbourhood).
    fn extent(&self, block: &Block, rows: &[u32], place: usize) -> usize {
        let least = self.scores[place] / 2.0;
        let nx = block.size[0];
        let at = |voxel: usize| {
            let [first, last] = [rows[voxel / nx], rows[voxel / nx + 1]].map(|row| row as usize);
            let found = self.junction[first..last].binary_search(&(voxel as u32));
            found.ok().map(|place| first + place)
        };
        let mut seen = HashSet::from([place]);
        let mut open = vec![place];
        while let Some(place) = open.pop() {
            let voxel = block.grid.voxel(self.junction[place] as usize);
            for neighbour in neighbours(voxel, block.size) {
                let Some(other) = at(block.grid.index(neighbour)) else {
                    continue;
                };
                if self.scores[other] > least && seen.insert(other) {
                    open.push(other);
                }
            }
        }
        seen.len()
    }

    /// The number of voxels of the junction before each row of the block.
    fn rows(&self, block: &Block) -> Vec<u32> {
        let [nx, ny, nz] = block.size;
        let mut rows = vec![0; ny * nz + 1];
        for &voxel in self.junction {
            rows[voxel as usize / nx + 1] += 1;
        }
        for row in 1..rows.len() {
            rows[row] += rows[row - 1];
        }
        rows
    }
}

/// A voxel and its 26 neighbours.
fn neighbours(voxel: [usize; 3], size: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
    let [x, y, z] = [0, 1, 2].map(|axis| {
        let last = (voxel[axis] + 1).min(size[axis] - 1);
        voxel[axis].saturating_sub(1)..=last
    });
    z.flat_map(move |z| {
        let x = x.clone();
        y.clone()
            .flat_map(move |y| x.clone().map(move |x| [x, y, z]))
    })
}

/// The candidates of a head, highest first: those whose junction counts, and those elsewhere.
pub(crate) fn candidates(
    block: &Block,
    scores: &Scores,
    head: Head<'_>,
    regions: &Regions,
    kind: MapKind,
) -> [Vec<Candidate>; 2] {
    let depth = head.depth;
    let voxel_mm3 = block.grid.patient_from_voxel().matrix3.determinant().abs();
    let rows = scores.rows(block);
    let Judgement { limits, .. } = Judgement::of(kind, block.spacing_mm, HeadDoubts::default());
    let working_from_patient = depth.grid().voxel_from_patient();
    let depth_mm = |position| {
        depth_at(
            depth,
            working_from_patient.transform_point3(position).as_vec3(),
        )
    };
    let candidate = |place: usize| {
        let position = scores.position(block, place);
        let volume_mm3 = scores.extent(block, &rows, place) as f64 * voxel_mm3;
        Candidate {
            position_in_patient: position,
            depth_mm: depth_mm(position),
            score: scores.scores[place],
            size_mm: (6.0 * volume_mm3 / std::f64::consts::PI).cbrt() as f32,
            region: regions.at(position).unwrap_or(Region::LeftCerebrum),
            unusual: limits.map(|limits| Unusual::of(scores.scores[place], limits)),
        }
    };
    [true, false].map(|counts| {
        let is_eligible = |position: DVec3| {
            let does_count = regions.at(position).is_none_or(Region::counts);
            does_count == counts && (regions.doubts.is_empty() || depth_mm(position) <= DEEPEST_MM)
        };
        let maxima = scores.maxima(block, is_eligible);
        let high = maxima
            .into_iter()
            .filter(|&place| scores.scores[place] > 0.0);
        high.map(candidate).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coarse_voxels_have_no_limit_of_thickness_and_a_caveat_of_blur() {
        let at =
            |kind, largest_mm| Judgement::of(kind, [1.0, largest_mm, 1.0], HeadDoubts::default());
        let known = |limits| Judgement {
            limits: Some(limits),
            caveat: None,
        };
        assert_eq!(at(MapKind::Thickness, 1.0), known(ScoreLimits::THICKNESS));
        assert_eq!(at(MapKind::Thickness, 1.04), known(ScoreLimits::THICKNESS));
        assert_eq!(at(MapKind::Blur, 1.04), known(ScoreLimits::BLUR));
        let coarse = at(MapKind::Thickness, 1.2);
        assert_eq!(coarse.limits, None);
        let words = coarse.caveat.unwrap().to_string();
        assert!(
            words.starts_with("with voxels of 1.2 mm, no limit"),
            "{words}"
        );
        let blur = at(MapKind::Blur, 1.1);
        assert_eq!(blur.limits, Some(ScoreLimits::BLUR));
        assert_eq!(blur.caveat.unwrap().code(), "blur-coarse-voxels");
        let flair = at(MapKind::Flair, 1.0);
        assert_eq!(
            (flair.limits, flair.caveat),
            (None, Some(ScoreCaveat::UntestedFlair))
        );
    }

    #[test]
    fn scores_of_low_contrast_or_interpolated_slices_have_a_caveat_and_their_limits() {
        let doubts = |detail_share, contrast| HeadDoubts {
            detail_share,
            contrast,
        };
        for (doubts, code) in [
            (doubts(None, Some(6.0)), "scores-low-contrast"),
            (doubts(Some(0.4), None), "interpolated"),
            (doubts(Some(0.4), Some(6.0)), "interpolated"),
        ] {
            for (kind, limits) in [
                (MapKind::Blur, ScoreLimits::BLUR),
                (MapKind::Thickness, ScoreLimits::THICKNESS),
            ] {
                let judgement = Judgement::of(kind, [1.0; 3], doubts);
                assert_eq!(judgement.limits, Some(limits));
                assert_eq!(judgement.caveat.unwrap().code(), code, "{kind:?}");
            }
            let other = Judgement::of(MapKind::Sharpness, [1.0; 3], doubts);
            assert_eq!(other.caveat, None);
        }
    }
}
