//! The report of a trial: one HTML file without scripts, JSON, and a few lines for a terminal.

use std::fmt::Write;

use maud::{DOCTYPE, Markup, PreEscaped, html};
use serde_json::{Value, json};

use super::figures::{AtThreshold, FALSE_MARKS, Figures, Shares};
use super::freeze::Frozen;
use super::head::PLACES;
use super::judge::{JudgedHead, MarkList};
use super::{Judgeable, Remark, Role, Rules, Selection};
use crate::plots::false_mark_curves;
use crate::statistics::Interval;

const STYLE: &str = include_str!("report.css");

/// What the file may load: nothing.
const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'";

/// The report of a trial.
#[derive(Debug, Clone)]
pub struct TrialReport {
    folders: usize,
    /// Number of patients and of controls with a result.
    judged: [usize; 2],
    heads: Vec<HeadRow>,
    figures: Vec<Figures>,
    /// The difference between the shares of two lists.
    differences: Vec<(String, [Interval; 3])>,
    left_out: Vec<Remark>,
    remarks: Vec<Remark>,
    frozen: Option<Frozen>,
}

/// A head in the table of all heads.
#[derive(Debug, Clone)]
struct HeadRow {
    name: String,
    role: Role,
    mask: String,
    lesions: Vec<LesionRow>,
    /// The highest score of each list.
    highest: Vec<Option<f32>>,
}

/// A lesion in the table of all heads.
#[derive(Debug, Clone)]
struct LesionRow {
    volume_ml: f64,
    depth_mm: f32,
    side: &'static str,
    defined_share: f64,
    truth: &'static str,
    /// False marks above the first hit, in each list.
    false_marks: Vec<Option<usize>>,
}

impl TrialReport {
    pub(super) fn new(
        selection: &Selection,
        heads: &[Judgeable],
        (lists, judged): (&[MarkList], &[Vec<JudgedHead>]),
        (figures, differences): (Vec<Figures>, Vec<(String, [Interval; 3])>),
        frozen: Option<Frozen>,
    ) -> Self {
        let row = |(number, head): (usize, &Judgeable)| {
            let found = &head.found;
            let lesions = found.lesions.iter().enumerate();
            HeadRow {
                name: head.chosen.files.name.clone(),
                role: head.chosen.role,
                mask: format!("{}, {}", found.mask_method.words(), found.mask_state.name()),
                lesions: lesions
                    .map(|(lesion, facts)| LesionRow {
                        volume_ml: facts.volume_ml,
                        depth_mm: facts.depth_mm,
                        side: facts.side.name(),
                        defined_share: facts.defined_share,
                        truth: found.truths.first().map_or("", |truth| truth.place.words()),
                        false_marks: judged
                            .iter()
                            .map(|heads| heads[number].lesions[lesion].false_marks)
                            .collect(),
                    })
                    .collect(),
                highest: judged
                    .iter()
                    .map(|heads| heads[number].scores.first().copied())
                    .collect(),
            }
        };
        let mut remarks = selection.remarks.clone();
        for list in &lists[1..] {
            for head in &list.unknown {
                let reason = format!("{} has marks for it, but it is not judged", list.name);
                remarks.push(Remark::new(head, reason));
            }
            let without = list.heads.iter().filter(|(_, marks)| marks.is_empty());
            for (head, _) in without {
                remarks.push(Remark::new(
                    head,
                    format!("{} has no mark for it", list.name),
                ));
            }
        }
        let count = |role| heads.iter().filter(|head| head.chosen.role == role).count();
        Self {
            folders: selection.folders,
            judged: [Role::Patient, Role::Control].map(count),
            heads: heads.iter().enumerate().map(row).collect(),
            figures,
            differences,
            left_out: selection.left_out.clone(),
            remarks,
            frozen,
        }
    }

    /// The report as JSON.
    pub fn json(&self) -> Value {
        let [patients, controls] = self.judged;
        let heads = self.heads.iter().map(|head| {
            let lesions = head.lesions.iter().map(|lesion| {
                json!({
                    "volume_ml": lesion.volume_ml,
                    "depth_mm": lesion.depth_mm,
                    "side": lesion.side,
                    "defined_share": lesion.defined_share,
                    "truth": lesion.truth,
                    "false_marks": lesion.false_marks,
                })
            });
            json!({
                "head": head.name,
                "role": head.role,
                "mask": head.mask,
                "highest_scores": head.highest,
                "lesions": lesions.collect::<Vec<_>>(),
            })
        });
        json!({
            "format": "isocortex-bench trial 1",
            "version": env!("CARGO_PKG_VERSION"),
            "map_format": analysis::MAP_FORMAT,
            "notice": render::RESEARCH_USE_NOTICE,
            "frozen": self.frozen,
            "rules": Rules::STANDARD,
            "fewer_false_marks_than": FALSE_MARKS,
            "folders": self.folders,
            "patients": patients,
            "controls": controls,
            "left_out": self.left_out,
            "remarks": self.remarks,
            "lists": self.figures,
            "differences": self.differences,
            "heads": heads.collect::<Vec<_>>(),
        })
    }

    /// A few lines for a terminal.
    pub fn text(&self) -> String {
        let [patients, controls] = self.judged;
        let mut text = format!(
            "{} folders, {patients} patients and {controls} controls judged, {} left out\n",
            self.folders,
            match self.left_out.len() {
                1 => "1 head".to_owned(),
                count => format!("{count} heads"),
            }
        );
        for Remark { head, reason } in &self.left_out {
            let _ = writeln!(text, "  {head}: {reason}");
        }
        for figures in &self.figures {
            let _ = writeln!(
                text,
                "\n{}: found with fewer than 1 / 5 / 20 false marks",
                figures.list
            );
            for row in figures.shares.iter().chain(&figures.chance) {
                let cells = row.found.map(percent).join(" / ");
                let _ = writeln!(text, "  {} ({}): {cells}", row.name, row.lesions);
            }
            if let Some(area) = figures.area {
                let _ = writeln!(
                    text,
                    "  area under the curve of the highest score, patients against controls: {}",
                    number(area)
                );
            }
        }
        text
    }

    /// The report as one HTML file.
    pub fn html(&self) -> String {
        let page = html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta http-equiv="Content-Security-Policy" content=(POLICY);
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    title { "A trial on your own data" }
                    style { (PreEscaped(STYLE)) }
                }
                body {
                    h1 { "A trial on your own data" }
                    p.notice { (render::RESEARCH_USE_NOTICE) }
                    (self.answer())
                    (self.lock())
                    (self.counts())
                    @for figures in &self.figures { (list(figures)) }
                    @if !self.differences.is_empty() { (self.compared()) }
                    (rules())
                    (self.all_heads())
                    (listed("Heads left out", &self.left_out))
                    (listed("Remarks", &self.remarks))
                }
            }
        };
        page.into_string()
    }

    /// The result in sentences.
    fn answer(&self) -> Markup {
        let own = &self.figures[0];
        let [patients, controls] = self.judged;
        let lesions = own.shares.first();
        let at_limit = own.thresholds.iter().find(|at| at.name.contains("unusual"));
        html! {
            div.answer {
                @match lesions {
                    None => p { "No patient could be judged. The list of heads left out states why." },
                    Some(lesions) => p {
                        "The places that the map lists contain " b { (percent(lesions.found[1])) } " of "
                        (lesions.lesions) " lesions in " (patients) " patients before the fifth false mark"
                        @for chance in &own.chance { "; " (round(chance.found[1].value)) " of lesions " (chance.name) }
                        "."
                    },
                }
                @if let Some(area) = own.area {
                    p {
                        "The highest score of a head is higher in patients than in controls with a probability of "
                        b { (number(area)) } " (0.5 is chance)."
                    }
                }
                @if let Some(at) = at_limit {
                    @if let (Some(controls_without), Some(found)) = (at.controls_without_marks, at.lesions_found) {
                        p {
                            "No place is above the limit for unusual (" (at.above) ") in " (percent(controls_without)) " of "
                            (controls) " controls; " (percent(found)) " of the lesions have a place above it."
                        }
                    }
                }
                p { small {
                    "Intervals of 95 %, bootstrapped over patients (if all or nothing is found, those of Wilson). This measures a list of places against lesions that people drew. It \
                     does not measure what a reader finds with the list, and says nothing about a single patient: a head without a \
                     place is not a head without a lesion."
                } }
            }
        }
    }

    fn lock(&self) -> Markup {
        html! {
            h2 { "Program and parameters" }
            @match &self.frozen {
                Some(frozen) => {
                    p { "Locked before the first result (BLAKE3):" }
                    table {
                        tr { th { "program" } td.hash { (frozen.program) } }
                        tr { th { "parameters" } td.hash { (frozen.parameters_hash) } }
                        tr { th { "version" } td { (frozen.version) ", map format " (analysis::MAP_FORMAT) } }
                    }
                    details {
                        summary { "The locked parameters" }
                        pre.hash { (format!("{:#}", frozen.parameters)) }
                    }
                }
                None => p {
                    "Version " (env!("CARGO_PKG_VERSION")) ", map format " (analysis::MAP_FORMAT)
                    ". The trial was not locked before its first result; " code { "--freeze" } " in an empty directory does so."
                },
            }
        }
    }

    fn counts(&self) -> Markup {
        let [patients, controls] = self.judged;
        html! {
            h2 { "Heads" }
            table {
                tr { th { "folders" } td { (self.folders) } }
                tr { th { "patients judged" } td { (patients) } }
                tr { th { "controls judged" } td { (controls) } }
                tr { th { "left out" } td { (self.left_out.len()) @if !self.left_out.is_empty() { ", listed at the end with reasons" } } }
            }
            @if controls == 0 {
                p.notice {
                    "There are no controls: nothing here states how often sound heads are marked."
                }
            }
        }
    }

    fn compared(&self) -> Markup {
        html! {
            h2 { "The lists compared" }
            p { "Differences in the share of lesions found, in points, on the same patients." }
            table {
                tr { th {} @for most in FALSE_MARKS { th { "fewer than " (most) } } }
                @for (name, differences) in &self.differences {
                    tr {
                        th { (name) }
                        @for difference in differences { td.n { (points(*difference)) } }
                    }
                }
            }
        }
    }

    fn all_heads(&self) -> Markup {
        let name = |list: &Figures| list.list.clone();
        let names: Vec<String> = self.figures.iter().map(name).collect();
        html! {
            h2 { "Each head" }
            details {
                summary { "The heads that were judged" }
                div.scroll { table {
                    tr {
                        th { "head" } th { "" } th { "mask" }
                        @for name in &names { th { "highest, " (name) } }
                        th { "lesion, ml" } th { "depth, mm" } th { "side" } th { "in the map" } th { "truth" }
                        @for name in &names { th { "false marks before it, " (name) } }
                    }
                    @for head in &self.heads {
                        @for number in 0..head.lesions.len().max(1) {
                            tr {
                                @if number == 0 {
                                    td { (head.name) }
                                    td { @match head.role { Role::Patient => "patient", Role::Control => "control" } }
                                    td { (head.mask) }
                                    @for score in &head.highest { td.n { (score.map_or("none".to_owned(), |score| format!("{score:.2}"))) } }
                                } @else {
                                    td {} td {} td {} @for _ in &head.highest { td {} }
                                }
                                @if let Some(lesion) = head.lesions.get(number) {
                                    td.n { (format!("{:.2}", lesion.volume_ml)) }
                                    td.n { (format!("{:.0}", lesion.depth_mm)) }
                                    td { (lesion.side) }
                                    td.n { (round(lesion.defined_share)) }
                                    td { (lesion.truth) }
                                    @for above in &lesion.false_marks {
                                        td.n { (above.map_or("not found".to_owned(), |above| above.to_string())) }
                                    }
                                }
                            }
                        }
                    }
                } }
            }
        }
    }
}

/// The figures of one list.
fn list(figures: &Figures) -> Markup {
    let curves = [(figures.list.clone(), figures.false_marks.clone())];
    let title = format!("Found of {} lesions", figures.false_marks.len());
    html! {
        h2 { "The list " (figures.list) }
        p { "Share found with fewer than so many false marks in the head." }
        (shares_table(&figures.shares))
        @if !figures.chance.is_empty() {
            h3 { "By chance" }
            p { "The same lesions at places that have none. A list that points nowhere finds as many." }
            (shares_table(&figures.chance))
        }
        @if !figures.false_marks.is_empty() {
            (PreEscaped(false_mark_curves(title, "share of lesions found", curves)))
        }
        @if let Some(area) = figures.area {
            h3 { "Patients against controls" }
            p { "The highest score of each head. Area under the curve: " b { (number(area)) } "." }
            (strips(&figures.highest))
        }
        @if !figures.thresholds.is_empty() {
            h3 { "Thresholds" }
            div.scroll { (thresholds(&figures.thresholds)) }
        }
        @if !figures.strata.is_empty() {
            h3 { "Strata" }
            p { "Lesions of each kind. Few of a kind state little: look at the intervals." }
            div.scroll { table {
                (shares_head())
                @for (name, rows) in &figures.strata {
                    tr { th.stratum colspan="6" { (name) } }
                    @for row in rows { (shares_row(row)) }
                }
            } }
        }
    }
}

fn shares_table(rows: &[Shares]) -> Markup {
    html! {
        table {
            (shares_head())
            @for row in rows { (shares_row(row)) }
        }
    }
}

fn shares_head() -> Markup {
    html! {
        tr {
            th { "" } th { "lesions" } th { "patients" }
            @for most in FALSE_MARKS { th { "fewer than " (most) } }
        }
    }
}

fn shares_row(row: &Shares) -> Markup {
    html! {
        tr {
            th { (row.name) }
            td.n { (row.lesions) } td.n { (row.patients) }
            @for found in row.found { td.n { (percent(found)) } }
        }
    }
}

fn thresholds(rows: &[AtThreshold]) -> Markup {
    let share = |share: Option<Interval>| share.map_or("–".to_owned(), percent);
    let count = |count: Option<f64>| count.map_or("–".to_owned(), |count| format!("{count:.2}"));
    let score = |score: f32| match score.is_finite() {
        true => format!("{score:.2}"),
        false => "any score".to_owned(),
    };
    html! {
        table {
            tr {
                th { "threshold" } th { "scores above" } th { "lesions found" } th { "patients with a lesion found" }
                th { "patients with a mark" } th { "controls without a mark" } th { "marks per control" }
                th { "false marks per patient" }
            }
            @for row in rows {
                tr {
                    th { (row.name) }
                    td.n { (score(row.above)) }
                    td.n { (share(row.lesions_found)) }
                    td.n { (share(row.patients_found)) }
                    td.n { (share(row.patients_with_marks)) }
                    td.n { (share(row.controls_without_marks)) }
                    td.n { (count(row.marks_per_control)) }
                    td.n { (count(row.false_marks_per_patient)) }
                }
            }
        }
        p { small {
            "Thresholds of marks per control are chosen on these controls, so their specificity is not an independent measurement."
        } }
    }
}

/// The highest score of each patient and each control, as dots.
fn strips([patients, controls]: &[Vec<f32>; 2]) -> Markup {
    const WIDTH: f32 = 640.0;
    const LEFT: f32 = 90.0;
    let finite = || {
        patients
            .iter()
            .chain(controls)
            .filter(|score| score.is_finite())
    };
    let low = finite().copied().fold(f32::INFINITY, f32::min);
    let high = finite().copied().fold(f32::NEG_INFINITY, f32::max);
    let x = |score: f32| match high > low && score.is_finite() {
        true => LEFT + (score - low) / (high - low) * (WIDTH - 20.0),
        false => LEFT,
    };
    let rows = [
        ("patients", patients, 30.0, "#0072b2"),
        ("controls", controls, 80.0, "#d55e00"),
    ];
    html! {
        svg viewBox="0 0 740 130" width="740" height="130" role="img"
            aria-label="the highest score of each patient and each control" {
            @for (name, scores, y, colour) in rows {
                text x="0" y=(y + 5.0) font-size="14" { (name) }
                line x1=(LEFT) x2=(LEFT + WIDTH - 20.0) y1=(y) y2=(y) stroke="#d0d5da" {}
                @for (number, score) in scores.iter().enumerate() {
                    circle cx=(format!("{:.1}", x(*score))) cy=(y + [-7.0, 0.0, 7.0][number % 3]) r="3.5"
                        fill=(colour) fill-opacity="0.55" {}
                }
            }
            @if high >= low {
                text x=(LEFT) y="120" font-size="13" { (format!("{low:.2}")) }
                text x=(LEFT + WIDTH - 20.0) y="120" font-size="13" text-anchor="end" { (format!("{high:.2}")) }
            }
        }
    }
}

fn rules() -> Markup {
    let rules = Rules::STANDARD;
    html! {
        h2 { "Rules" }
        ul {
            li {
                "A mark hits a lesion if it lies inside or at most " (rules.hit_mm) " mm from its border. If the lesion is larger than "
                (rules.large_ml) " ml, the mark must also lie within " (rules.from_centre_mm) " mm of its centre."
            }
            li {
                "Each connected part of a truth that is larger than " (rules.least_ml) " ml is a lesion and counts once. If no part is, \
                 the largest one is the lesion. Parts of several files that overlap are one lesion."
            }
            li {
                "A false mark is one that lies farther than " (rules.hit_mm) " mm from every part of every truth of the head. In a control \
                 every mark is false."
            }
            li { "Marks are read from the highest score down; a lesion is found at its first hit." }
            li {
                "Chance: each lesion is moved to its mirrored place, and to " (PLACES) " random places of the cerebral cortex, as the \
                 synthetic lesions of the study are placed. Marks at a real lesion do not count."
            }
            li {
                "A truth that was drawn on the FLAIR is brought to the T1-weighted volume by the registration of that FLAIR. Where the \
                 registration is in doubt, it lies where its header places it."
            }
        }
    }
}

fn listed(title: &str, remarks: &[Remark]) -> Markup {
    html! {
        @if !remarks.is_empty() {
            h2 { (title) }
            table {
                @for Remark { head, reason } in remarks { tr { th { (head) } td { (reason) } } }
            }
        }
    }
}

fn percent(share: Interval) -> String {
    let [value, low, high] = [share.value, share.low, share.high].map(|share| 100.0 * share);
    format!("{value:.0} % ({low:.0} to {high:.0})")
}

fn points(share: Interval) -> String {
    let [value, low, high] = [share.value, share.low, share.high].map(|share| 100.0 * share);
    format!("{value:+.0} ({low:+.0} to {high:+.0})")
}

fn round(share: f64) -> String {
    format!("{:.0} %", 100.0 * share)
}

fn number(interval: Interval) -> String {
    let Interval { value, low, high } = interval;
    format!("{value:.2} ({low:.2} to {high:.2})")
}
