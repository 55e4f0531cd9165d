//! Lesions against shams with a known place: O1, and O2 with templates from the other heads.

use std::fmt::Write;

use serde::{Deserialize, Serialize};

use super::View;
use super::hotelling::{Group, Template, area};
use super::run::{HeadResult, Sign, Trial};

/// The area under the curve of lesions against shams with a known place, for two observers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct KnownPlace {
    /// The head or the sign.
    pub lesions: String,
    /// Number of lesions and of shams.
    pub counts: [usize; 2],
    /// O1, in the order of the views.
    pub o1: Vec<f64>,
    /// O2, trained on the other heads.
    pub o2: Vec<f64>,
}

/// See [`super::Report::known_place`].
pub(super) fn known_place(heads: &[HeadResult]) -> Vec<KnownPlace> {
    let mut trials = heads.iter().flat_map(|head| &head.trials);
    if trials.any(|trial| trial.channels.is_empty()) {
        return Vec::new();
    }
    let templates: Option<Vec<Vec<Template>>> = (0..heads.len())
        .map(|own| {
            View::ALL
                .map(|view| template(heads, own, view))
                .into_iter()
                .collect()
        })
        .collect();
    let Some(templates) = templates else {
        return Vec::new();
    };
    let judged = |own: usize, sign: Option<Sign>| {
        let head = &heads[own];
        let is_chosen = |trial: &&Trial| sign.is_none_or(|sign| trial.sign == sign);
        let [lesions, shams] = lesions_and_shams(head);
        let lesions: Vec<&Trial> = lesions.into_iter().filter(is_chosen).collect();
        let areas = |score: &dyn Fn(usize, &Trial) -> f64| -> Vec<f64> {
            let of = |view: usize, trials: &[&Trial]| -> Vec<f64> {
                trials.iter().map(|trial| score(view, trial)).collect()
            };
            let area = |view| area(&of(view, &lesions), &of(view, &shams));
            (0..View::ALL.len()).map(area).collect()
        };
        KnownPlace {
            lesions: head.name.clone(),
            counts: [lesions.len(), shams.len()],
            o1: areas(&|view, trial| trial.sightings[view].known),
            o2: areas(&|view, trial| templates[own][view].score(&trial.channels[view])),
        }
    };
    let of = |sign: Option<Sign>| -> Vec<KnownPlace> {
        let rows = (0..heads.len()).map(|own| judged(own, sign));
        rows.filter(|row| row.counts.iter().all(|&count| count > 0))
            .collect()
    };
    let mut rows = of(None);
    rows.push(averaged("**mean**", &rows));
    for sign in Sign::LESIONS {
        let of_sign = of(Some(sign));
        if !of_sign.is_empty() {
            rows.push(averaged(sign.name(), &of_sign));
        }
    }
    rows
}

/// The template of O2 for a head, trained on the others.
fn template(heads: &[HeadResult], own: usize, view: View) -> Option<Template> {
    let number = View::ALL.iter().position(|other| *other == view)?;
    let outputs = |trial: &Trial| trial.channels[number];
    let others = heads.iter().enumerate();
    let groups: Vec<Group> = others
        .filter(|(other, _)| *other != own)
        .map(|(_, head)| {
            let [with, without] =
                lesions_and_shams(head).map(|trials| trials.into_iter().map(outputs).collect());
            Group { with, without }
        })
        .collect();
    Template::trained(&groups)
}

/// O1 / O2 as a table in Markdown.
pub(super) fn known_table(rows: &[KnownPlace]) -> String {
    if rows.is_empty() {
        return String::new();
    }
    let names: Vec<&str> = View::ALL.map(View::name).to_vec();
    let mut text = format!(
        "Area under the curve of lesions against shams with a known place: O1 / O2, a channelised Hotelling observer trained on the other heads.\n\n| lesions | n, shams | {} |\n{}|\n",
        names.join(" | "),
        "|---".repeat(names.len() + 2)
    );
    for row in rows {
        let pairs = row.o1.iter().zip(&row.o2);
        let cells: Vec<String> = pairs.map(|(o1, o2)| format!("{o1:.2} / {o2:.2}")).collect();
        let [with, without] = row.counts;
        let (name, cells) = (&row.lesions, cells.join(" | "));
        let _ = writeln!(text, "| {name} | {with}, {without} | {cells} |");
    }
    text.push('\n');
    text
}

/// The mean of heads, with the sums of their counts.
fn averaged(name: &str, heads: &[KnownPlace]) -> KnownPlace {
    let of = |areas: &dyn Fn(&KnownPlace) -> &Vec<f64>| -> Vec<f64> {
        let view = |view: usize| mean(heads.iter().map(|head| areas(head)[view]));
        (0..View::ALL.len()).map(view).collect()
    };
    KnownPlace {
        lesions: name.to_owned(),
        counts: [0, 1].map(|n| heads.iter().map(|head| head.counts[n]).sum()),
        o1: of(&|head| &head.o1),
        o2: of(&|head| &head.o2),
    }
}

/// All lesions and all shams of a head, searched for or not.
fn lesions_and_shams(head: &HeadResult) -> [Vec<&Trial>; 2] {
    let trials = head.trials.iter();
    let (shams, lesions) = trials.partition(|trial| trial.sign == Sign::Sham);
    [lesions, shams]
}

pub(super) fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0usize), |(sum, count), value| {
        (sum + value, count + 1)
    });
    sum / count.max(1) as f64
}
