//! What a named reader concludes about a head, and the findings that it rests on.

use serde::{Deserialize, Serialize};
use strum::IntoStaticStr;

use crate::findings::{Certainty, Finding, FindingRefused};
use crate::{Gyrus, Lobe, is_control};

/// The longest conclusion, in characters.
pub const MAX_CONCLUSION_LENGTH: usize = 10_000;

/// What a reader concludes about a case.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct Reading {
    /// Text, at most 10,000 characters.
    pub conclusion: String,
    /// Those that the conclusion rests on, as the reader saw them; as those of a case.
    pub findings: Vec<Finding>,
    /// The conclusion in fixed words; nothing is stated if it is absent.
    #[serde(default, skip_serializing_if = "Template::is_empty")]
    pub template: Template,
}

/// A conclusion in fixed words. What is absent is not stated.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(default, deny_unknown_fields)]
pub struct Template {
    /// The side of the patient.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub side: Option<Sides>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lobe: Option<Lobe>,
    /// As in findings.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(value_type = Option<String>))]
    pub gyrus: Option<Gyrus>,
    /// The boundary between grey and white matter is blurred.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub blur: Option<Sign>,
    /// The cortex is thick.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub thickening: Option<Sign>,
    /// A band leads from the cortex to the ventricle.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub transmantle: Option<Sign>,
    /// It is bright in the FLAIR.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flair: Option<Sign>,
    /// It lies at the bottom of a sulcus.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sulcal_bottom: Option<Sign>,
    /// How certain the reader is that it is abnormal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub certainty: Option<Certainty>,
}

/// One side of the patient, or both.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum Sides {
    /// The patient's left.
    Left,
    /// The patient's right.
    Right,
    /// Left and right.
    Both,
}

/// What is said of a sign.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum Sign {
    /// It is there.
    Present,
    /// It is not there.
    Absent,
    /// Nobody can tell.
    Undetermined,
}

impl Template {
    /// The names of its fields in JSON and CSV.
    pub const FIELDS: [&'static str; 9] = [
        "side",
        "lobe",
        "gyrus",
        "blur",
        "thickening",
        "transmantle",
        "flair",
        "sulcal_bottom",
        "certainty",
    ];

    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// The words of its fields, in their order.
    pub fn words(&self) -> [Option<&'static str>; 9] {
        let sign = |sign: Option<Sign>| sign.map(Into::into);
        [
            self.side.map(Into::into),
            self.lobe.map(Into::into),
            self.gyrus.map(Gyrus::name),
            sign(self.blur),
            sign(self.thickening),
            sign(self.transmantle),
            sign(self.flair),
            sign(self.sulcal_bottom),
            self.certainty.map(Certainty::name),
        ]
    }

    /// The names and words of the fields that are stated.
    pub fn stated(&self) -> impl Iterator<Item = (&'static str, &'static str)> {
        let fields = Self::FIELDS.into_iter().zip(self.words());
        fields.filter_map(|(field, word)| Some((field, word?)))
    }
}

impl Reading {
    /// Whether there is anything to sign.
    pub fn is_concluded(&self) -> bool {
        !self.conclusion.trim().is_empty() || !self.template.is_empty()
    }

    /// Checks the conclusion; [`crate::findings::check`] checks the findings.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn check_conclusion(&self) -> Result<(), FindingRefused> {
        let is_wrong = |character: char| is_control(character) && character != '\n';
        let detail = if self.conclusion.chars().count() > MAX_CONCLUSION_LENGTH {
            "must not be longer than 10,000 characters"
        } else if self.conclusion.chars().any(is_wrong) {
            "must not contain control characters but line feeds"
        } else {
            return Ok(());
        };
        Err(FindingRefused {
            path: "conclusion".to_owned(),
            detail: detail.to_owned(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_reading_is_stored_as_the_list_of_cases_knows_it() {
        let stored = serde_json::to_string(&Reading::default()).unwrap();
        assert_eq!(stored, r#"{"conclusion":"","findings":[]}"#);
    }

    #[test]
    fn a_template_is_stored_by_its_fields_and_one_of_before_has_none() {
        let stored = r#"{"conclusion":"","findings":[],"template":{"side":"left","gyrus":"insula","sulcal_bottom":"present","certainty":"probable"}}"#;
        let reading: Reading = serde_json::from_str(stored).unwrap();
        assert_eq!(serde_json::to_string(&reading).unwrap(), stored);
        let stated: Vec<_> = reading.template.stated().collect();
        assert_eq!(
            stated,
            [
                ("side", "left"),
                ("gyrus", "insula"),
                ("sulcal_bottom", "present"),
                ("certainty", "probable")
            ]
        );
        assert!(reading.is_concluded());
        let before: Reading = serde_json::from_str(r#"{"conclusion":" ","findings":[]}"#).unwrap();
        assert!(before.template.is_empty() && !before.is_concluded());
        for wrong in [r#"{"side":"middle"}"#, r#"{"lobes":"frontal"}"#] {
            assert!(serde_json::from_str::<Template>(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_conclusion_is_plain_text_of_some_length() {
        let is_good = |text: &str| {
            let reading = Reading {
                conclusion: text.to_owned(),
                ..Reading::default()
            };
            reading.check_conclusion().is_ok()
        };
        assert!(is_good("") && is_good("one\ntwo – três") && is_good(&"é".repeat(10_000)));
        assert!(!is_good(&"é".repeat(10_001)) && !is_good("\u{7}") && !is_good("\u{202e}abc"));
    }
}
