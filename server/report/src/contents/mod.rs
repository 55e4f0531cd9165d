//! What a report says and shows, in its order. `html` and `pdf` write it.

mod appendix;
mod finding;
mod front;

use case::findings::Finding;
use case::{Gyrus, QualityState};

use crate::pictures::Shot;
use crate::words::Words;
use crate::{ListedMap, Reason, Report};

/// The beginning of a text.
fn shortened(text: &str, most_letters: usize) -> String {
    let mut short: String = text.chars().take(most_letters).collect();
    if short.len() < text.len() {
        short.push('…');
    }
    short
}

/// The most places of a map that are told and listed.
const MAX_CANDIDATES: usize = 20;

/// The contents of a report.
pub(crate) struct Contents<'a> {
    /// The tag of its language (BCP 47).
    pub(crate) language: &'static str,
    pub(crate) title: &'static str,
    /// The use that every page states.
    pub(crate) notice: &'static str,
    /// The case, for people.
    pub(crate) identity: String,
    /// The verdict on a mask that is not sound, which every page states.
    pub(crate) doubt: Option<String>,
    /// What a character without a glyph is written as, in words.
    pub(crate) unprintable: &'static str,
    /// What stands on a screen for a signature that is missing.
    pub(crate) unsigned: &'static str,
    /// Each begins a page.
    pub(crate) sections: Vec<Section<'a>>,
}

/// A part of a report that begins a page.
pub(crate) struct Section<'a> {
    pub(crate) kind: SectionKind,
    pub(crate) blocks: Vec<Block<'a>>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum SectionKind {
    Front,
    Finding,
    /// In small letters.
    Appendix,
}

/// A part of a section.
pub(crate) enum Block<'a> {
    Title(&'static str),
    Notice(&'static str),
    /// What is wrong with the mask, and why.
    Warning(String, Vec<String>),
    /// Stands at the right of what follows, down to the next table.
    KeyPicture(Picture<'a>),
    Heading(Line),
    Subheading(Line),
    /// A sentence of the conclusion.
    Large(Line),
    Text(Line),
    List(Vec<Line>),
    Facts(Facts),
    Table(Table),
    /// Rows of pictures with captions, each so many mm wide. They are compared, so no page divides them.
    Pictures(f64, Vec<Vec<Picture<'a>>>),
    /// Two columns of such pictures, and beside them facts above a table.
    PicturesAndFacts(f64, Vec<Vec<Picture<'a>>>, Facts, Option<Table>),
    /// What is written by hand, each above a line of its own, or there already.
    Sign(Facts),
    Overview(Overview<'a>),
}

/// The sides of pictures on paper, in mm. A finding has one page of A4 or Letter: two columns of cuts with the facts beside them,
/// above four slices of either side. With a further layer it has two: a row of cuts more, and for each slice both sides of both volumes.
pub(crate) const KEY_MM: f64 = 70.0;
pub(crate) const CUT_MM: f64 = 59.0;
pub(crate) const CUT_ABOVE_SLICES_MM: f64 = 50.0;
pub(crate) const SLICE_MM: f64 = 45.0;
pub(crate) const SLICE_BELOW_CUTS_MM: f64 = 43.0;

/// What separates two pictures of a row, in mm.
pub(crate) const GAP_MM: f64 = 2.0;

/// Names with values.
pub(crate) type Facts = Vec<(&'static str, Line)>;

/// A table with a head.
pub(crate) struct Table {
    pub(crate) head: Vec<&'static str>,
    pub(crate) rows: Vec<Vec<Line>>,
}

/// A picture and what it shows.
pub(crate) struct Picture<'a> {
    pub(crate) shot: &'a Shot,
    pub(crate) caption: Line,
}

/// Small pictures in rows and columns, which no page divides.
pub(crate) struct Overview<'a> {
    pub(crate) title: &'static str,
    pub(crate) columns: Vec<&'static str>,
    pub(crate) rows: Vec<(String, Vec<Picture<'a>>)>,
}

#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Line(pub(crate) Vec<Piece>);

/// A part of a text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Piece {
    /// Words of the program.
    Own(String),
    /// The same, to be seen first.
    Strong(String),
    /// Words of a reader or of a file, in any language and direction.
    Foreign(String),
}

impl Piece {
    pub(crate) fn text(&self) -> &str {
        let (Self::Own(text) | Self::Strong(text) | Self::Foreign(text)) = self;
        text
    }
}

impl<T: Into<String>> From<T> for Line {
    fn from(text: T) -> Self {
        Self(vec![Piece::Own(text.into())])
    }
}

impl Line {
    fn strong(text: &str) -> Self {
        Self(vec![Piece::Strong(text.to_owned())])
    }

    fn foreign(text: &str) -> Self {
        Self::default().and_foreign(text)
    }

    fn and(mut self, text: impl Into<String>) -> Self {
        self.0.push(Piece::Own(text.into()));
        self
    }

    fn and_foreign(mut self, text: &str) -> Self {
        self.0.push(Piece::Foreign(text.to_owned()));
        self
    }

    fn and_line(mut self, other: Self) -> Self {
        self.0.extend(other.0);
        self
    }

    /// Whether all words are the program's own.
    pub(crate) fn is_own(&self) -> bool {
        let is_foreign = |piece: &Piece| matches!(piece, Piece::Foreign(_));
        !self.0.iter().any(is_foreign)
    }

    /// Whether it is a number with its unit, or several: a line that is not broken.
    pub(crate) fn is_number(&self) -> bool {
        self.is_own()
            && self
                .plain()
                .contains(|letter: char| letter.is_ascii_digit())
    }

    pub(crate) fn plain(&self) -> String {
        self.0.iter().map(Piece::text).collect()
    }
}

impl Report {
    pub(crate) fn contents(&self) -> Contents<'_> {
        let words = self.query.language.words();
        let section = |kind, blocks| Section { kind, blocks };
        let mut sections = vec![section(SectionKind::Front, self.front(words))];
        for (number, finding) in (1..).zip(&self.findings) {
            sections.push(section(
                SectionKind::Finding,
                self.finding(words, number, finding),
            ));
        }
        sections.push(section(SectionKind::Appendix, self.appendix(words)));
        Contents {
            language: self.query.language.tag(),
            title: words.title,
            notice: words.notice,
            identity: words.identity(&self.case),
            doubt: self.doubt(words),
            unprintable: words.unprintable,
            unsigned: words.unsigned,
            sections,
        }
    }

    /// That the case is closed, that its sides are in doubt, and the verdict on a mask that is not sound.
    fn doubt(&self, words: &Words) -> Option<String> {
        let closed = self.case.closed.map(|why| words.closed(why));
        let sides = self.has_sides_in_doubt().then(|| words.sides_in_doubt());
        let mask = self
            .state_of_mask()
            .filter(|state| *state != QualityState::Ok)
            .map(|state| format!("{}: {}", words.mask, words.state(state)));
        let doubts: Vec<_> = closed
            .into_iter()
            .chain(sides)
            .map(str::to_owned)
            .chain(mask)
            .collect();
        (!doubts.is_empty()).then(|| doubts.join(" · "))
    }

    fn has_sides_in_doubt(&self) -> bool {
        let quality = self.facts.quality.as_ref();
        quality.is_some_and(|quality| quality.doubts_about_sides() > 0)
    }

    /// The verdict on the mask, for which doubts about the sides do not count.
    fn state_of_mask(&self) -> Option<QualityState> {
        let quality = self.facts.quality.as_ref()?;
        let about_sides = quality.doubts_about_sides();
        let is_about_sides_alone = about_sides > 0 && quality.reasons.len() == about_sides;
        Some(match quality.state {
            QualityState::Review if is_about_sides_alone => QualityState::Ok,
            state => state,
        })
    }

    /// What is wrong with the case or its mask, if something is.
    fn warning(&self, words: &Words) -> Option<Block<'static>> {
        self.doubt(words).map(|doubt| {
            let quality = self.facts.quality.iter();
            let reasons = quality.flat_map(|quality| {
                let codes = quality.reason_codes.iter().map(String::as_str);
                let codes = codes.chain(std::iter::repeat(""));
                let reasons = quality.reasons.iter().zip(codes);
                reasons.map(|(reason, code)| words.reason(code, reason).to_owned())
            });
            Block::Warning(doubt, reasons.collect())
        })
    }
}

/// What is to be known about the scores of a map before one is believed to be unusual.
fn caveat(words: &Words, map: &ListedMap) -> Option<Block<'static>> {
    let Reason { code, sentence } = map.caveat.as_ref()?;
    let told = words.reason(code, sentence).to_owned();
    Some(Block::Text(told.into()))
}

/// The side and the gyrus of a finding.
fn place_of(words: &Words, finding: &Finding) -> String {
    let gyrus = finding
        .gyrus
        .map(|gyrus| format!(", {}", words.gyrus(gyrus)));
    format!("{}{}", side_of(words, finding), gyrus.unwrap_or_default())
}

fn gyrus_of(words: &Words, gyrus: Option<Gyrus>) -> &'static str {
    gyrus.map_or("–", |gyrus| words.gyrus(gyrus))
}

fn side_of(words: &Words, finding: &Finding) -> &'static str {
    finding.side.map_or(words.unknown, |side| words.side(side))
}

/// How certain a finding is; of one that was taken over, that it is not confirmed. Empty if nobody has said so.
fn certainty_of(words: &Words, finding: &Finding) -> &'static str {
    match finding.certainty {
        _ if finding.is_unconfirmed => words.unconfirmed,
        Some(certainty) => words.certainty(certainty),
        None => "",
    }
}

fn millimetres(words: &Words, mm: impl Into<f64>) -> String {
    format!("{} mm", words.number(mm, 1))
}

/// A position with the sides of its coordinates, as the page has it: `R 35.0 · A 29.0 · S 32.0`.
fn position(words: &Words, in_patient: [f64; 3]) -> String {
    [0, 1, 2]
        .map(|axis| words.coordinate(axis, in_patient[axis]))
        .join(" · ")
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use case::{CandidateFacts, Case, CaseId, CaseState, Parameters};
    use jiff::Timestamp;
    use serde_json::json;

    use super::front::MAX_CONCLUDED_LETTERS;
    use super::*;
    use crate::pictures::{self, Shows, Through};
    use crate::{Language, ReportMaps, ReportQuery, ReportedFinding};

    #[test]
    fn a_number_stays_on_its_line_and_a_name_may_be_broken() {
        assert!(Line::from("R 28.0 · P 19.0 · I 26.0").is_number());
        assert!(!Line::from("temporal pole, superior part").is_number());
        assert!(!Line::foreign("3 mm, as the reader wrote").is_number());
    }

    /// The report of a case without findings, and without a brain.
    fn report(language: Language) -> Report {
        let mut facts = storage::testing::facts();
        let quality = json!({
            "state": "failed", "method": "network", "reasons": ["the mask has 5000 ml"], "reason_codes": ["mask-volume"],
            "numbers": {"brain_ml": 5000.0, "closing_added": 0.0, "largest_component": 1.0, "extents_mm": [1.0, 1.0, 1.0],
                        "cut_area_cm2": [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]},
        });
        facts.quality = Some(serde_json::from_value(quality).unwrap());
        Report {
            case: Case {
                id: CaseId::parse(&"0".repeat(32)).unwrap(),
                parameters: Parameters::default(),
                state: CaseState::Ready,
                progress: None,
                failure: None,
                facts: None,
                previous: None,
                next: Vec::new(),
                created_at: Timestamp::UNIX_EPOCH,
                uploaded_at: Timestamp::UNIX_EPOCH,
                kept: false,
                trashed: false,
                expires_at: None,
                closed: None,
            },
            facts: Arc::new(facts),
            query: ReportQuery {
                language,
                patient: false,
            },
            reading: None,
            patient: None,
            maps: Err(Reason {
                code: "failed-envelope".into(),
                sentence: "the mask is wrong".into(),
            }),
            flair: None,
            layer: None,
            findings: Vec::new(),
            dismissed: Vec::new(),
            overview: pictures::Overview {
                anatomy: Vec::new(),
                map: Vec::new(),
            },
        }
    }

    #[test]
    fn sides_in_doubt_are_named_before_the_mask_on_every_page() {
        let sides = ("axes-corrected", "another case has other axes");
        let assumed = ("axes-assumed", "a file does not state its axes");
        let ragged = ("mask-ragged", "the mask is ragged");
        for (language, reasons, doubt) in [
            (
                Language::English,
                vec![sides],
                "Left and right are in doubt",
            ),
            (
                Language::English,
                vec![assumed, sides],
                "Left and right are in doubt",
            ),
            (
                Language::English,
                vec![ragged, sides],
                "Left and right are in doubt · Brain mask: CHECK IT",
            ),
            (Language::English, vec![ragged], "Brain mask: CHECK IT"),
            (
                Language::Portuguese,
                vec![sides],
                "Esquerda e direita estão em dúvida",
            ),
        ] {
            let mut report = report(language);
            let mut facts = (*report.facts).clone();
            let quality = facts.quality.as_mut().unwrap();
            quality.state = QualityState::Review;
            quality.reason_codes = reasons.iter().map(|(code, _)| (*code).into()).collect();
            quality.reasons = reasons.iter().map(|(_, text)| (*text).into()).collect();
            report.facts = Arc::new(facts);
            let contents = report.contents();
            assert_eq!(contents.doubt.as_deref(), Some(doubt));
            let named = format!("<strong>{doubt}</strong>");
            assert_eq!(
                contents.html().matches(&named).count(),
                contents.sections.len()
            );
        }
    }

    #[test]
    fn a_mask_that_is_no_brain_is_named_at_the_head_of_every_page() {
        for (language, doubt, texts) in [
            (
                Language::English,
                "Brain mask: NOT A BRAIN",
                [
                    "The volume of the mask is not that of a brain.",
                    "There are no maps of this case: The brain mask is rated as failed",
                ],
            ),
            (
                Language::Portuguese,
                "Máscara do encéfalo: NÃO É UM ENCÉFALO",
                [
                    "O volume da máscara não é o de um encéfalo.",
                    "Não há mapas deste caso: A máscara do encéfalo foi avaliada como falha",
                ],
            ),
        ] {
            let report = report(language);
            let contents = report.contents();
            assert_eq!(contents.doubt.as_deref(), Some(doubt));
            let html = contents.html();
            let pages = contents.sections.len();
            assert_eq!(
                html.matches(&format!("<strong>{doubt}</strong>")).count(),
                pages
            );
            assert!(texts.iter().all(|text| html.contains(text)), "{html}");
            // How often a PDF states it, its own tests tell.
            assert!(contents.pdf().unwrap().starts_with(b"%PDF"));
        }
    }

    /// A place of the map of blur or of the thickness.
    fn place(x: f64, score: f32) -> CandidateFacts {
        serde_json::from_value(json!({
            "position_in_patient": [x, -20.0, 30.0], "depth_mm": 8.0, "side": "left", "score": score, "size_mm": 9.0,
            "region": "cerebrum", "unusual": "yes",
        }))
        .unwrap()
    }

    fn shot(is_flipped: bool) -> Shot {
        Shot {
            png: Vec::new(),
            side: 240,
            pixels_per_mm: 3.0,
            mark: Some([120.0, 120.0]),
            outline: Vec::new(),
            is_closed: false,
            is_flipped,
            directions: ["A", "P", "S", "I"].map(str::to_owned),
            shows: Shows::Anatomy,
        }
    }

    /// The same with a list of two places, of which one was kept.
    fn reported(language: Language) -> Report {
        let list = |places| ListedMap {
            places,
            has_limits: true,
            caveat: None,
        };
        let finding = json!({
            "id": "a", "kind": "point", "points_in_patient": [[40.0, -20.0, 30.0]], "depth_mm": 8.0, "from_map": "blur", "side": "left",
            "label": "frontal", "note": "n".repeat(400), "author": "B. Reader", "changed_at": "2026-11-28T10:20:30Z",
        });
        let pictures = pictures::FindingPictures {
            surface: case::SurfaceName::Left,
            depth_mm: 3.0,
            cuts: vec![[shot(false), shot(true)]],
            slices: vec![[(30.0, false), (31.0, true)].map(|(mm, is_flipped)| {
                let through = Through::Standard(render::SlicePlane::Axial, mm);
                (through, vec![shot(is_flipped)])
            })],
        };
        Report {
            maps: Ok(ReportMaps {
                blur: list(vec![place(40.0, 3.21), place(10.0, 2.98)]),
                elsewhere: Vec::new(),
                thickness: list(Vec::new()),
                regions: case::RegionFacts {
                    state: QualityState::Ok,
                    reasons: Vec::new(),
                    reason_codes: Vec::new(),
                    numbers: None,
                },
            }),
            findings: vec![ReportedFinding {
                finding: serde_json::from_value(finding).unwrap(),
                pictures,
                numbers: None,
            }],
            ..report(language)
        }
    }

    #[test]
    fn the_first_page_has_the_findings_with_their_scores_and_the_appendix_the_places_that_were_not_kept()
     {
        for (language, doubt, told, conclusion, appendix) in [
            (
                Language::English,
                "NOT A BRAIN",
                "Places of the map of blur that stand out: 2; not among the findings: 1.",
                "Conclusion",
                "Appendix",
            ),
            (
                Language::Portuguese,
                "NÃO É UM ENCÉFALO",
                "Locais do mapa de borramento que se destacam: 2; fora dos achados: 1.",
                "Conclusão",
                "Apêndice",
            ),
        ] {
            let report = reported(language);
            let html = report.contents().html();
            let (first, rest) = html
                .split_once(r#"<section class="page finding">"#)
                .unwrap();
            let (_, last) = rest
                .split_once(r#"<section class="page appendix">"#)
                .unwrap();
            let number = |text: &str| {
                report
                    .query
                    .language
                    .words()
                    .number(text.parse::<f64>().unwrap(), 2)
            };
            let [kept, other] = ["3.21", "2.98"].map(number);
            let short = format!("{}…", "n".repeat(MAX_CONCLUDED_LETTERS));
            for text in [
                doubt,
                told,
                conclusion,
                &kept,
                "9 mm",
                &short,
                "B. Reader",
                "2026-11-28",
            ] {
                assert!(first.contains(text), "{text}");
            }
            assert!(first.matches("<image").count() == 1 && !first.contains(&other));
            assert!(last.contains(appendix) && last.contains(&other) && !last.contains(&kept));
        }
    }

    #[test]
    fn the_conclusion_of_a_reading_stands_first_and_above_its_signature() {
        for (language, template, signed) in [
            (
                Language::English,
                [
                    "<th>Side</th><td>Left</td>",
                    "<th>Gyrus</th><td>insula</td>",
                    "<th>Bright in FLAIR</th><td>absent</td>",
                    "<th>Certainty</th><td>possible</td>",
                ],
                "Signed by <bdi>ana &lt;b&gt;</bdi> on 2026-11-28 at 10:20 UTC",
            ),
            (
                Language::Portuguese,
                [
                    "<th>Lateralidade</th><td>Esquerda</td>",
                    "<th>Giro</th><td>ínsula</td>",
                    "<th>Hipersinal no FLAIR</th><td>ausente</td>",
                    "<th>Certeza</th><td>possível</td>",
                ],
                "Assinado por <bdi>ana &lt;b&gt;</bdi> em 2026-11-28 às 10:20 UTC",
            ),
        ] {
            let mut report = reported(language);
            report.reading = Some(crate::ReportedReading {
                reader: "ana <b>".to_owned(),
                conclusion: "Thick gyrus\n\nnothing <else>".to_owned(),
                template: serde_json::from_value(json!({
                    "side": "left", "lobe": "temporal", "gyrus": "insula", "blur": "present", "flair": "absent",
                    "certainty": "possible",
                }))
                .unwrap(),
                signed_at: None,
            });
            let first = |report: &Report| {
                let html = report.contents().html();
                let (first, _) = html.split_once(r#"<section class="page"#).unwrap();
                first.to_owned()
            };
            let open = first(&report);
            for line in ["<bdi>Thick gyrus</bdi>", "<bdi>nothing &lt;else&gt;</bdi>"] {
                assert_eq!(open.matches(line).count(), 1, "{open}");
            }
            assert_eq!(open.matches(r#"class="large"#).count(), 2);
            for row in template {
                assert!(open.contains(row), "{row} in {open}");
            }
            assert!(!open.contains(language.words().template_field("thickening")));
            assert!(open.contains("ana &lt;b&gt;") && !open.contains("2026-11-28"));
            let unsigned = format!("<td>{}</td>", language.words().unsigned);
            let text = report.contents().text();
            assert!(text.contains("ana &lt;b&gt;") && text.contains(&unsigned));
            report.reading.as_mut().unwrap().signed_at = Some("2026-11-28T10:20:30Z".to_owned());
            assert!(first(&report).contains(signed), "{}", first(&report));
            let text = report.contents().text();
            assert!(text.contains(signed) && !text.contains(&unsigned));
        }
    }

    #[test]
    fn what_is_doubtful_of_a_layer_and_of_a_finding_is_on_the_first_page() {
        let mut report = reported(Language::English);
        report.layer = Some(crate::ShownLayer {
            name: "FLAIR".to_owned(),
            may_lie_elsewhere: true,
        });
        report.findings[0].finding.is_unconfirmed = true;
        let html = report.contents().html();
        let (first, _) = html.split_once(r#"<section class="page"#).unwrap();
        for text in [
            "<bdi>FLAIR</bdi>: its place was not checked",
            "<strong>taken over from another case, its place not confirmed</strong>",
        ] {
            assert!(first.contains(text), "{text}");
        }
    }

    #[test]
    fn each_picture_of_a_finding_states_its_side_its_place_and_its_scale() {
        let html = reported(Language::English).contents().html();
        let (_, page) = html
            .split_once(r#"<section class="page finding">"#)
            .unwrap();
        let captions = page.split("<figcaption>").skip(1);
        let captions: Vec<_> = captions
            .map(|text| text.split_once("</figcaption>").unwrap().0)
            .collect();
        assert_eq!(
            captions,
            [
                "T1, 3.0 mm, inner side of the left hemisphere: <strong>left</strong>, as acquired",
                "T1, 3.0 mm, inner side of the right hemisphere: <strong>right</strong>, flipped",
                "T1, axial, S 30.0 mm",
                "T1, axial, S 31.0 mm: <strong>other side</strong>, flipped",
            ]
        );
        assert_eq!(page.matches(">10 mm</text>").count(), 4);
    }
}
