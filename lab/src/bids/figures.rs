//! The figures of a trial: shares with intervals, areas, thresholds, strata, chance.

use serde::Serialize;

use super::head::PLACES;
use super::judge::{JudgedHead, JudgedLesion};
use crate::statistics::{Interval, area, bootstrap_over};

/// The numbers of false marks in the tables: found with fewer than these.
pub(super) const FALSE_MARKS: [usize; 3] = [1, 5, 20];

/// The marks per control at which thresholds are set.
const MARKS_PER_CONTROL: [f64; 3] = [0.5, 1.0, 2.0];

/// A patient with what was found.
#[derive(Debug, Clone)]
pub(super) struct JudgedPatient<'a> {
    pub(super) head: &'a JudgedHead,
    /// The strata of each lesion.
    pub(super) strata: &'a [Vec<(String, String)>],
}

/// The share of lesions that are found with fewer than 1, 5 and 20 false marks.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Shares {
    pub(super) name: String,
    pub(super) lesions: usize,
    pub(super) patients: usize,
    /// Bootstrapped over patients.
    pub(super) found: [Interval; 3],
}

/// Sensitivity and specificity at a threshold of the score.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct AtThreshold {
    /// Where the threshold comes from.
    pub(super) name: String,
    /// Marks above this count.
    pub(super) above: f32,
    pub(super) lesions_found: Option<Interval>,
    pub(super) patients_found: Option<Interval>,
    pub(super) patients_with_marks: Option<Interval>,
    pub(super) controls_without_marks: Option<Interval>,
    pub(super) marks_per_control: Option<f64>,
    pub(super) false_marks_per_patient: Option<f64>,
}

/// All figures of one list of marks.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Figures {
    pub(super) list: String,
    /// Of lesions; then of patients, with any lesion; then of lesions with heads without maps as missed.
    pub(super) shares: Vec<Shares>,
    pub(super) chance: Vec<Shares>,
    pub(super) strata: Vec<(String, Vec<Shares>)>,
    /// The area under the curve of the highest score of patients against controls.
    pub(super) area: Option<Interval>,
    pub(super) thresholds: Vec<AtThreshold>,
    /// The number of false marks above each lesion.
    #[serde(skip)]
    pub(super) false_marks: Vec<Option<usize>>,
    #[serde(skip)]
    pub(super) highest: [Vec<f32>; 2],
}

/// Whether a lesion is found with fewer than so many false marks.
fn is_found(above: Option<usize>, fewer_than: usize) -> f64 {
    f64::from(u8::from(above.is_some_and(|above| above < fewer_than)))
}

/// The quotient of sums over patients: the parts over the wholes.
fn quotient(patients: &[(f64, f64)], seed: u64) -> Interval {
    bootstrap_over([patients.len()], seed, |[drawn]| {
        let (part, whole) = drawn.iter().fold((0.0, 0.0), |(part, whole), &number| {
            (part + patients[number].0, whole + patients[number].1)
        });
        part / f64::max(whole, 1.0)
    })
}

/// A share whose parts and wholes come from patients. If all or nothing is found, every sample is the same: then the interval is that of
/// Wilson for the number of patients.
fn share(patients: &[(f64, f64)], seed: u64) -> Interval {
    let share = quotient(patients, seed);
    let count = patients.len();
    match share.value {
        0.0 => Interval::of_count(0, count),
        1.0 => Interval::of_count(count, count),
        _ => share,
    }
}

/// Shares from, for each patient and each of the numbers of false marks, the found and all lesions; patients without a lesion are left
/// out.
fn shares(
    name: &str,
    patients: &[Vec<&JudgedLesion>],
    seed: u64,
    found: impl Fn(&JudgedLesion, usize) -> f64,
) -> Option<Shares> {
    let with: Vec<&Vec<&JudgedLesion>> = patients.iter().filter(|all| !all.is_empty()).collect();
    let of = |fewer_than: usize| {
        let each = with.iter().map(|lesions| {
            let hits: f64 = lesions.iter().map(|lesion| found(lesion, fewer_than)).sum();
            (hits, lesions.len() as f64)
        });
        share(&each.collect::<Vec<_>>(), seed)
    };
    (!with.is_empty()).then(|| Shares {
        name: name.to_owned(),
        lesions: with.iter().map(|lesions| lesions.len()).sum(),
        patients: with.len(),
        found: FALSE_MARKS.map(of),
    })
}

impl Figures {
    /// `missed` has the number of lesions of each patient without maps. `limits` are thresholds that are known before, with their
    /// names.
    pub(super) fn of(
        list: &str,
        patients: &[JudgedPatient<'_>],
        controls: &[&JudgedHead],
        missed: usize,
        (limits, seed): (&[(&str, f32)], u64),
    ) -> Self {
        let own = |lesion: &JudgedLesion, fewer_than| is_found(lesion.false_marks, fewer_than);
        let all: Vec<Vec<&JudgedLesion>> = patients
            .iter()
            .map(|patient| patient.head.lesions.iter().collect())
            .collect();
        let mut rows: Vec<Shares> = Vec::new();
        rows.extend(shares("lesions", &all, seed, own));
        rows.extend(patients_found(patients, seed));
        if missed > 0 && !rows.is_empty() {
            let nothing = JudgedLesion {
                false_marks: None,
                hit_score: None,
                mirrored: None,
                random: Vec::new(),
            };
            let none = std::iter::repeat_n(vec![&nothing], missed);
            let with: Vec<_> = all.iter().cloned().chain(none).collect();
            let name = "lesions, with patients without maps as one missed lesion each";
            rows.extend(shares(name, &with, seed, own));
        }
        let by_mirror = |lesion: &JudgedLesion, fewer_than| is_found(lesion.mirrored, fewer_than);
        let at_random = |lesion: &JudgedLesion, fewer_than| {
            let hits = lesion.random.iter();
            let hits: f64 = hits.map(|above| is_found(*above, fewer_than)).sum();
            hits / lesion.random.len().max(1) as f64
        };
        let chance = [
            shares("moved to their mirrored places", &all, seed, by_mirror),
            shares(
                &format!("moved to {PLACES} random cortical places"),
                &all,
                seed,
                at_random,
            ),
        ];
        let highest = |heads: &mut dyn Iterator<Item = &JudgedHead>| -> Vec<f32> {
            heads
                .map(|head| head.scores.first().copied().unwrap_or(f32::NEG_INFINITY))
                .collect()
        };
        let highest = [
            highest(&mut patients.iter().map(|patient| patient.head)),
            highest(&mut controls.iter().copied()),
        ];
        let lesions = patients.iter().flat_map(|patient| &patient.head.lesions);
        let mut figures = Self {
            list: list.to_owned(),
            shares: rows,
            chance: chance.into_iter().flatten().collect(),
            strata: strata(patients, seed, own),
            area: area_of(&highest, seed),
            thresholds: Vec::new(),
            false_marks: lesions.map(|lesion| lesion.false_marks).collect(),
            highest,
        };
        figures.thresholds = thresholds(patients, controls, (limits, seed));
        figures
    }
}

/// Patients with any lesion found.
fn patients_found(patients: &[JudgedPatient<'_>], seed: u64) -> Option<Shares> {
    let of = |fewer_than: usize| {
        let each = patients.iter().map(|patient| {
            let mut lesions = patient.head.lesions.iter();
            let is_any = lesions.any(|lesion| is_found(lesion.false_marks, fewer_than) > 0.0);
            (f64::from(u8::from(is_any)), 1.0)
        });
        share(&each.collect::<Vec<_>>(), seed)
    };
    (!patients.is_empty()).then(|| Shares {
        name: "patients, with any lesion".to_owned(),
        lesions: patients
            .iter()
            .map(|patient| patient.head.lesions.len())
            .sum(),
        patients: patients.len(),
        found: FALSE_MARKS.map(of),
    })
}

fn strata(
    patients: &[JudgedPatient<'_>],
    seed: u64,
    own: impl Fn(&JudgedLesion, usize) -> f64 + Copy,
) -> Vec<(String, Vec<Shares>)> {
    let tags = || {
        patients
            .iter()
            .flat_map(|patient| patient.strata.iter().flatten())
    };
    let mut names: Vec<&str> = Vec::new();
    for (name, _) in tags() {
        if !names.contains(&name.as_str()) {
            names.push(name);
        }
    }
    let rows = |name: &str| {
        let mut values: Vec<&str> = tags()
            .filter(|(other, _)| other == name)
            .map(|(_, value)| value.as_str())
            .collect();
        values.sort_unstable();
        values.dedup();
        let row = |value: &str| {
            let chosen: Vec<Vec<&JudgedLesion>> = patients
                .iter()
                .map(|patient| {
                    let lesions = patient.head.lesions.iter().zip(patient.strata);
                    lesions
                        .filter(|(_, tags)| {
                            tags.iter()
                                .any(|(other, own)| other == name && own == value)
                        })
                        .map(|(lesion, _)| lesion)
                        .collect()
                })
                .collect();
            shares(value, &chosen, seed, own)
        };
        values.into_iter().filter_map(row).collect()
    };
    names
        .into_iter()
        .map(|name| (name.to_owned(), rows(name)))
        .collect()
}

fn area_of([patients, controls]: &[Vec<f32>; 2], seed: u64) -> Option<Interval> {
    let counts = [patients.len(), controls.len()];
    let of = |scores: &[f32], drawn: &[usize]| -> Vec<f64> {
        drawn
            .iter()
            .map(|&number| f64::from(scores[number]))
            .collect()
    };
    (!counts.contains(&0)).then(|| {
        bootstrap_over(counts, seed, |[with, without]| {
            area(&of(patients, with), &of(controls, without))
        })
    })
}

fn thresholds(
    patients: &[JudgedPatient<'_>],
    controls: &[&JudgedHead],
    (limits, seed): (&[(&str, f32)], u64),
) -> Vec<AtThreshold> {
    let mut scores: Vec<f32> = controls
        .iter()
        .flat_map(|head| head.scores.iter().copied())
        .collect();
    scores.sort_by(|one, other| other.total_cmp(one));
    let at_rate = |rate: f64| {
        // So many marks of all controls are above the next one.
        let marks = (rate * controls.len() as f64).floor() as usize;
        let above = scores.get(marks).copied().unwrap_or(f32::NEG_INFINITY);
        (format!("{rate} marks per control"), above)
    };
    let rates = MARKS_PER_CONTROL
        .into_iter()
        .filter(|_| !controls.is_empty())
        .map(at_rate);
    let limits = limits
        .iter()
        .map(|(name, above)| ((*name).to_owned(), *above));
    rates
        .chain(limits)
        .map(|(name, above)| at_threshold(name, above, patients, controls, seed))
        .collect()
}

fn at_threshold(
    name: String,
    above: f32,
    patients: &[JudgedPatient<'_>],
    controls: &[&JudgedHead],
    seed: u64,
) -> AtThreshold {
    let is_hit = |lesion: &JudgedLesion| lesion.hit_score.is_some_and(|score| score > above);
    let share = |each: Vec<(f64, f64)>| (!each.is_empty()).then(|| share(&each, seed));
    let bit = |holds: bool| (f64::from(u8::from(holds)), 1.0);
    let is_marked = |head: &JudgedHead| head.scores.first().is_some_and(|&score| score > above);
    let count = |scores: &[f32]| scores.iter().filter(|&&score| score > above).count() as f64;
    let mean = |counts: Vec<f64>| {
        (!counts.is_empty()).then(|| counts.iter().sum::<f64>() / counts.len() as f64)
    };
    let heads = || patients.iter().map(|patient| patient.head);
    let lesions = heads().map(|head| {
        let hits = head.lesions.iter().filter(|lesion| is_hit(lesion)).count();
        (hits as f64, head.lesions.len() as f64)
    });
    AtThreshold {
        name,
        above,
        lesions_found: share(lesions.collect()),
        patients_found: share(
            heads()
                .map(|head| bit(head.lesions.iter().any(is_hit)))
                .collect(),
        ),
        patients_with_marks: share(heads().map(|head| bit(is_marked(head))).collect()),
        controls_without_marks: share(controls.iter().map(|head| bit(!is_marked(head))).collect()),
        marks_per_control: mean(controls.iter().map(|head| count(&head.scores)).collect()),
        false_marks_per_patient: mean(heads().map(|head| count(&head.false_scores)).collect()),
    }
}

/// The difference between the shares of lesions that two lists find with fewer than so many false marks, over the same patients.
pub(super) fn difference(
    one: &[JudgedPatient<'_>],
    other: &[JudgedPatient<'_>],
    seed: u64,
) -> [Interval; 3] {
    FALSE_MARKS.map(|fewer_than| {
        let hits = |patient: &JudgedPatient<'_>| -> f64 {
            let lesions = patient.head.lesions.iter();
            lesions
                .map(|lesion| is_found(lesion.false_marks, fewer_than))
                .sum()
        };
        let each = one
            .iter()
            .zip(other)
            .map(|(one, other)| (hits(one) - hits(other), one.head.lesions.len() as f64));
        quotient(&each.collect::<Vec<_>>(), seed)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lesion(false_marks: Option<usize>, hit_score: Option<f32>) -> JudgedLesion {
        JudgedLesion {
            false_marks,
            hit_score,
            mirrored: None,
            random: vec![Some(0), None, None, Some(7)],
        }
    }

    fn head(lesions: Vec<JudgedLesion>, scores: &[f32]) -> JudgedHead {
        JudgedHead {
            lesions,
            scores: scores.to_vec(),
            false_scores: scores[1..].to_vec(),
        }
    }

    #[test]
    fn shares_thresholds_and_areas_are_those_on_paper() {
        let heads = [
            head(vec![lesion(Some(0), Some(3.0))], &[3.0, 1.0]),
            head(
                vec![lesion(Some(4), Some(1.5)), lesion(None, None)],
                &[2.5, 1.5],
            ),
        ];
        let tag = |value: &str| vec![("side".to_owned(), value.to_owned())];
        let strata = [vec![tag("left")], vec![tag("right"), tag("left")]];
        let patients: Vec<JudgedPatient<'_>> = heads
            .iter()
            .zip(&strata)
            .map(|(head, strata)| JudgedPatient { head, strata })
            .collect();
        let sound = [head(vec![], &[2.0, 1.8]), head(vec![], &[2.75, 0.5])];
        let controls: Vec<&JudgedHead> = sound.iter().collect();
        let figures = Figures::of("own", &patients, &controls, 1, (&[("limit", 2.6)], 1));
        let value = |row: &Shares| row.found.map(|share| share.value);
        assert_eq!(value(&figures.shares[0]), [1.0 / 3.0, 2.0 / 3.0, 2.0 / 3.0]);
        assert_eq!(value(&figures.shares[1]), [0.5, 1.0, 1.0]);
        assert_eq!(value(&figures.shares[2]), [0.25, 0.5, 0.5]);
        assert_eq!(value(&figures.chance[0]), [0.0; 3]);
        assert_eq!(value(&figures.chance[1]), [0.25, 0.25, 0.5]);
        let [left, right] = figures.strata[0].1.as_slice() else {
            panic!("{:?}", figures.strata);
        };
        assert_eq!((left.lesions, left.patients), (2, 2));
        assert_eq!((value(left)[1], value(right)[1]), (0.5, 1.0));
        // 3.0 exceeds both, 2.5 one of two.
        assert_eq!(figures.area.map(|area| area.value), Some(0.75));
        let above: Vec<f32> = figures.thresholds.iter().map(|at| at.above).collect();
        assert_eq!(above, [2.0, 1.8, f32::NEG_INFINITY, 2.6]);
        let limit = &figures.thresholds[3];
        assert_eq!(
            limit.controls_without_marks.map(|share| share.value),
            Some(0.5)
        );
        assert_eq!(
            limit.lesions_found.map(|share| share.value),
            Some(1.0 / 3.0)
        );
        assert_eq!(limit.marks_per_control, Some(0.5));
        let half = &figures.thresholds[0];
        assert_eq!(half.marks_per_control, Some(0.5));
    }

    #[test]
    fn intervals_are_drawn_from_patients_not_from_lesions() {
        let many = vec![lesion(Some(0), Some(1.0)); 20];
        let heads = [
            head(many, &[1.0]),
            head(vec![lesion(None, None); 20], &[1.0]),
        ];
        let patients: Vec<JudgedPatient<'_>> = heads
            .iter()
            .map(|head| JudgedPatient { head, strata: &[] })
            .collect();
        let figures = Figures::of("own", &patients, &[], 0, (&[], 1));
        let half = figures.shares[0].found[0];
        assert_eq!((half.value, half.low, half.high), (0.5, 0.0, 1.0));
        assert!(figures.area.is_none());
        let all = share(&[(1.0, 1.0); 8], 1);
        // 8 of 8: 0.676 to 1.
        assert!((all.low - 0.676).abs() < 1e-3 && all.high == 1.0);
        let none = share(&[(0.0, 3.0); 8], 1);
        assert!(none.low == 0.0 && (none.high - 0.324).abs() < 1e-3);
    }
}
