//! One head of the study: lesions one at a time, and the sightings of each observer.

use std::ops::ControlFlow;

use geometry::DepthField;
use glam::DVec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::hotelling::Outputs;
use super::observer::{Aided, Changed, Seen, View};
use super::patches::outputs;
use super::random::Random;
use super::search::{Mark, hit};
use super::{Area, Effect, Ground, Lesion, Place};
use analysis::steps::tissue_of;
use analysis::{Head, MapParameters, MapsUndefined};

/// The size and the parameters of a study.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StudyParameters {
    /// Number of lesions in each head; each is alone in its trial.
    pub lesions: usize,
    /// Number of shams in each head.
    pub shams: usize,
    /// Number of lesions, and of shams, in each head for the observers of a known place. Those above `lesions` and
    /// `shams` are not searched for.
    pub patches: usize,
    /// Number of normal places for comparison with a known place.
    pub normals: usize,
    /// The seed of all random choices in a head. It must differ between heads, or they all get the same lesions.
    pub seed: u64,
    /// The sign, the radius in mm and the effect of every lesion; `None` to draw them.
    pub lesion: Option<(Sign, f64, Effect)>,
    /// Whether the lesions are the four of the page of results ([`FOUR_LESIONS`]), in turn.
    pub is_of_four: bool,
    /// What makes the lesions.
    pub simulator: Simulator,
    /// The views that look for them: [`View::ALL`] or [`View::OF_MAPS`].
    pub views: &'static [View],
    /// The parameters of the maps.
    pub maps: MapParameters,
}

impl StudyParameters {
    /// The same with one blur of this radius and strength, in mm, in place of all signs and sizes, and without shams.
    pub fn with_blurs_alone(self, radius_mm: f64, blur_mm: f64) -> Self {
        let effect = Effect {
            blur_mm,
            ..Effect::NONE
        };
        self.with_alone(Sign::Blur, radius_mm, effect)
    }

    /// The same with thickenings.
    pub fn with_thickenings_alone(self, radius_mm: f64, thickening_mm: f64) -> Self {
        let effect = Effect {
            thickening_mm,
            ..Effect::NONE
        };
        self.with_alone(Sign::Thickening, radius_mm, effect)
    }

    /// The same with the four lesions of the page of results, in turn, and with the views that show maps.
    pub fn with_four_lesions(self, simulator: Simulator) -> Self {
        Self {
            patches: 0,
            is_of_four: true,
            views: &View::OF_MAPS,
            simulator,
            ..self
        }
    }

    fn with_alone(self, sign: Sign, radius_mm: f64, effect: Effect) -> Self {
        Self {
            shams: 0,
            patches: 0,
            lesion: Some((sign, radius_mm, effect)),
            ..self
        }
    }

    /// The same with a separate seed for a head with this name.
    pub fn for_head(self, name: &str) -> Self {
        // FNV-1a (Fowler, Noll and Vo).
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
        patches: 0,
        normals: 1000,
        seed: 20_061_122,
        lesion: None,
        is_of_four: false,
        simulator: Simulator::Displaced,
        views: &View::ALL,
        maps: MapParameters::STANDARD,
    };
    /// A run of two minutes.
    pub const QUICK: Self = Self {
        lesions: 12,
        shams: 4,
        normals: 150,
        ..Self::FULL
    };
}

/// What makes lesions. Two simulators that treat noise differently keep a score from learning one of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Simulator {
    /// Gaussians, displaced intensities and white noise: `lesion.rs`.
    Displaced,
    /// Boxes, paint and noise that is correlated as in the head: `paint.rs`.
    Painted,
}

impl Simulator {
    /// All simulators.
    pub const ALL: [Self; 2] = [Self::Displaced, Self::Painted];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Displaced => "displaced",
            Self::Painted => "painted",
        }
    }

    /// The signs that it makes in a random choice.
    pub fn signs(self) -> &'static [Sign] {
        match self {
            Self::Displaced => &Sign::DRAWN,
            Self::Painted => &[Sign::Blur, Sign::Thickening],
        }
    }
}

/// The sign of a lesion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sign {
    /// The junction is blurred.
    Blur,
    /// Grey matter extends into white matter.
    Thickening,
    /// White matter below the junction is darker.
    Intensity,
    /// All three signs.
    All,
    /// A weak mixture of all signs, with a brighter cortex.
    Mixture,
    /// A blur with a dark band to the ventricle.
    Transmantle,
    /// No sign: a sham.
    Sham,
}

impl Sign {
    /// The signs for a random choice.
    pub const DRAWN: [Self; 4] = [Self::Blur, Self::Thickening, Self::Intensity, Self::All];
    /// The signs of lesions.
    pub const LESIONS: [Self; 6] = [
        Self::Blur,
        Self::Mixture,
        Self::Transmantle,
        Self::Thickening,
        Self::Intensity,
        Self::All,
    ];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Blur => "blur",
            Self::Thickening => "thickening",
            Self::Intensity => "intensity",
            Self::All => "all three",
            Self::Mixture => "mixture",
            Self::Transmantle => "transmantle",
            Self::Sham => "sham",
        }
    }
}

/// The four lesions of the page of results, as in the independent check: the sign, the radius in mm, and the effect.
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

/// The greatest number of trials that are computed at the same time. Each needs the memory of a head and its maps.
const AT_ONCE: usize = 4;

/// The radii for a random choice, in mm, and the strengths of the signs.
const RADII_MM: [f64; 3] = [4.0, 6.0, 9.0];
const BLURS_MM: [f64; 3] = [1.0, 1.5, 2.0];
const THICKENINGS_MM: [f64; 2] = [1.0, 2.0];
const DARKENINGS: [f64; 2] = [0.1, 0.2];

/// The sighting of one lesion in one view.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Sighting {
    /// With a known place: the fraction of normal places that are less suspicious; equal ones count half.
    pub known: f64,
    /// In a search: the number of false marks above the mark of the lesion; `None` if no mark hits it, or nothing was
    /// searched.
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
    /// Mean radius, in mm.
    pub radius_mm: f64,
    /// Its centre, LPS mm.
    pub position_in_patient: [f64; 3],
    /// Its depth, in mm.
    pub depth_mm: f32,
    /// The part of the brain in which it is.
    pub area: Area,
    /// Strength of each sign, as in [`Effect`].
    pub blur_mm: f64,
    /// As in [`Effect`].
    pub thickening_mm: f64,
    /// As in [`Effect`].
    pub darkening: f64,
    /// As in [`Effect`].
    pub brightening: f64,
    /// As in [`Lesion`].
    pub band_to: Option<[f64; 3]>,
    /// The seed of its edge and noise.
    pub seed: u64,
    /// Whether the whole head was searched for it; if not, only the known place counts.
    pub is_searched: bool,
    /// Its sightings, in the order of the views.
    pub sightings: Vec<Sighting>,
    /// The outputs of the channels of O2 at its place, in the order of [`View::ALL`]; empty if only maps were shown.
    pub channels: Vec<Outputs>,
}

impl Trial {
    /// The lesion, which can be put into its head again.
    pub fn lesion(&self) -> Lesion {
        Lesion {
            centre_in_patient: DVec3::from_array(self.position_in_patient),
            radius_mm: self.radius_mm,
            effect: Effect {
                blur_mm: self.blur_mm,
                thickening_mm: self.thickening_mm,
                darkening: self.darkening,
                brightening: self.brightening,
            },
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
    /// Whether parameters were tuned on this head.
    pub is_tuned: bool,
    /// The trials: lesions and shams, evenly mixed.
    pub trials: Vec<Trial>,
}

/// The trials of a head. `observe` receives each finished trial and the number of all trials, and may stop the run.
///
/// `finished` are the first trials, from a run with the same parameters that was interrupted: they are returned as they
/// are, and not observed.
///
/// # Errors
/// If the head has no maps.
pub fn run_head(
    head: Head<'_>,
    parameters: &StudyParameters,
    finished: Vec<Trial>,
    mut observe: impl FnMut(&Trial, usize) -> ControlFlow<()>,
) -> Result<Vec<Trial>, MapsUndefined> {
    let ground = Ground::new(head)?;
    let searched = parameters.lesions + parameters.shams;
    let [lesions, shams] = parameters.only_known();
    let count = parameters.trials();
    // The places of the search come first, so that they are the same with and without further patches.
    let places = ground.places(count + parameters.normals, parameters.seed);
    let (places, others) = places.split_at(searched.min(places.len()));
    let (normals, further) = others.split_at(parameters.normals.min(others.len()));
    let pristine = Pristine::of(&ground, normals, parameters);
    let mut random = Random::new(parameters.seed ^ 0x5EED);
    let mut lesions_before = 0;
    let mut drawn = |number: usize, place: &Place| {
        let is_searched = number < searched;
        let is_sham = if is_searched {
            is_sham(number, [parameters.lesions, parameters.shams])
        } else {
            is_sham(number - searched, [lesions, shams])
        };
        let (mut sign, mut lesion) =
            parameters.drawn(place.position_in_patient, is_sham, &mut random);
        if parameters.is_of_four && !is_sham {
            (sign, lesion.radius_mm, lesion.effect) =
                FOUR_LESIONS[lesions_before % FOUR_LESIONS.len()];
            lesions_before += 1;
        }
        if sign == Sign::Transmantle {
            lesion.band_to = ground.nearest_ventricle(place.position_in_patient);
        }
        (*place, sign, lesion, is_searched)
    };
    let all = places.iter().chain(further).enumerate();
    let drawn: Vec<_> = all.map(|(number, place)| drawn(number, place)).collect();
    let mut trials = finished;
    for some in drawn[trials.len().min(drawn.len())..].chunks(AT_ONCE) {
        let computed = some.par_iter().map(|(place, sign, lesion, is_searched)| {
            let seen = pristine.observed(&ground, lesion, *is_searched, parameters);
            let (sightings, channels) = seen?;
            Ok(Trial {
                sign: *sign,
                radius_mm: lesion.radius_mm,
                position_in_patient: place.position_in_patient.to_array(),
                depth_mm: place.depth_mm,
                area: place.area,
                blur_mm: lesion.effect.blur_mm,
                thickening_mm: lesion.effect.thickening_mm,
                darkening: lesion.effect.darkening,
                brightening: lesion.effect.brightening,
                band_to: lesion.band_to.map(|end| end.to_array()),
                seed: lesion.seed,
                is_searched: *is_searched,
                sightings,
                channels,
            })
        });
        for trial in computed.collect::<Result<Vec<Trial>, MapsUndefined>>()? {
            let flow = observe(&trial, count);
            trials.push(trial);
            if flow.is_break() {
                return Ok(trials);
            }
        }
    }
    Ok(trials)
}

/// Whether a trial is a sham. Shams are spread evenly among the lesions.
fn is_sham(number: usize, [lesions, shams]: [usize; 2]) -> bool {
    let shams_before = |number: usize| number * shams / (lesions + shams);
    shams_before(number + 1) > shams_before(number)
}

impl StudyParameters {
    /// The numbers of lesions and of shams in each head that are not searched for.
    fn only_known(&self) -> [usize; 2] {
        [self.lesions, self.shams].map(|searched| self.patches.saturating_sub(searched))
    }

    /// The number of trials of a head.
    pub fn trials(&self) -> usize {
        let [lesions, shams] = self.only_known();
        self.lesions + self.shams + lesions + shams
    }

    /// A lesion at a place, with random sign, size and strengths.
    fn drawn(&self, centre: DVec3, is_sham: bool, random: &mut Random) -> (Sign, Lesion) {
        let signs = self.simulator.signs();
        let sign = signs[random.below(signs.len())];
        let radius_mm = RADII_MM[random.below(RADII_MM.len())];
        let strengths = Effect {
            blur_mm: BLURS_MM[random.below(BLURS_MM.len())],
            thickening_mm: THICKENINGS_MM[random.below(THICKENINGS_MM.len())],
            darkening: DARKENINGS[random.below(DARKENINGS.len())],
            brightening: 0.0,
        };
        let seed = random.next();
        let (sign, radius_mm, strengths) = self.lesion.unwrap_or((sign, radius_mm, strengths));
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
            Sign::All | Sign::Mixture | Sign::Transmantle => strengths,
            Sign::Sham => Effect::NONE,
        };
        let lesion = Lesion {
            centre_in_patient: centre,
            radius_mm,
            effect,
            band_to: None,
            seed,
        };
        (sign, lesion)
    }
}

/// A head without a lesion, with the scores of all observers.
struct Pristine {
    /// `None` if only maps are shown.
    seen: Option<Seen>,
    aided: Aided,
    views: &'static [View],
    /// The marks of a search, in the order of the views.
    marks: Vec<Vec<Mark>>,
    /// The scores at normal places, ascending, in the order of the views.
    normals: Vec<Vec<f32>>,
}

/// What is shown of a head: its cuts, if they are looked at, and its maps.
type Shown<'a> = (&'a DepthField, Option<&'a Seen>, &'a Aided);

/// The score of a view at a position.
fn score((depth, seen, aided): Shown<'_>, view: View, place: DVec3) -> f32 {
    match seen {
        Some(seen) if !view.is_aided() => seen.at(view, depth, place),
        _ => aided.at(view, place),
    }
}

impl Pristine {
    fn of(ground: &Ground<'_>, places: &[Place], parameters: &StudyParameters) -> Self {
        let views = parameters.views;
        let has_cuts = !views.iter().all(|view| view.is_aided());
        let seen = has_cuts.then(|| Seen::of(ground.head, &ground.block, &ground.values));
        let aided = Aided::of(
            ground.head,
            &ground.block,
            (&ground.values, &ground.tissue),
            &parameters.maps,
        );
        let shown = (ground.head.depth, seen.as_ref(), &aided);
        let normals = views.iter().map(|&view| {
            let scores = places.iter();
            let scores = scores.map(|place| score(shown, view, place.position_in_patient));
            let mut scores: Vec<f32> = scores.filter(|score| !score.is_nan()).collect();
            scores.sort_by(f32::total_cmp);
            scores
        });
        let normals = normals.collect();
        let marks = views.iter().map(|&view| marks(view, shown)).collect();
        Self {
            views,
            marks,
            normals,
            seen,
            aided,
        }
    }

    /// The sightings of one lesion, and the outputs of the channels at its place; every map is computed from the volume
    /// with the lesion.
    fn observed(
        &self,
        ground: &Ground<'_>,
        lesion: &Lesion,
        is_searched: bool,
        parameters: &StudyParameters,
    ) -> Result<(Vec<Sighting>, Vec<Outputs>), MapsUndefined> {
        let place = (lesion.centre_in_patient, lesion.radius_mm);
        let volume = ground.simulated(lesion, parameters.simulator);
        if volume == *ground.head.volume {
            // The same volume gives the same maps and marks, so a sham needs no second computation.
            let channels = self.seen.as_ref().map_or_else(Vec::new, |seen| {
                let shown = (ground.values.as_slice(), &seen.flat, &self.aided);
                outputs(ground.head, &ground.block, shown, place)
            });
            let shown = (ground.head.depth, self.seen.as_ref(), &self.aided);
            let marks = |view: usize| self.marks[view].clone();
            return Ok((self.sighted(lesion, is_searched, shown, marks), channels));
        }
        let head = Head {
            volume: &volume,
            ..ground.head
        };
        let (block, values, tissue) = tissue_of(head)?;
        let changed = Changed {
            centre: lesion.centre_in_patient,
            reach_mm: lesion.reach_mm(),
        };
        let before = self.seen.as_ref();
        let seen = before.map(|seen| seen.with(head, &block, &values, changed));
        let aided = Aided::of(head, &block, (&values, &tissue), &parameters.maps);
        let channels = seen.as_ref().map_or_else(Vec::new, |seen| {
            outputs(head, &block, (&values, &seen.flat, &aided), place)
        });
        let shown = (head.depth, seen.as_ref(), &aided);
        let marks = |view: usize| marks(self.views[view], shown);
        Ok((self.sighted(lesion, is_searched, shown, marks), channels))
    }

    fn sighted(
        &self,
        lesion: &Lesion,
        is_searched: bool,
        shown: Shown<'_>,
        marks: impl Fn(usize) -> Vec<Mark>,
    ) -> Vec<Sighting> {
        let centre = lesion.centre_in_patient;
        let sighting = |(number, &view): (usize, &View)| {
            let score = score(shown, view, centre);
            let marks = if is_searched {
                marks(number)
            } else {
                Vec::new()
            };
            let hit = hit(&marks, centre, lesion.radius_mm);
            Sighting {
                known: share_below(&self.normals[number], score),
                false_marks: hit.map(|(false_marks, _)| false_marks),
                score: hit.map(|(_, mark)| mark.score),
                highest: marks.first().map(|mark| mark.score),
            }
        };
        self.views.iter().enumerate().map(sighting).collect()
    }
}

/// The marks of a search through a whole head.
fn marks(view: View, (_, seen, aided): Shown<'_>) -> Vec<Mark> {
    match seen {
        Some(seen) if !view.is_aided() => seen.marks(view),
        _ => aided.marks(view),
    }
}

/// The fraction of ascending values below one; equal values count half.
fn share_below(ascending: &[f32], value: f32) -> f64 {
    let below = ascending.partition_point(|other| *other < value);
    let not_above = ascending.partition_point(|other| *other <= value);
    (below + not_above) as f64 / (2 * ascending.len().max(1)) as f64
}
