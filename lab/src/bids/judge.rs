//! Compares marks with truths: what is found before how many false marks, and what would be found by chance.

use std::collections::BTreeMap;
use std::path::Path;

use glam::DVec3;
use serde::Serialize;

use super::head::Found;
use super::participants::{Table, is_same_head};
use super::truth::{Lesion, Lesions, Rules};
use crate::BenchError;
use crate::study::{Mark, Touch, false_marks_before_hit};

/// The marks of a program in all heads.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct MarkList {
    /// The name in the report.
    pub(super) name: String,
    /// The marks of each head, the highest first.
    pub(super) heads: BTreeMap<String, Vec<Mark>>,
    /// The heads of a file that are not among the heads of the trial.
    pub(super) unknown: Vec<String>,
}

/// What a program finds of one lesion.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct JudgedLesion {
    /// The number of false marks above the first hit; `None` if no mark hits it.
    pub(super) false_marks: Option<usize>,
    /// The score of the first hit.
    pub(super) hit_score: Option<f32>,
    /// The same with the lesion at its mirrored place.
    pub(super) mirrored: Option<usize>,
    /// The same with the lesion at random cortical places.
    #[serde(skip)]
    pub(super) random: Vec<Option<usize>>,
}

/// What a program marks in one head.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct JudgedHead {
    pub(super) lesions: Vec<JudgedLesion>,
    /// All scores, the highest first.
    pub(super) scores: Vec<f32>,
    /// Those of false marks.
    pub(super) false_scores: Vec<f32>,
}

/// Judges the marks in a head. A head without a lesion has false marks alone.
pub(super) fn judge(marks: &[Mark], lesions: &Lesions, found: &Found, rules: &Rules) -> JudgedHead {
    let touches: Vec<Vec<Touch>> = marks
        .iter()
        .map(|mark| lesions.touches(mark.position_in_patient, rules))
        .collect();
    let is_false = |touches: &[Touch]| touches.iter().all(|touch| *touch == Touch::False);
    let of_mark = marks.iter().zip(&touches);
    let without_truth = || {
        let apart = of_mark.clone().filter(|(_, touches)| is_false(touches));
        apart.map(|(mark, _)| mark.position_in_patient)
    };
    let judged = |(number, lesion): (usize, &Lesion)| {
        let first = touches
            .iter()
            .position(|touches| touches[number] == Touch::Hit);
        // What hits a truth says nothing about chance.
        let by_chance = |moved: &dyn Fn(DVec3) -> DVec3| {
            let marks = without_truth();
            false_marks_before_hit(marks.map(|mark| lesion.touch(moved(mark), rules)))
        };
        let plane = found.mirror_plane();
        JudgedLesion {
            false_marks: false_marks_before_hit(touches.iter().map(|touches| touches[number])),
            hit_score: first.map(|first| marks[first].score),
            mirrored: by_chance(&|mark| plane.reflected(mark)),
            random: found
                .places
                .iter()
                .map(|place| {
                    let shift = DVec3::from_array(*place) - lesion.centre_in_head();
                    by_chance(&|mark| mark - shift)
                })
                .collect(),
        }
    };
    JudgedHead {
        lesions: lesions.lesions.iter().enumerate().map(judged).collect(),
        scores: marks.iter().map(|mark| mark.score).collect(),
        false_scores: of_mark
            .clone()
            .filter(|(_, touches)| is_false(touches))
            .map(|(mark, _)| mark.score)
            .collect(),
    }
}

impl MarkList {
    /// The candidates of the map.
    pub(super) fn own<'a>(heads: impl Iterator<Item = (&'a str, &'a Found)>) -> Self {
        let marks = |found: &Found| {
            let marks = found.marks.iter().map(|mark| Mark {
                position_in_patient: DVec3::from_array(mark.position_in_patient),
                score: mark.score,
            });
            marks.collect()
        };
        Self {
            name: "blur".to_owned(),
            heads: heads
                .map(|(name, found)| (name.to_owned(), marks(found)))
                .collect(),
            unknown: Vec::new(),
        }
    }

    /// The marks of another program: a table with the columns `participant_id`, `x`, `y`, `z` (the scanner's mm of the T1-weighted
    /// volume as NIfTI has them: x to the right, y to the front, z upwards) and `score`. A head without a row has no mark.
    ///
    /// # Errors
    /// If the table cannot be read, a number is none, or no row belongs to a head.
    pub(super) fn of_file(path: &Path, heads: &[&str]) -> Result<Self, BenchError> {
        let table = Table::read(path)?;
        for column in ["x", "y", "z", "score"] {
            table.check_column(column)?;
        }
        let mut list = Self {
            name: super::folder::name_of(path),
            heads: heads
                .iter()
                .map(|head| ((*head).to_owned(), Vec::new()))
                .collect(),
            unknown: Vec::new(),
        };
        for (number, row) in (2..).zip(table.rows()) {
            let values = ["x", "y", "z", "score"].map(|column| {
                let value: Option<f64> = row.get(column).and_then(|value| value.parse().ok());
                value.filter(|value| value.is_finite()).ok_or_else(|| {
                    BenchError::Usage(format!(
                        "row {number} of {}: {column} must be a number",
                        path.display()
                    ))
                })
            });
            let [x, y, z, score] = values;
            // NIfTI points to the right and to the front, LPS to the left and to the back.
            let mark = Mark {
                position_in_patient: DVec3::new(-x?, -y?, z?),
                score: score? as f32,
            };
            let marks = list
                .heads
                .iter_mut()
                .find(|(head, _)| is_same_head(head, row.id()));
            match marks {
                Some((_, marks)) => marks.push(mark),
                None if list.unknown.iter().all(|known| known != row.id()) => {
                    list.unknown.push(row.id().to_owned());
                }
                None => {}
            }
        }
        if list.heads.values().all(Vec::is_empty) {
            return Err(BenchError::Usage(format!(
                "{} has no mark in any head of the trial",
                path.display()
            )));
        }
        for marks in list.heads.values_mut() {
            marks.sort_by(|one, other| other.score.total_cmp(&one.score));
        }
        Ok(list)
    }
}
