//! One head of the study: lesions one at a time, and what the lists of the program find of them.

use std::ops::ControlFlow;

use analysis::{Candidate, Head, MapsUndefined, maps};
use geometry::Volume;
use glam::DVec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::search::{Mark, hit};
use super::{Area, Effect, Ground, Lesion, Place};
use crate::random::Random;

/// The seed of the study.
pub const SEED: u64 = 20_061_122;

/// The seed of a head with this name.
pub fn seed_of(head: &str) -> u64 {
    // FNV-1a (Fowler, Noll and Vo).
    SEED ^ head.bytes().fold(0xCBF2_9CE4_8422_2325, |hash: u64, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3)
    })
}

/// The size of a study.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct StudyParameters {
    /// Number of lesions in each head, the four of [`FOUR_LESIONS`] in turn; each is alone in its trial.
    pub lesions: usize,
    /// Number of shams in each head.
    pub shams: usize,
    /// What makes the lesions.
    pub simulator: Simulator,
}

/// What makes lesions. Simulators that treat noise differently keep a score from learning one of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Simulator {
    /// Gaussians, displaced intensities and white noise: `lesion.rs`.
    Displaced,
    /// Boxes, paint and noise that is correlated as in the head: `paint.rs`.
    Painted,
    /// A wider profile across the junction, with noise and texture as they were acquired: `widen.rs`.
    Widened,
}

impl Simulator {
    /// All simulators.
    pub const ALL: [Self; 3] = [Self::Displaced, Self::Painted, Self::Widened];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Displaced => "displaced",
            Self::Painted => "painted",
            Self::Widened => "widened",
        }
    }
}

/// The sign of a lesion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sign {
    /// The junction is blurred.
    Blur,
    /// A weak mixture of all signs, with a brighter cortex.
    Mixture,
    /// A blur with a dark band to the ventricle.
    Transmantle,
    /// Grey matter extends into white matter.
    Thickening,
    /// No sign: a sham.
    Sham,
}

impl Sign {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Blur => "blur",
            Self::Mixture => "mixture",
            Self::Transmantle => "transmantle",
            Self::Thickening => "thickening",
            Self::Sham => "sham",
        }
    }
}

/// The lesions of the study, as in the independent check: the sign, the radius in mm, and the effect.
pub const FOUR_LESIONS: [(Sign, f64, Effect); 4] = [
    (
        Sign::Blur,
        6.0,
        Effect {
            blur_mm: 1.5,
            ..Effect::NONE
        },
    ),
    (
        Sign::Mixture,
        6.0,
        Effect {
            blur_mm: 1.2,
            thickening_mm: 1.5,
            darkening: 0.10,
            brightening: 0.12,
        },
    ),
    (
        Sign::Transmantle,
        5.0,
        Effect {
            blur_mm: 1.0,
            ..Effect::NONE
        },
    ),
    (
        Sign::Thickening,
        7.0,
        Effect {
            thickening_mm: 2.0,
            ..Effect::NONE
        },
    ),
];

/// The radius of a sham, in mm.
const SHAM_MM: f64 = 6.0;

/// The greatest number of trials that are computed at the same time. Each needs the memory of a head and its maps.
const AT_ONCE: usize = 4;

/// What one list has of a lesion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Sighting {
    /// The number of false marks above the mark of the lesion; `None` if no mark hits it.
    pub false_marks: Option<usize>,
    /// The score of that mark.
    pub score: Option<f32>,
    /// The score of the highest mark of the head.
    pub highest: Option<f32>,
}

/// One lesion or sham, with its sightings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// Its sign.
    pub sign: Sign,
    /// Its centre, LPS mm.
    pub position_in_patient: [f64; 3],
    /// The depth of its centre, in mm.
    pub depth_mm: f32,
    /// The part of the brain in which it is.
    pub area: Area,
    /// Its mean radius, in mm.
    pub radius_mm: f64,
    /// Its effects.
    pub effect: Effect,
    /// The end of its dark band, LPS mm.
    pub band_to: Option<[f64; 3]>,
    /// The seed of its edge and its noise.
    pub seed: u64,
    /// What the lists of `blur` and of `thickness` have of it.
    pub sightings: [Sighting; 2],
}

impl Trial {
    /// The lesion, which can be put into its head again.
    pub fn lesion(&self) -> Lesion {
        Lesion {
            centre_in_patient: DVec3::from_array(self.position_in_patient),
            radius_mm: self.radius_mm,
            effect: self.effect,
            band_to: self.band_to.map(DVec3::from_array),
            seed: self.seed,
        }
    }
}

/// A head with all its trials.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HeadResult {
    /// The name of the head.
    pub name: String,
    /// The trials: lesions and shams, evenly mixed.
    pub trials: Vec<Trial>,
}

/// The trials of a head, by a seed. `observe` receives each finished trial, and may stop the run.
///
/// `finished` are the first trials, from a run with the same parameters that was interrupted: they are returned as they
/// are, and not observed.
///
/// # Errors
/// If the head has no maps.
pub fn run_head(
    head: Head<'_>,
    (parameters, seed): (&StudyParameters, u64),
    finished: Vec<Trial>,
    mut observe: impl FnMut(&Trial) -> ControlFlow<()>,
) -> Result<Vec<Trial>, MapsUndefined> {
    let ground = Ground::new(head)?;
    let without_lesion = lists(head)?;
    let drawn = parameters.drawn(&ground, seed);
    let mut trials = finished;
    for some in drawn[trials.len().min(drawn.len())..].chunks(AT_ONCE) {
        let computed = some.par_iter().map(|(place, sign, lesion)| {
            let volume: Volume = ground.simulated(lesion, parameters.simulator);
            // The same volume has the same maps, so a sham needs no second computation.
            let lists = if volume == *head.volume {
                without_lesion.clone()
            } else {
                lists(Head {
                    volume: &volume,
                    ..head
                })?
            };
            Ok(Trial {
                sign: *sign,
                position_in_patient: lesion.centre_in_patient.to_array(),
                depth_mm: place.depth_mm,
                area: place.area,
                radius_mm: lesion.radius_mm,
                effect: lesion.effect,
                band_to: lesion.band_to.map(|end| end.to_array()),
                seed: lesion.seed,
                sightings: lists.map(|marks| sighting(&marks, lesion)),
            })
        });
        for trial in computed.collect::<Result<Vec<Trial>, MapsUndefined>>()? {
            let flow = observe(&trial);
            trials.push(trial);
            if flow.is_break() {
                return Ok(trials);
            }
        }
    }
    Ok(trials)
}

impl StudyParameters {
    /// The number of trials of a head.
    pub fn trials(&self) -> usize {
        self.lesions + self.shams
    }

    /// The lesions of a head with their places. Shams are spread evenly among the lesions.
    fn drawn(&self, ground: &Ground<'_>, seed: u64) -> Vec<(Place, Sign, Lesion)> {
        let mut random = Random::new(seed ^ 0x5EED);
        let shams_before = |number: usize| number * self.shams / self.trials();
        let drawn = |(number, place): (usize, Place)| {
            let is_sham = shams_before(number + 1) > shams_before(number);
            let (sign, radius_mm, effect) = if is_sham {
                (Sign::Sham, SHAM_MM, Effect::NONE)
            } else {
                FOUR_LESIONS[(number - shams_before(number)) % FOUR_LESIONS.len()]
            };
            let centre_in_patient = place.position_in_patient;
            // The tables of the study were made with each sixth number.
            for _ in 0..5 {
                random.next();
            }
            let lesion = Lesion {
                centre_in_patient,
                radius_mm,
                effect,
                band_to: match sign {
                    Sign::Transmantle => ground.nearest_ventricle(centre_in_patient),
                    _ => None,
                },
                seed: random.next(),
            };
            (place, sign, lesion)
        };
        let places = ground.places(self.trials(), seed).into_iter();
        places.enumerate().map(drawn).collect()
    }
}

/// The lists of `blur` and of `thickness`, as the program makes them.
fn lists(head: Head<'_>) -> Result<[Vec<Mark>; 2], MapsUndefined> {
    let maps = maps(head, None)?;
    let marks = |candidates: &[Candidate]| -> Vec<Mark> {
        let mark = |candidate: &Candidate| Mark {
            position_in_patient: candidate.position_in_patient,
            score: candidate.score,
        };
        candidates.iter().map(mark).collect()
    };
    Ok([marks(&maps.candidates), marks(&maps.thick[0])])
}

fn sighting(marks: &[Mark], lesion: &Lesion) -> Sighting {
    let hit = hit(marks, lesion.centre_in_patient, lesion.radius_mm);
    Sighting {
        false_marks: hit.map(|(false_marks, _)| false_marks),
        score: hit.map(|(_, mark)| mark.score),
        highest: marks.first().map(|mark| mark.score),
    }
}
