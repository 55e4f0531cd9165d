//! The page of results: four lesions from both simulators, in the lists that the program makes.

use std::fmt::Write;

use analysis::ScoreLimits;

use super::report::{Interval, is_hit};
use super::run::{FOUR_LESIONS, HeadResult, Sign, Trial};
use super::{Area, Report, View};

/// A lesion counts as found if its mark has fewer than so many false marks above it.
const FEWER_THAN: [usize; 3] = [1, 5, 20];
/// The depths of the places, in mm: from the first to below the second.
const DEPTHS_MM: [[f32; 2]; 4] = [[4.0, 8.0], [8.0, 15.0], [15.0, 25.0], [25.0, f32::INFINITY]];

/// The name of a list, its view, and its limits.
const LISTS: [(&str, View, ScoreLimits); 2] = [
    ("`blur`", View::BlurList, ScoreLimits::BLUR),
    ("`thickness`", View::Thickness, ScoreLimits::THICKNESS),
];

/// The list that is made for a lesion: its name and its view.
fn own_list(sign: Sign) -> (&'static str, View) {
    let (name, view, _) = LISTS[usize::from(sign == Sign::Thickening)];
    (name, view)
}

/// The page in Markdown, from the runs with each simulator.
///
/// # Panics
/// If a report lacks one of the lists.
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
        for list in LISTS {
            for report in reports {
                text += &found(report, sign, list);
            }
        }
    }
    text += &strata(reports);
    for report in reports.iter().take(1) {
        text += &sound(report);
    }
    text
}

/// A row of one lesion in one list.
fn found(report: &Report, sign: Sign, (list, view, limits): (&str, View, ScoreLimits)) -> String {
    let trials: Vec<&Trial> = of_sign(report, sign).collect();
    if trials.is_empty() {
        return String::new();
    }
    let share = |is_found: &dyn Fn(&Trial) -> bool| {
        let count = trials.iter().filter(|trial| is_found(trial)).count();
        words(Interval::of_count(count, trials.len()))
    };
    let ranks = FEWER_THAN
        .map(|fewer_than| share(&|trial| is_hit(report.sighting(trial, view), fewer_than)));
    let scores = |is_high: fn(f32, ScoreLimits) -> bool| {
        share(&|trial| {
            let score = report.sighting(trial, view).score;
            score.is_some_and(|score| is_high(score, limits))
        })
    };
    let borderline = scores(|score, limits| score >= limits.borderline_from);
    let unusual = scores(|score, limits| score > limits.unusual_above);
    format!(
        "| {} | {list} | {} | {} | {} | {borderline} | {unusual} |\n",
        sign.name(),
        report.simulator.name(),
        trials.len(),
        ranks.join(" | "),
    )
}

/// The lesions by area and by depth, with fewer than five false marks in the list that is made for them.
fn strata(reports: &[Report]) -> String {
    let signs = FOUR_LESIONS.map(|(sign, ..)| sign);
    let simulators: Vec<&str> = reports
        .iter()
        .map(|report| report.simulator.name())
        .collect();
    let columns = signs.map(|sign| format!("{} in {}", sign.name(), own_list(sign).0));
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
                    let view = own_list(sign).1;
                    let hits = trials
                        .iter()
                        .filter(|trial| is_hit(report.sighting(trial, view), 5));
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
fn sound(report: &Report) -> String {
    let mut text = "\nHeads without a lesion.\n\n".to_owned();
    for (list, view, limits) in LISTS {
        let highest: Vec<(&str, f32)> = (report.heads.iter())
            .filter_map(|head| Some((head.name.as_str(), highest(report, head, view)?)))
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
fn highest(report: &Report, head: &HeadResult, view: View) -> Option<f32> {
    let sham = head.trials.iter().find(|trial| trial.sign == Sign::Sham)?;
    report.sighting(sham, view).highest
}

fn of_sign(report: &Report, sign: Sign) -> impl Iterator<Item = &Trial> {
    let trials = report.heads.iter().flat_map(|head| &head.trials);
    trials.filter(move |trial| trial.is_searched && trial.sign == sign)
}

fn words(share: Interval) -> String {
    format!("{:.2} ({:.2} to {:.2})", share.value, share.low, share.high)
}
