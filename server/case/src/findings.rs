//! What a reader has marked and written about a head: the findings of a case.
//!
//! They lie in the patient, not on a mesh: a finding is at the same place whatever is shown of the case.

use std::collections::HashSet;
use std::ops::RangeInclusive;

use serde::{Deserialize, Serialize};
use strum::IntoStaticStr;

use crate::{Gyrus, MapName, PatientSide, StandardPosition, is_control};

/// The most findings of a case.
pub const MAX_FINDINGS: usize = 1_000;

/// The most points of all findings of a case together.
pub const MAX_POINTS: usize = 20_000;

/// The greatest depth of a finding, in mm.
const MAX_DEPTH_MM: f64 = 200.0;

/// The longest id, label and name of an author, and the longest note, in characters.
const MAX_ID_LENGTH: usize = 64;
const MAX_LABEL_LENGTH: usize = 200;
const MAX_NOTE_LENGTH: usize = 10_000;

/// The form of a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum FindingKind {
    /// One point.
    Point,
    /// Two points or more, joined in their order.
    Line,
    /// Three points or more, joined in their order and closed.
    Polygon,
    /// Two points: where something enters the head, and where it ends.
    Trajectory,
    /// Two points: the anterior commissure, then the posterior one. They are no finding about the patient, but the axes in which others are
    /// stated.
    Acpc,
}

/// How far the commissures lie apart, in mm. Those of adults are 20 to 32 mm apart.
const COMMISSURES_APART_MM: RangeInclusive<f64> = 10.0..=45.0;

impl FindingKind {
    /// The name in JSON and CSV.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// What is wrong with so many points; `None` if nothing is.
    fn refusal(self, points: usize) -> Option<&'static str> {
        match self {
            Self::Point if points != 1 => Some("must have one point, because it is a point"),
            Self::Line if points < 2 => Some("must have two points or more, because it is a line"),
            Self::Polygon if points < 3 => {
                Some("must have three points or more, because it is a polygon")
            }
            Self::Trajectory if points != 2 => {
                Some("must have two points, because it is a trajectory: its entry and its target")
            }
            Self::Acpc if points != 2 => Some(
                "must have two points, because it is the anterior and the posterior commissure",
            ),
            _ => None,
        }
    }
}

/// How certain the reader is that a finding is abnormal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum Certainty {
    /// Definite.
    Definite,
    /// Probable.
    Probable,
    /// Possible.
    Possible,
    /// Unlikely.
    Unlikely,
}

impl Certainty {
    /// The name in JSON and CSV.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// Something that a reader has marked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct Finding {
    /// Letters, digits, `-` and `_`, at most 64; different from the ids of the other findings of the case.
    pub id: String,
    /// The form.
    pub kind: FindingKind,
    /// LPS mm. Every point must lie in the volume of the case.
    pub points_in_patient: Vec<[f64; 3]>,
    /// The depth below the envelope at which it was marked, 0 to 200 mm.
    pub depth_mm: f64,
    /// A line of text, at most 200 characters.
    #[serde(default)]
    pub label: String,
    /// Text, at most 10,000 characters.
    #[serde(default)]
    pub note: String,
    /// How certain the reader is that it is abnormal; absent if nobody has said so.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub certainty: Option<Certainty>,
    /// `#` and six hexadecimal digits.
    #[serde(default = "default_colour")]
    #[cfg_attr(feature = "openapi", schema(pattern = "^#[0-9a-fA-F]{6}$"))]
    pub colour: String,
    /// The map in whose list of places it was found; absent if it was marked by hand.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from_map: Option<MapName>,
    /// Whether the reader has looked at it and found nothing abnormal.
    #[serde(default)]
    pub is_dismissed: bool,
    /// Whether it was taken over from another case and nobody has confirmed its place in this one. Such a finding is in no
    /// labels, measurement report or segmentation.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_unconfirmed: bool,
    /// Who wrote it, as the client names them: at most 200 characters. The server cannot verify it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub author: Option<String>,
    /// The side of the middle of its points. Set by the server, which ignores what a client sends; absent if the case
    /// was not ready.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub side: Option<PatientSide>,
    /// About which gyrus the middle of its points is in, from an atlas. Set by the server, which ignores what a client sends;
    /// absent if there is no atlas, or the head does not surely fit it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(value_type = Option<String>))]
    pub gyrus: Option<Gyrus>,
    /// About where the middle of its points is in other heads. Set by the server, which ignores what a client sends; absent where
    /// nothing is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub standard: Option<StandardPosition>,
    /// When it was first stored (RFC 3339). Set by the server, which ignores what a client sends.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub created_at: Option<String>,
    /// When it last changed (RFC 3339). Set by the server, which ignores what a client sends.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub changed_at: Option<String>,
}

fn default_colour() -> String {
    "#ffb000".to_owned()
}

/// What is wrong with a list of findings.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FindingRefused {
    /// Where, such as `findings[3].label`.
    pub path: String,
    /// What is wrong, as a sentence that begins with its verb.
    pub detail: String,
}

impl Finding {
    /// The mean of its points.
    pub fn middle_in_patient(&self) -> [f64; 3] {
        let count = self.points_in_patient.len() as f64;
        let sum = |axis: usize| -> f64 { self.points_in_patient.iter().map(|p| p[axis]).sum() };
        [0, 1, 2].map(|axis| sum(axis) / count)
    }

    /// Whether lists and reports number it: it is neither dismissed nor the commissures.
    pub fn is_numbered(&self) -> bool {
        !self.is_dismissed && self.kind != FindingKind::Acpc
    }

    /// Whether it states where the commissures are.
    pub fn states_axes(&self) -> bool {
        self.kind == FindingKind::Acpc && !self.is_dismissed && !self.is_unconfirmed
    }

    /// Whether it is given to other programs as something found: it has a number, and its place is confirmed.
    pub fn is_kept(&self) -> bool {
        self.is_numbered() && !self.is_unconfirmed
    }

    /// Whether a reader wrote the same in both: everything but what the server sets.
    pub fn says_the_same_as(&self, other: &Self) -> bool {
        let of_reader = |finding: &Self| Self {
            side: None,
            gyrus: None,
            standard: None,
            created_at: None,
            changed_at: None,
            ..finding.clone()
        };
        of_reader(self) == of_reader(other)
    }

    /// What is wrong with it: a member, and a sentence that begins with its verb.
    fn refusal(&self, is_in_volume: &dyn Fn(&[f64; 3]) -> bool) -> Option<(String, String)> {
        let wrong = |member: &str, detail: &str| Some((member.to_owned(), detail.to_owned()));
        let is_id = |byte: u8| byte.is_ascii_alphanumeric() || matches!(byte, b'-' | b'_');
        if !(1..=MAX_ID_LENGTH).contains(&self.id.len()) || !self.id.bytes().all(is_id) {
            return wrong("id", "must have 1 to 64 letters, digits, `-` and `_`");
        }
        if let Some(detail) = self.kind.refusal(self.points_in_patient.len()) {
            return wrong("points_in_patient", detail);
        }
        let outside = self
            .points_in_patient
            .iter()
            .position(|point| !is_in_volume(point));
        if let Some(index) = outside {
            let member = format!("points_in_patient[{index}]");
            return wrong(&member, "must lie in the volume of the case (LPS, mm)");
        }
        if let (FindingKind::Acpc, [anterior, posterior]) = (self.kind, &*self.points_in_patient) {
            let apart = [0, 1, 2].map(|axis| anterior[axis] - posterior[axis]);
            let apart_mm = apart.iter().map(|mm| mm * mm).sum::<f64>().sqrt();
            if !COMMISSURES_APART_MM.contains(&apart_mm) || apart[1] >= 0.0 {
                let detail = "must be the anterior commissure, then the posterior one, which lie 10 to 45 mm apart";
                return wrong("points_in_patient", detail);
            }
        }
        if !(0.0..=MAX_DEPTH_MM).contains(&self.depth_mm) {
            return wrong("depth_mm", "must be 0 to 200");
        }
        let author = self.author.as_deref().unwrap_or_default();
        for (member, text) in [("label", self.label.as_str()), ("author", author)] {
            if text.chars().count() > MAX_LABEL_LENGTH {
                return wrong(member, "must not be longer than 200 characters");
            }
            if text.chars().any(is_control) {
                return wrong(member, "must not contain control characters");
            }
        }
        if self.note.chars().count() > MAX_NOTE_LENGTH {
            return wrong("note", "must not be longer than 10,000 characters");
        }
        if self
            .note
            .chars()
            .any(|character| is_control(character) && character != '\n')
        {
            return wrong("note", "must not contain control characters but line feeds");
        }
        let digits = self.colour.strip_prefix('#').unwrap_or_default();
        if digits.len() != 6 || !digits.bytes().all(|byte| byte.is_ascii_hexdigit()) {
            return wrong("colour", "must be `#` and six hexadecimal digits");
        }
        None
    }
}

/// Checks the findings of a case.
///
/// # Errors
/// The first of them that is wrong.
pub fn check(
    findings: &[Finding],
    is_in_volume: &dyn Fn(&[f64; 3]) -> bool,
) -> Result<(), FindingRefused> {
    let refused = |path: String, detail: &str| {
        Err(FindingRefused {
            path,
            detail: detail.to_owned(),
        })
    };
    if findings.len() > MAX_FINDINGS {
        return refused(
            "findings".to_owned(),
            "must not have more than 1,000 members",
        );
    }
    let points: usize = findings
        .iter()
        .map(|finding| finding.points_in_patient.len())
        .sum();
    if points > MAX_POINTS {
        let detail = "must not have more than 20,000 points together";
        return refused("findings".to_owned(), detail);
    }
    let mut ids = HashSet::new();
    let mut has_commissures = false;
    for (index, finding) in findings.iter().enumerate() {
        if let Some((member, detail)) = finding.refusal(is_in_volume) {
            return refused(format!("findings[{index}].{member}"), &detail);
        }
        if !ids.insert(&finding.id) {
            return refused(
                format!("findings[{index}].id"),
                "is the id of another finding",
            );
        }
        if finding.states_axes() {
            if has_commissures {
                let path = format!("findings[{index}].kind");
                return refused(
                    path,
                    "must not be `acpc` twice: a head has one anterior and one posterior commissure",
                );
            }
            has_commissures = true;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn finding() -> Finding {
        Finding {
            id: "a-1".to_owned(),
            kind: FindingKind::Point,
            points_in_patient: vec![[1.0, 2.0, 3.0]],
            depth_mm: 8.0,
            label: "thick".to_owned(),
            note: "first line\nsecond line".to_owned(),
            certainty: Some(Certainty::Possible),
            colour: default_colour(),
            from_map: None,
            is_dismissed: false,
            is_unconfirmed: false,
            author: None,
            side: None,
            gyrus: None,
            standard: None,
            created_at: None,
            changed_at: None,
        }
    }

    /// Where a list is refused, in a volume from -10 to 10 mm.
    fn refused(findings: &[Finding]) -> Option<String> {
        let is_in_volume = |point: &[f64; 3]| point.iter().all(|x| x.abs() <= 10.0);
        check(findings, &is_in_volume)
            .err()
            .map(|refused| refused.path)
    }

    #[test]
    fn good_findings_pass() {
        let line = Finding {
            id: "line".to_owned(),
            kind: FindingKind::Line,
            points_in_patient: vec![[0.0; 3], [1.0; 3]],
            ..finding()
        };
        assert_eq!(refused(&[finding(), line]), None);
        assert_eq!(refused(&[]), None);
    }

    #[test]
    fn what_is_wrong_is_named_with_its_place() {
        let with = |id: &str| Finding {
            id: id.to_owned(),
            ..finding()
        };
        let of_kind = |kind| Finding { kind, ..finding() };
        let at = |point| Finding {
            points_in_patient: vec![point],
            ..finding()
        };
        let of_depth = |depth_mm| Finding {
            depth_mm,
            ..finding()
        };
        let labelled = |label: &str| Finding {
            label: label.to_owned(),
            ..finding()
        };
        let by = |author: &str| Finding {
            author: Some(author.to_owned()),
            ..finding()
        };
        let noted = |note: &str| Finding {
            note: note.to_owned(),
            ..finding()
        };
        let coloured = |colour: &str| Finding {
            colour: colour.to_owned(),
            ..finding()
        };
        for (member, wrong) in [
            ("id", with("")),
            ("id", with("a b")),
            ("id", with(&"x".repeat(65))),
            ("points_in_patient", of_kind(FindingKind::Line)),
            ("points_in_patient", of_kind(FindingKind::Polygon)),
            ("points_in_patient", of_kind(FindingKind::Trajectory)),
            ("points_in_patient[0]", at([0.0, 10.5, 0.0])),
            ("points_in_patient[0]", at([0.0, f64::NAN, 0.0])),
            ("depth_mm", of_depth(-0.1)),
            ("depth_mm", of_depth(f64::NAN)),
            ("label", labelled(&"x".repeat(201))),
            ("label", labelled("two\nlines")),
            ("author", by("\u{202e}me")),
            ("note", noted("\u{7}")),
            ("note", noted(&"x".repeat(10_001))),
            ("colour", coloured("red")),
        ] {
            let path = refused(&[with("other"), wrong]);
            assert_eq!(path, Some(format!("findings[1].{member}")));
        }
        let twice = refused(&[finding(), finding()]);
        assert_eq!(twice.as_deref(), Some("findings[1].id"));
    }

    #[test]
    fn there_is_a_limit_for_all_of_them() {
        let many = |count: usize| -> Vec<_> {
            let numbered = |number| Finding {
                id: format!("{number}"),
                ..finding()
            };
            (0..count).map(numbered).collect()
        };
        assert_eq!(refused(&many(MAX_FINDINGS)), None);
        assert_eq!(
            refused(&many(MAX_FINDINGS + 1)).as_deref(),
            Some("findings")
        );
        let long = Finding {
            kind: FindingKind::Line,
            points_in_patient: vec![[0.0; 3]; MAX_POINTS + 1],
            ..finding()
        };
        assert_eq!(refused(&[long]).as_deref(), Some("findings"));
    }

    #[test]
    fn what_the_server_sets_is_no_change() {
        let stored = Finding {
            side: Some(PatientSide::Left),
            changed_at: Some("2026-01-01T00:00:00Z".to_owned()),
            ..finding()
        };
        assert!(stored.says_the_same_as(&finding()));
        let moved = Finding {
            points_in_patient: vec![[1.0, 2.0, 3.5]],
            ..finding()
        };
        assert!(!stored.says_the_same_as(&moved));
    }
}
