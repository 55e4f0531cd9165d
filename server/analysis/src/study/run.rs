//! One head of the study: lesions one at a time, and what each observer makes of them.

use std::ops::ControlFlow;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::observer::{Aided, Changed, Seen, View};
use super::random::Random;
use super::search::false_marks_above;
use super::{Effect, Ground, Lesion};
use crate::maps::tissue_of;
use crate::{Head, MapParameters, MapsUndefined};

/// How much of a study is done, and with which numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StudyParameters {
    /// Lesions in each head; each is drawn alone.
    pub lesions: usize,
    /// Shams in each head.
    pub shams: usize,
    /// Normal places with which a known one is compared.
    pub normals: usize,
    /// Of all that is drawn in a head: another one for each head, or all heads get the same lesions.
    pub seed: u64,
    /// Of the maps that are judged.
    pub maps: MapParameters,
}

impl StudyParameters {
    /// The same with a seed of its own for a head of this name.
    pub fn for_head(self, name: &str) -> Self {
        // Fowler, Noll and Vo's FNV-1a.
        let mixed = name.bytes().fold(0xCBF2_9CE4_8422_2325, |hash: u64, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3)
        });
        Self {
            seed: self.seed ^ mixed,
            ..self
        }
    }

    /// The whole study.
    pub const FULL: Self = Self {
        lesions: 60,
        shams: 60,
        normals: 400,
        seed: 20_061_122,
        maps: MapParameters::STANDARD,
    };
    /// What fits into two minutes.
    pub const QUICK: Self = Self {
        lesions: 12,
        shams: 4,
        normals: 150,
        ..Self::FULL
    };
}

/// Which of a lesion's signs is there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sign {
    /// The junction is blurred.
    Blur,
    /// Grey matter reaches into white.
    Thickening,
    /// White matter below the junction is darker.
    Intensity,
    /// All three.
    All,
    /// None: a sham.
    Sham,
}

impl Sign {
    /// Those of which each lesion draws one.
    pub const DRAWN: [Self; 4] = [Self::Blur, Self::Thickening, Self::Intensity, Self::All];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Blur => "blur",
            Self::Thickening => "thickening",
            Self::Intensity => "intensity",
            Self::All => "all three",
            Self::Sham => "sham",
        }
    }
}

/// Radii of which each lesion draws one, in mm, and the strengths of its signs.
const RADII_MM: [f64; 3] = [4.0, 6.0, 9.0];
const BLURS_MM: [f64; 3] = [1.0, 1.5, 2.0];
const THICKENINGS_MM: [f64; 2] = [1.0, 2.0];
const DARKENINGS: [f64; 2] = [0.1, 0.2];

/// What an observer of one view made of one lesion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Sighting {
    /// The share of normal places that are less suspicious than this place, if the place is known; half of it where they are equal.
    pub known: f64,
    /// How many false marks lie above the lesion's, if it is searched for; `None` if none of the marks hits it.
    pub false_marks: Option<usize>,
}

/// One lesion or sham and what was seen of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// Which sign.
    pub sign: Sign,
    /// Mean radius, in mm.
    pub radius_mm: f64,
    /// LPS mm.
    pub position_in_patient: [f64; 3],
    /// In mm.
    pub depth_mm: f32,
    /// Strength of each sign, as in [`Effect`].
    pub blur_mm: f64,
    /// As in [`Effect`].
    pub thickening_mm: f64,
    /// As in [`Effect`].
    pub darkening: f64,
    /// Of the lesion's edge and noise.
    pub seed: u64,
    /// In the order of [`View::ALL`].
    pub sightings: Vec<Sighting>,
}

impl Trial {
    /// The lesion, to be put into its head again.
    pub fn lesion(&self) -> Lesion {
        Lesion {
            centre_in_patient: DVec3::from_array(self.position_in_patient),
            radius_mm: self.radius_mm,
            effect: Effect {
                blur_mm: self.blur_mm,
                thickening_mm: self.thickening_mm,
                darkening: self.darkening,
            },
            seed: self.seed,
        }
    }
}

/// A head with all of its trials.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HeadResult {
    /// What the head is called.
    pub name: String,
    /// Whether parameters were chosen on this head.
    pub is_tuned: bool,
    /// Lesions, then shams.
    pub trials: Vec<Trial>,
}

/// The trials of a head. `observe` hears of each trial that is done, out of how many, and may stop the run.
///
/// # Errors
/// If the head has no maps.
pub fn run_head(
    head: Head<'_>,
    parameters: &StudyParameters,
    mut observe: impl FnMut(&Trial, usize) -> ControlFlow<()>,
) -> Result<Vec<Trial>, MapsUndefined> {
    let ground = Ground::new(head)?;
    let pristine = Pristine::of(&ground, parameters);
    let count = parameters.lesions + parameters.shams;
    let mut random = Random::new(parameters.seed ^ 0x5EED);
    let mut trials = Vec::new();
    for (number, place) in ground.places(count, parameters.seed).iter().enumerate() {
        let is_sham = number >= parameters.lesions;
        let (sign, lesion) = drawn(place.position_in_patient, is_sham, &mut random);
        let sightings = pristine.sightings(&ground, &lesion, &parameters.maps)?;
        let trial = Trial {
            sign,
            radius_mm: lesion.radius_mm,
            position_in_patient: place.position_in_patient.to_array(),
            depth_mm: place.depth_mm,
            blur_mm: lesion.effect.blur_mm,
            thickening_mm: lesion.effect.thickening_mm,
            darkening: lesion.effect.darkening,
            seed: lesion.seed,
            sightings,
        };
        let flow = observe(&trial, count);
        trials.push(trial);
        if flow.is_break() {
            break;
        }
    }
    Ok(trials)
}

/// A lesion at a place: its sign, its size and its strengths by chance.
fn drawn(centre: DVec3, is_sham: bool, random: &mut Random) -> (Sign, Lesion) {
    let sign = Sign::DRAWN[random.below(Sign::DRAWN.len())];
    let radius_mm = RADII_MM[random.below(RADII_MM.len())];
    let strengths = Effect {
        blur_mm: BLURS_MM[random.below(BLURS_MM.len())],
        thickening_mm: THICKENINGS_MM[random.below(THICKENINGS_MM.len())],
        darkening: DARKENINGS[random.below(DARKENINGS.len())],
    };
    let seed = random.next();
    let sign = if is_sham { Sign::Sham } else { sign };
    let effect = match sign {
        Sign::Blur => Effect {
            blur_mm: strengths.blur_mm,
            ..Effect::NONE
        },
        Sign::Thickening => Effect {
            thickening_mm: strengths.thickening_mm,
            ..Effect::NONE
        },
        Sign::Intensity => Effect {
            darkening: strengths.darkening,
            ..Effect::NONE
        },
        Sign::All => strengths,
        Sign::Sham => Effect::NONE,
    };
    let lesion = Lesion {
        centre_in_patient: centre,
        radius_mm,
        effect,
        seed,
    };
    (sign, lesion)
}

/// A head without a lesion, as all observers see it.
struct Pristine {
    seen: Seen,
    /// The scores at normal places, ascending, in the order of [`View::ALL`].
    normals: Vec<Vec<f32>>,
}

impl Pristine {
    fn of(ground: &Ground<'_>, parameters: &StudyParameters) -> Self {
        let seen = Seen::of(ground.head, &ground.block, &ground.values);
        let aided = Aided::of(
            ground.head,
            &ground.block,
            (&ground.values, &ground.tissue),
            &parameters.maps,
        );
        // Drawn by the same rule as the lesions' places, so that depth and lobe give nothing away.
        let places = ground.normal_places(parameters.normals, parameters.seed ^ 0x0A11);
        let normals = View::ALL.map(|view| {
            let score = |place: &super::Place| match view.is_aided() {
                true => aided.at(view, place.position_in_patient),
                false => seen.at(view, place.position_in_patient),
            };
            let mut scores: Vec<f32> = places.iter().map(score).filter(|s| !s.is_nan()).collect();
            scores.sort_by(f32::total_cmp);
            scores
        });
        Self {
            seen,
            normals: normals.to_vec(),
        }
    }

    /// What all observers make of one lesion; every map is computed from the volume that holds it.
    fn sightings(
        &self,
        ground: &Ground<'_>,
        lesion: &Lesion,
        parameters: &MapParameters,
    ) -> Result<Vec<Sighting>, MapsUndefined> {
        let volume = ground.with_lesion(lesion);
        let head = Head {
            volume: &volume,
            ..ground.head
        };
        let (block, values, tissue) = tissue_of(head)?;
        let changed = Changed {
            centre: lesion.centre_in_patient,
            reach_mm: lesion.reach_mm(),
        };
        let seen = self.seen.with(head, &block, &values, changed);
        let aided = Aided::of(head, &block, (&values, &tissue), parameters);
        let centre = lesion.centre_in_patient;
        let sighting = |(view, normals): (View, &Vec<f32>)| {
            let (marks, score) = match view.is_aided() {
                true => (aided.marks(view), aided.at(view, centre)),
                false => (seen.marks(view), seen.at(view, centre)),
            };
            Sighting {
                known: share_below(normals, score),
                false_marks: false_marks_above(&marks, centre, lesion.radius_mm),
            }
        };
        Ok(View::ALL
            .into_iter()
            .zip(&self.normals)
            .map(sighting)
            .collect())
    }
}

/// The share of ascending values below one, and half of those equal to it.
fn share_below(ascending: &[f32], value: f32) -> f64 {
    let below = ascending.partition_point(|other| *other < value);
    let not_above = ascending.partition_point(|other| *other <= value);
    (below + not_above) as f64 / (2 * ascending.len().max(1)) as f64
}
