//! What a named reader concludes about a head, and the findings that it rests on.

use serde::{Deserialize, Serialize};

use crate::findings::{Finding, FindingRefused};
use crate::is_control;

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
}

impl Reading {
    /// Whether there is anything to sign.
    pub fn is_concluded(&self) -> bool {
        !self.conclusion.trim().is_empty()
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
    fn a_conclusion_is_plain_text_of_some_length() {
        let is_good = |text: &str| {
            let conclusion = text.to_owned();
            let findings = Vec::new();
            let reading = Reading {
                conclusion,
                findings,
            };
            reading.check_conclusion().is_ok()
        };
        assert!(is_good("") && is_good("one\ntwo – três") && is_good(&"é".repeat(10_000)));
        assert!(!is_good(&"é".repeat(10_001)) && !is_good("\u{7}") && !is_good("\u{202e}abc"));
    }
}
