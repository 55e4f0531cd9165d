//! The results of all heads, and whether the criteria hold that were fixed beforehand.

use std::fmt::Write;

use serde::{Deserialize, Serialize};

use super::known::{KnownPlace, known_place, known_table, mean};
use super::random::Random;
use super::run::{HeadResult, Sign, Trial};
use super::{Sighting, Simulator, StudyParameters, View};

/// Number of bootstrap samples.
const ROUNDS: usize = 1000;

/// The criteria of the study, fixed before its first full run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Criteria {
    /// (a) The least gain of `blur` (V9) over three stacks (V4) in the fraction of lesions found with fewer than one
    /// false mark.
    pub least_gain: f64,
    /// (a) The number of untuned heads in which this must hold, with an interval above 0: three of four.
    pub least_heads: usize,
    /// (b) The greatest deficit of isosurfaces (V5) below the best stack (V1 to V3), in area under the curve with a
    /// known place.
    pub most_behind: f64,
    /// The greatest distance of shams from chance.
    pub most_leak: f64,
}

impl Criteria {
    /// The criteria of the study.
    pub const STANDARD: Self = Self {
        least_gain: 0.2,
        least_heads: 3,
        most_behind: 0.03,
        most_leak: 0.03,
    };
}

/// Whether a criterion holds, with its numbers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    /// The criterion, in words.
    pub criterion: String,
    /// `None` if it is only reported.
    pub holds: Option<bool>,
    /// The numbers.
    pub figures: String,
}

/// All heads and their results.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// The version of the maps.
    pub map_format: u32,
    /// The seed of all random choices.
    pub seed: u64,
    /// What made the lesions.
    pub simulator: Simulator,
    /// The names of the views, in the order of the sightings of a trial.
    pub views: Vec<String>,
    /// The heads, in the order of the run.
    pub heads: Vec<HeadResult>,
}

/// A fraction of trials with its 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Interval {
    pub(crate) value: f64,
    pub(crate) low: f64,
    pub(crate) high: f64,
}

impl Interval {
    /// A share of a count, with the interval of Wilson.
    ///
    /// Source: Wilson, "Probable inference, the law of succession, and statistical inference", J. Am. Stat. Assoc. 22, 1927.
    pub(crate) fn of_count(found: usize, count: usize) -> Self {
        let count = count.max(1) as f64;
        let value = found as f64 / count;
        let z: f64 = 1.96;
        let shrunk = 1.0 + z * z / count;
        let middle = (value + z * z / (2.0 * count)) / shrunk;
        let half =
            z / shrunk * (value * (1.0 - value) / count + (z / (2.0 * count)).powi(2)).sqrt();
        Self {
            value,
            low: (middle - half).max(0.0),
            high: (middle + half).min(1.0),
        }
    }
}

impl Report {
    /// A report of these heads, with the results of a study.
    pub fn new(parameters: &StudyParameters, heads: Vec<HeadResult>) -> Self {
        let views = parameters.views.iter();
        Self {
            map_format: analysis::MAP_FORMAT,
            seed: parameters.seed,
            simulator: parameters.simulator,
            views: views.map(|view| view.name().to_owned()).collect(),
            heads,
        }
    }

    /// The views of the study.
    fn shown(&self) -> Vec<View> {
        let name = |view: &View| self.views.iter().any(|name| name == view.name());
        View::ALL.into_iter().filter(name).collect()
    }

    pub(super) fn sighting<'a>(&self, trial: &'a Trial, view: View) -> &'a Sighting {
        let place = self.views.iter().position(|name| name == view.name());
        &trial.sightings[place.expect("a view of the study")]
    }

    fn hits(&self, trials: &[&Trial], view: View, false_marks: usize) -> f64 {
        let found = trials
            .iter()
            .filter(|trial| is_hit(self.sighting(trial, view), false_marks));
        found.count() as f64 / trials.len().max(1) as f64
    }

    /// O1 and O2 with a known place: each head, their mean, and the mean for each sign. Empty if O2 cannot be trained,
    /// because there are fewer than two heads or no shams.
    pub fn known_place(&self) -> Vec<KnownPlace> {
        known_place(&self.heads)
    }

    /// The criteria with their numbers; the one about shams alone if only maps were shown.
    pub fn verdicts(&self, criteria: &Criteria) -> Vec<Verdict> {
        if self.shown() != View::ALL {
            return vec![self.shams(criteria)];
        }
        vec![
            self.gain(criteria),
            self.isosurfaces(criteria),
            self.peel_or_aid(),
            self.shams(criteria),
        ]
    }

    fn gain(&self, criteria: &Criteria) -> Verdict {
        let untuned: Vec<&HeadResult> = self.heads.iter().filter(|head| !head.is_tuned).collect();
        let gains: Vec<(&str, Interval)> = untuned
            .iter()
            .map(|head| {
                (
                    head.name.as_str(),
                    self.difference(head, View::Blur, View::ThreeStacks, 1),
                )
            })
            .collect();
        let holds = |gain: &Interval| gain.value >= criteria.least_gain && gain.low > 0.0;
        let count = gains.iter().filter(|(_, gain)| holds(gain)).count();
        Verdict {
            criterion: format!(
                "(a) V9 finds at least {} more than V4 with fewer than one false mark, interval above 0, in {} of the untuned heads",
                criteria.least_gain, criteria.least_heads
            ),
            holds: Some(count >= criteria.least_heads),
            figures: figures(&gains),
        }
    }

    fn isosurfaces(&self, criteria: &Criteria) -> Verdict {
        let area = |view: View| mean(self.lesions().map(|trial| self.sighting(trial, view).known));
        let planes = [View::Axial, View::Coronal, View::Sagittal].map(area);
        let best = planes.into_iter().fold(0.0, f64::max);
        let own = area(View::Isosurfaces);
        Verdict {
            criterion: format!(
                "(b) V5 is at most {} below the best of V1 to V3, with a known place",
                criteria.most_behind
            ),
            holds: Some(own >= best - criteria.most_behind),
            figures: format!(
                "V5 {own:.3}, V1 {:.3}, V2 {:.3}, V3 {:.3}",
                planes[0], planes[1], planes[2]
            ),
        }
    }

    fn peel_or_aid(&self) -> Verdict {
        let of = |head: &HeadResult| self.difference(head, View::Blur, View::BlurList, 1);
        let gains: Vec<(&str, Interval)> = self
            .heads
            .iter()
            .map(|head| (head.name.as_str(), of(head)))
            .collect();
        Verdict {
            criterion:
                "(c) V9 minus V10 with fewer than one false mark: what peeling adds to the map"
                    .to_owned(),
            holds: None,
            figures: figures(&gains),
        }
    }

    fn shams(&self, criteria: &Criteria) -> Verdict {
        let trials = || {
            self.heads
                .iter()
                .flat_map(|head| &head.trials)
                .filter(|trial| trial.is_searched && trial.sign == Sign::Sham)
        };
        let areas: Vec<(View, f64)> = (self.shown().into_iter())
            .map(|view| {
                let known = trials().map(|trial| self.sighting(trial, view).known);
                (view, mean(known))
            })
            .collect();
        let worst = areas
            .iter()
            .map(|(_, area)| (area - 0.5).abs())
            .fold(0.0, f64::max);
        let text: Vec<String> = areas
            .iter()
            .map(|(view, area)| format!("{} {area:.3}", short(*view)))
            .collect();
        // The area under the curve of n places at random has a deviation of 1/√(12 n).
        let by_chance = 2.0 / (12.0 * trials().count().max(1) as f64).sqrt();
        let most = criteria.most_leak.max(by_chance);
        Verdict {
            criterion: format!(
                "shams are at chance, within {} or, if they are few, two standard errors: {most:.3}",
                criteria.most_leak
            ),
            holds: (trials().count() > 0).then_some(worst <= most),
            figures: format!("{} ({} shams)", text.join(", "), trials().count()),
        }
    }

    fn lesions(&self) -> impl Iterator<Item = &Trial> {
        self.heads.iter().flat_map(lesions)
    }

    /// The difference between the hits of two views in one head, by bootstrap over its lesions.
    fn difference(
        &self,
        head: &HeadResult,
        more: View,
        less: View,
        false_marks: usize,
    ) -> Interval {
        let hit = |trial: &Trial, view| {
            f64::from(u8::from(is_hit(self.sighting(trial, view), false_marks)))
        };
        let pairs: Vec<f64> = lesions(head)
            .map(|trial| hit(trial, more) - hit(trial, less))
            .collect();
        bootstrap(&pairs, self.seed)
    }

    /// Hits of each view in each head, by sign and by size, and the criteria: a table in Markdown.
    pub fn table(&self, criteria: &Criteria) -> String {
        let mut text = String::new();
        let all: Vec<&Trial> = self.lesions().collect();
        let mut add = |name: &str, trials: &[&Trial]| {
            if trials.is_empty() {
                return;
            }
            let cells: Vec<String> = (self.shown().into_iter())
                .map(|view| {
                    let [one, five, twenty] =
                        [1, 5, 20].map(|marks| self.hits(trials, view, marks));
                    let known = mean(trials.iter().map(|trial| self.sighting(trial, view).known));
                    format!("{one:.2} / {five:.2} / {twenty:.2} ({known:.2})")
                })
                .collect();
            let _ = writeln!(
                text,
                "| {name} | {} | {} |",
                trials.len(),
                cells.join(" | ")
            );
        };
        for head in &self.heads {
            let tuned = if head.is_tuned { ", tuned" } else { "" };
            add(
                &format!("{}{tuned}", head.name),
                &lesions(head).collect::<Vec<_>>(),
            );
        }
        let untuned: Vec<&Trial> = self
            .heads
            .iter()
            .filter(|head| !head.is_tuned)
            .flat_map(lesions)
            .collect();
        add("**untuned**", &untuned);
        for sign in Sign::LESIONS {
            add(sign.name(), &chosen(&all, |trial| trial.sign == sign));
        }
        for radius_mm in [4.0, 6.0, 9.0] {
            let name = format!("radius {radius_mm} mm");
            add(&name, &chosen(&all, |trial| trial.radius_mm == radius_mm));
        }
        let blurred = |trial: &&Trial| trial.blur_mm >= 1.5;
        for radius_mm in [4.0, 6.0, 9.0] {
            let name = format!("blur of 1.5 mm or more, radius {radius_mm} mm, untuned");
            add(
                &name,
                &chosen(&untuned, |trial| {
                    blurred(&trial) && trial.radius_mm == radius_mm
                }),
            );
        }
        // Marks hit a sham by chance.
        let shams = self.heads.iter().flat_map(|head| &head.trials);
        let shams = shams.filter(|trial| trial.is_searched && trial.sign == Sign::Sham);
        add("shams", &shams.collect::<Vec<_>>());
        let names: Vec<&str> = self.shown().into_iter().map(View::name).collect();
        let rule = "|---".repeat(names.len() + 2);
        let head = format!("| lesions | n | {} |\n{rule}|\n", names.join(" | "));
        let mut verdicts = String::new();
        for verdict in self.verdicts(criteria) {
            let holds = match verdict.holds {
                Some(true) => "holds",
                Some(false) => "**fails**",
                None => "reported",
            };
            let _ = writeln!(
                verdicts,
                "* {}: {holds}. {}",
                verdict.criterion, verdict.figures
            );
        }
        let known = known_table(&self.known_place());
        format!(
            "Hits with fewer than 1 / 5 / 20 false marks per head; in brackets the area under the curve with a known place.\n\n{head}{text}\n{known}{verdicts}"
        )
    }
}

fn chosen<'a>(trials: &[&'a Trial], is_chosen: impl Fn(&'a Trial) -> bool) -> Vec<&'a Trial> {
    trials
        .iter()
        .copied()
        .filter(|trial| is_chosen(trial))
        .collect()
}

/// The lesions of a head that were searched for.
fn lesions(head: &HeadResult) -> impl Iterator<Item = &Trial> {
    let trials = head.trials.iter();
    trials.filter(|trial| trial.is_searched && trial.sign != Sign::Sham)
}

/// Whether a lesion is found with fewer than so many false marks.
pub(super) fn is_hit(sighting: &Sighting, false_marks: usize) -> bool {
    sighting
        .false_marks
        .is_some_and(|above| above < false_marks)
}

/// A mean with its 95 % interval.
fn bootstrap(values: &[f64], seed: u64) -> Interval {
    bootstrap_over([values.len()], seed, |[drawn]| {
        mean(drawn.iter().map(|&number| values[number]))
    })
}

/// A statistic of groups of this many members, with its 95 % interval. Each sample draws as many members of each group, by
/// number, with replacement.
pub(crate) fn bootstrap_over<const GROUPS: usize>(
    counts: [usize; GROUPS],
    seed: u64,
    statistic: impl Fn([&[usize]; GROUPS]) -> f64,
) -> Interval {
    let of = |groups: [Vec<usize>; GROUPS]| statistic(groups.each_ref().map(Vec::as_slice));
    let mut random = Random::new(seed);
    let mut samples: Vec<f64> = (0..ROUNDS)
        .map(|_| of(counts.map(|count| (0..count).map(|_| random.below(count)).collect())))
        .collect();
    samples.sort_by(f64::total_cmp);
    Interval {
        value: of(counts.map(|count| (0..count).collect())),
        low: samples[ROUNDS * 25 / 1000],
        high: samples[ROUNDS * 975 / 1000 - 1],
    }
}

fn figures(gains: &[(&str, Interval)]) -> String {
    let text: Vec<String> = gains
        .iter()
        .map(|(name, gain)| {
            format!(
                "{name} {:+.2} [{:+.2}, {:+.2}]",
                gain.value, gain.low, gain.high
            )
        })
        .collect();
    text.join("; ")
}

/// The index of a view.
fn short(view: View) -> &'static str {
    view.name().split(' ').next().unwrap_or_default()
}
