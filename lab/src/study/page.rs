//! The page of results: four lesions from each simulator, in the lists that the program makes.

use std::fmt::Write;

use analysis::ScoreLimits;

use super::Area;
use super::run::{FOUR_LESIONS, HeadResult, Sighting, Sign, Simulator, Trial};
use crate::statistics::Interval;

/// A lesion counts as found if its mark has fewer than so many false marks above it.
const FEWER_THAN: [usize; 3] = [1, 5, 20];
/// The depths of the places, in mm: from the first to below the second.
const DEPTHS_MM: [[f32; 2]; 4] = [[4.0, 8.0], [8.0, 15.0], [15.0, 25.0], [25.0, f32::INFINITY]];

/// The names of the lists and their limits, in the order of the sightings of a trial.
const LISTS: [(&str, ScoreLimits); 2] = [
    ("`blur`", ScoreLimits::BLUR),
    ("`thickness`", ScoreLimits::THICKNESS),
];

/// The number of the list that is made for a lesion.
fn own_list(sign: Sign) -> usize {
    usize::from(sign == Sign::Thickening)
}

/// The heads with lesions from one simulator.
pub type Report = (Simulator, Vec<HeadResult>);

/// The page in Markdown, from the runs with each simulator.
pub fn page(reports: &[Report]) -> String {
    let mut text = format!(
        "Share of lesions found in each list, with 95 % intervals (Wilson, over the lesions).\n\n| lesion | list | simulator | n | < 1 false mark | < 5 | < 20 | borderline or above | unusual |\n{}|\n",
        "|---".repeat(9)
    );
    for sign in FOUR_LESIONS
        .map(|(sign, ..)| sign)
        .into_iter()
        .chain([Sign::Sham])
    {
        for list in 0..LISTS.len() {
            for report in reports {
                text += &found(report, sign, list);
            }
        }
    }
    text += &strata(reports);
    if let Some((_, heads)) = reports.first() {
        text += &sound(heads);
    }
    text
}

/// A row of one lesion in one list.
fn found(report: &Report, sign: Sign, list: usize) -> String {
    let (name, limits) = LISTS[list];
    let trials: Vec<&Trial> = of_sign(report, sign).collect();
    if trials.is_empty() {
        return String::new();
    }
    let share = |is_found: &dyn Fn(&Trial) -> bool| {
        let count = trials.iter().filter(|trial| is_found(trial)).count();
        words(Interval::of_count(count, trials.len()))
    };
    let ranks =
        FEWER_THAN.map(|fewer_than| share(&|trial| is_hit(&trial.sightings[list], fewer_than)));
    let scores = |is_high: fn(f32, ScoreLimits) -> bool| {
        share(&|trial| {
            let score = trial.sightings[list].score;
            score.is_some_and(|score| is_high(score, limits))
        })
    };
    let borderline = scores(|score, limits| score >= limits.borderline_from);
    let unusual = scores(|score, limits| score > limits.unusual_above);
    format!(
        "| {} | {name} | {} | {} | {} | {borderline} | {unusual} |\n",
        sign.name(),
        report.0.name(),
        trials.len(),
        ranks.join(" | "),
    )
}

/// The lesions by area and by depth, with fewer than five false marks in the list that is made for them.
fn strata(reports: &[Report]) -> String {
    let signs = FOUR_LESIONS.map(|(sign, ..)| sign);
    let simulators: Vec<&str> = reports
        .iter()
        .map(|(simulator, _)| simulator.name())
        .collect();
    let columns = signs.map(|sign| format!("{} in {}", sign.name(), LISTS[own_list(sign)].0));
    let mut text = format!(
        "\nFound with fewer than five false marks, by place: {}; then the number of lesions.\n\n| place | {} |\n{}|\n",
        simulators.join(" / "),
        columns.join(" | "),
        "|---".repeat(signs.len() + 1)
    );
    let mut row = |name: &str, is_of: &dyn Fn(&Trial) -> bool| {
        let cells = signs.map(|sign| {
            let mut count = 0;
            let shares: Vec<String> = reports
                .iter()
                .map(|report| {
                    let trials: Vec<&Trial> =
                        of_sign(report, sign).filter(|trial| is_of(trial)).collect();
                    let hits = trials
                        .iter()
                        .filter(|trial| is_hit(&trial.sightings[own_list(sign)], 5));
                    count = trials.len();
                    words(Interval::of_count(hits.count(), count))
                })
                .collect();
            if count == 0 {
                return "none".to_owned();
            }
            format!("{}, {count}", shares.join(" / "))
        });
        let _ = writeln!(text, "| {name} | {} |", cells.join(" | "));
    };
    for area in Area::ALL {
        row(area.name(), &|trial| trial.area == area);
    }
    for [from, below] in DEPTHS_MM {
        let name = if below.is_finite() {
            format!("{from} to {below} mm deep")
        } else {
            format!("from {from} mm on")
        };
        row(&name, &|trial| (from..below).contains(&trial.depth_mm));
    }
    text
}

/// The highest places of the heads without a lesion.
fn sound(heads: &[HeadResult]) -> String {
    let mut text = "\nHeads without a lesion.\n\n".to_owned();
    for (number, (list, limits)) in LISTS.into_iter().enumerate() {
        let highest: Vec<(&str, f32)> = (heads.iter())
            .filter_map(|head| Some((head.name.as_str(), highest(head, number)?)))
            .collect();
        let below = |limit: f32| highest.iter().filter(|(_, score)| *score <= limit).count();
        let (yes, borderline) = (limits.unusual_above, limits.borderline_from);
        let scores: Vec<String> = (highest.iter())
            .map(|(name, score)| format!("{name} {score:.2}"))
            .collect();
        let _ = writeln!(
            text,
            "* The list {list} has nothing above {yes} in {} of {} heads, and nothing above {borderline} in {}. The highest scores: {}.",
            below(yes),
            highest.len(),
            below(borderline),
            scores.join(", ")
        );
    }
    text
}

/// The highest score of a head without a lesion, which a sham does not change; `None` without a sham.
fn highest(head: &HeadResult, list: usize) -> Option<f32> {
    let sham = head.trials.iter().find(|trial| trial.sign == Sign::Sham)?;
    sham.sightings[list].highest
}

fn of_sign(report: &Report, sign: Sign) -> impl Iterator<Item = &Trial> {
    let trials = report.1.iter().flat_map(|head| &head.trials);
    trials.filter(move |trial| trial.sign == sign)
}

/// Whether a lesion is found with fewer than so many false marks.
fn is_hit(sighting: &Sighting, false_marks: usize) -> bool {
    sighting
        .false_marks
        .is_some_and(|above| above < false_marks)
}

fn words(share: Interval) -> String {
    format!("{:.2} ({:.2} to {:.2})", share.value, share.low, share.high)
}
