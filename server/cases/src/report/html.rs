//! The report as HTML. Every text of a reader or of a file is escaped by the template.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use case::findings::Finding;
use case::{CandidateFacts, PatientSide, QualityState};
use maud::{DOCTYPE, Markup, PreEscaped, html};
use render::NamedView;

use super::shots::{DEPTHS_MM, FindingPictures, Shot, Shows};
use super::words::Words;
use super::{Numbers, Report, ReportedFinding};
use crate::profile::ProfileSample;

/// The look of the report, on a screen and on A4 and Letter.
const STYLE: &str = include_str!("report.css");

/// What the file may load: nothing but the pictures in it.
pub const POLICY: &str = "default-src 'none'; img-src data:; style-src 'unsafe-inline'";

/// The height of a letter in a picture, as a part of its side.
const LETTER_SIZE: f64 = 0.07;

/// The most places of the map in the table.
const MAX_CANDIDATES: usize = 20;

impl Report {
    pub(super) fn html(&self) -> String {
        let words = self.query.language.words();
        let title = format!("{} · {}", words.title, self.case.identity());
        let page = html! {
            (DOCTYPE)
            html lang=(self.query.language.tag()) {
                head {
                    meta charset="utf-8";
                    meta http-equiv="Content-Security-Policy" content=(POLICY);
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    title { (title) }
                    style { (PreEscaped(STYLE)) (PreEscaped(self.margins(words))) }
                }
                body {
                    (self.warning(words))
                    h1 { (words.title) }
                    p.notice { (words.notice) }
                    (self.about(words))
                    (self.summary(words))
                    (self.places(words))
                    @for (number, finding) in (1..).zip(&self.findings) {
                        (self.finding(words, number, finding))
                    }
                    section.page {
                        (self.warning_line(words))
                        (overview(words, words.overview, &self.overview.anatomy))
                        @if !self.overview.map.is_empty() {
                            (overview(words, words.overview_of_map, &self.overview.map))
                        }
                    }
                }
            }
        };
        page.into_string()
    }

    /// The words in the margins of every printed page.
    fn margins(&self, words: &Words) -> String {
        format!(
            "@page {{ @top-left {{ content: {} }} @top-right {{ content: {} }} @bottom-left {{ content: {} }} }}",
            css_text(&format!("Isocortex · {}", self.case.identity())),
            css_text(&self.doubt(words).unwrap_or_default()),
            css_text(words.notice),
        )
    }

    /// That the case is not the one that counts any more, and the verdict on a mask that is not sound.
    fn doubt(&self, words: &Words) -> Option<String> {
        let superseded = self.case.superseded.map(|why| words.superseded(why));
        let state = self.facts.quality.as_ref().map(|quality| quality.state);
        let mask = state
            .filter(|state| *state != QualityState::Ok)
            .map(|state| format!("{}: {}", words.mask, words.state(state)));
        let doubts: Vec<_> = (superseded.map(str::to_owned).into_iter().chain(mask)).collect();
        (!doubts.is_empty()).then(|| doubts.join(" · "))
    }

    /// The verdict again, at the head of a page: not every browser prints the margins of pages.
    fn warning_line(&self, words: &Words) -> Markup {
        html! { @if let Some(doubt) = self.doubt(words) { p.warning { strong { (doubt) } } } }
    }

    /// What is wrong with the mask, where something is.
    fn warning(&self, words: &Words) -> Markup {
        let quality = self.facts.quality.as_ref();
        html! {
            @if let Some(doubt) = self.doubt(words) {
                div.warning {
                    strong { (doubt) }
                    @for reason in quality.iter().flat_map(|quality| &quality.reasons) { p { (reason) } }
                }
            }
        }
    }

    fn about(&self, words: &Words) -> Markup {
        let [x, y, z] = self.facts.native_size;
        let spacing = self.facts.native_spacing_mm.map(|mm| format!("{mm:.2}"));
        let dicom = self.facts.dicom.as_ref();
        let sequence = dicom.and_then(|dicom| dicom.sequence.as_deref());
        let quality = self.facts.quality.as_ref();
        html! {
            table.about {
                tr { th { (words.case) } td { bdi { (self.case.identity()) } " · " (self.case.id) } }
                @if let Some(patient) = &self.patient {
                    tr {
                        th { (words.patient) }
                        td {
                            @if patient.is_empty() { (words.not_from_dicom) }
                            @for (name, value) in patient {
                                span.attribute { (name) ": " bdi { (value) } }
                            }
                        }
                    }
                }
                tr {
                    th { (words.acquisition) }
                    td {
                        (sequence.unwrap_or(words.unknown)) " · " (x) " × " (y) " × " (z) " " (words.voxels) ", "
                        (spacing.join(" × ")) " mm"
                        @if let Some(layer) = &self.layer {
                            " · " bdi { (layer.name) }
                            @if layer.may_lie_elsewhere { " (" (words.may_lie_elsewhere) ")" }
                        }
                    }
                }
                @if let Some(quality) = quality {
                    tr { th { (words.mask) } td { (words.state(quality.state)) } }
                }
                tr { th { (words.made_by) } td { "Isocortex " (env!("CARGO_PKG_VERSION")) } }
            }
        }
    }

    /// The findings on one page: those to look at, and those that were dismissed.
    fn summary(&self, words: &Words) -> Markup {
        html! {
            h2 { (words.findings) }
            @if self.findings.is_empty() { p { (words.no_findings) } }
            @else {
                table.numbers {
                    thead {
                        tr {
                            th {} th { (words.side) } th { (words.depth) } th { (words.position) } th { (words.certainty) }
                            th { (words.label) }
                        }
                    }
                    @for (number, ReportedFinding { finding, .. }) in (1..).zip(&self.findings) {
                        tr {
                            td { (number) } td { (side_of(words, finding)) } td.number { (format!("{:.1} mm", finding.depth_mm)) }
                            td.number { (position(finding.middle_in_patient())) }
                            td { @if let Some(certainty) = finding.certainty { (words.certainty(certainty)) } }
                            td.text { bdi { (finding.label) } }
                        }
                    }
                }
            }
            @if !self.dismissed.is_empty() {
                h3 { (words.dismissed) }
                ul { @for finding in &self.dismissed { li { (line_about(words, finding)) } } }
            }
        }
    }

    fn finding(&self, words: &Words, number: usize, reported: &ReportedFinding) -> Markup {
        let ReportedFinding {
            finding,
            pictures,
            numbers,
        } = reported;
        html! {
            section.page.finding {
                (self.warning_line(words))
                h2 { (words.finding) " " (number) ": " bdi { (finding.label) } }
                div.facts {
                    table.about {
                        tr { th { (words.side) } td { strong { (side_of(words, finding)) } } }
                        tr { th { (words.depth) } td { (format!("{:.1} mm", finding.depth_mm)) } }
                        tr { th { (words.position) } td { (position(finding.middle_in_patient())) } }
                        tr { th { (words.kind) } td { (words.kind(finding.kind)) } }
                        @if let Some(certainty) = finding.certainty {
                            tr { th { (words.certainty) } td { (words.certainty(certainty)) } }
                        }
                        @if let Some(author) = &finding.author {
                            tr {
                                th { (words.author) }
                                td { bdi { (author) } @if let Some(time) = &finding.changed_at { ", " (minute(time)) } }
                            }
                        }
                    }
                    @if let Some(numbers) = numbers { (table_of(words, numbers)) }
                }
                @if !finding.note.is_empty() { p.text { bdi { (finding.note) } } }
                (self.pictures(words, finding, pictures))
            }
        }
    }

    /// Rows of pictures: the cuts, the same of the other side below them, and the slices.
    fn pictures(&self, words: &Words, finding: &Finding, pictures: &FindingPictures) -> Markup {
        let own = side_of(words, finding);
        let opposite = match finding.side {
            Some(PatientSide::Left) => words.side(PatientSide::Right),
            Some(PatientSide::Right) => words.side(PatientSide::Left),
            _ => words.other_side,
        };
        let view = words.view(pictures.view);
        let depth = format!("{:.1} mm", finding.depth_mm);
        let of_slices = pictures.slices.first().map_or(0, |(_, shots)| shots.len());
        html! {
            div.row {
                @for [here, _] in &pictures.cuts {
                    (picture(words, here, &format!("{}, {depth}, {view}: {own}, {}", self.what(words, here.shows), words.as_acquired)))
                }
            }
            div.row {
                @for [_, other] in &pictures.cuts {
                    (picture(words, other, &format!("{}, {depth}: {opposite}, {}", self.what(words, other.shows), words.flipped)))
                }
            }
            @for number in 0..of_slices {
                div.row {
                    @for (through, shots) in &pictures.slices {
                        @let shot = &shots[number];
                        (picture(words, shot, &format!("{}, {}", self.what(words, shot.shows), words.through(through))))
                    }
                }
            }
        }
    }

    /// The name of what a picture shows.
    fn what(&self, words: &Words, shows: Shows) -> String {
        match (shows, &self.layer) {
            (Shows::Anatomy, _) | (Shows::Layer, None) => words.anatomy.to_owned(),
            (Shows::Layer, Some(layer)) => layer.name.clone(),
            (Shows::Map, _) => format!("{}, {}", words.anatomy, words.map),
        }
    }

    /// The places of the map, or why there are none.
    fn places(&self, words: &Words) -> Markup {
        html! {
            h2 { (words.candidates) }
            @match &self.maps {
                Err(reason) => p { (words.no_maps) " " (reason.sentence) },
                Ok(maps) => {
                    p { (words.candidates_note) }
                    table.numbers {
                        thead {
                            tr {
                                th { (words.rank) } th { (words.side) } th { (words.depth) } th { (words.position) }
                                th { (words.score) } th { (words.size) }
                            }
                        }
                        @for (rank, candidate) in (1..).zip(maps.candidates.iter().take(MAX_CANDIDATES)) {
                            (row_of(words, rank, candidate))
                        }
                    }
                }
            }
        }
    }
}

fn row_of(words: &Words, rank: usize, candidate: &CandidateFacts) -> Markup {
    html! {
        tr {
            td { (rank) } td { (words.side(candidate.side)) } td { (format!("{:.1} mm", candidate.depth_mm)) }
            td { (position(candidate.position_in_patient)) } td { (format!("{:.2}", candidate.score)) }
            td { (format!("{:.0} mm", candidate.size_mm)) }
        }
    }
}

fn line_about(words: &Words, finding: &Finding) -> Markup {
    html! {
        bdi { (finding.label) } " (" (side_of(words, finding)) ", " (format!("{:.1} mm", finding.depth_mm)) ", "
        (position(finding.middle_in_patient())) ")"
        @if !finding.note.is_empty() { ": " bdi { (finding.note) } }
    }
}

fn side_of(words: &Words, finding: &Finding) -> &'static str {
    finding.side.map_or(words.unknown, |side| words.side(side))
}

/// A time (RFC 3339, UTC) to the minute.
fn minute(time: &str) -> String {
    let [day, clock] = [time.get(..10), time.get(11..16)].map(Option::unwrap_or_default);
    format!("{day} {clock} UTC")
}

fn position([x, y, z]: [f64; 3]) -> String {
    format!("{x:.1}, {y:.1}, {z:.1}")
}

/// The values here and on the other side.
fn table_of(words: &Words, numbers: &Numbers) -> Markup {
    let value = |value: Option<f32>| value.map_or("–".to_owned(), |value| format!("{value:.2}"));
    let other = numbers.mirrored.as_ref().map(|mirrored| &mirrored.point);
    let row = |name: &str, of: &dyn Fn(&ProfileSample) -> Option<f32>| {
        html! {
            tr { th { (name) } td { (value(of(&numbers.own.point))) } td { (value(other.and_then(of))) } }
        }
    };
    html! {
        table.numbers {
            tr { th {} th { (words.here) } th { (words.other_side) } }
            (row(words.intensity, &|sample| sample.intensity))
            (row(words.blur, &|sample| sample.blur))
            (row(words.sharpness, &|sample| sample.sharpness))
        }
    }
}

fn overview(words: &Words, title: &str, rows: &[Vec<Shot>]) -> Markup {
    html! {
        div.overview {
            h2 { (title) }
            table {
                tr { th {} @for view in NamedView::ALL { th { (words.view(view)) } } }
                @for (depth_mm, row) in DEPTHS_MM.iter().zip(rows) {
                    tr {
                        th { (depth_mm) " mm" }
                        @for (shot, view) in row.iter().zip(NamedView::ALL) {
                            td { (drawing(words, shot, &format!("{depth_mm} mm, {}", words.view(view)))) }
                        }
                    }
                }
            }
        }
    }
}

/// A picture above what it shows.
fn picture(words: &Words, shot: &Shot, caption: &str) -> Markup {
    html! { figure { (drawing(words, shot, caption)) figcaption { (caption) } } }
}

/// A picture with its marks and the patient's directions at its edges. It is one drawing, which no printer divides.
fn drawing(words: &Words, shot: &Shot, name: &str) -> Markup {
    let png = format!("data:image/png;base64,{}", STANDARD.encode(&shot.png));
    let side = shot.side;
    let end = f64::from(side);
    // Letters are as large on paper in a small picture as in a large one.
    let (margin, middle) = (end * LETTER_SIZE * 0.75, end / 2.0);
    let places = [
        [margin, middle],
        [end - margin, middle],
        [middle, margin],
        [middle, end - margin],
    ];
    let flip = format!("translate({side} 0) scale(-1 1)");
    html! {
        svg viewBox={ "0 0 " (side) " " (side) } role="img" aria-label=(name) {
            image href=(png) width=(side) height=(side) transform=[shot.is_flipped.then_some(flip)] {}
            @for class in ["halo", "mark"] {
                @if let Some(at) = shot.mark { path class=(class) d=(ticks(at)) {} }
                @if !shot.outline.is_empty() { path class=(class) d=(outline(shot)) {} }
            }
            @for (letters, [x, y]) in shot.directions.iter().zip(places) {
                text x=(format!("{x:.1}")) y=(format!("{y:.1}")) font-size=(format!("{:.1}", end * LETTER_SIZE)) {
                    (words.directions(letters))
                }
            }
        }
    }
}

/// A cross of short ticks that leaves the middle free.
fn ticks([x, y]: [f64; 2]) -> String {
    let (near, far) = (7.0, 16.0);
    let tick = |[dx, dy]: [f64; 2]| {
        let (from, to) = ([x + dx * near, y + dy * near], [x + dx * far, y + dy * far]);
        format!("M{:.1} {:.1}L{:.1} {:.1}", from[0], from[1], to[0], to[1])
    };
    [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]
        .map(tick)
        .concat()
}

fn outline(shot: &Shot) -> String {
    let points = shot.outline.iter().map(|[x, y]| format!("{x:.1} {y:.1}"));
    let end = if shot.is_closed { "Z" } else { "" };
    format!("M{}{end}", points.collect::<Vec<_>>().join("L"))
}

/// A text as a string of CSS. Everything but letters, digits and spaces is escaped, so that no text ends the string or the
/// style.
fn css_text(text: &str) -> String {
    let mut quoted = String::from("\"");
    for character in text.chars() {
        if character.is_alphanumeric() || character == ' ' {
            quoted.push(character);
        } else {
            quoted.push_str(&format!("\\{:x} ", u32::from(character)));
        }
    }
    quoted.push('"');
    quoted
}
