//! The label of a series in lists.

use super::attributes::Attributes;
use super::deidentify::kind_of_series;

/// The longest description in a label, in characters: the most that the standard allows (PS3.5 §6.2, LO).
const MAX_DESCRIPTION: usize = 64;

/// The shortest part of a name or an id that is looked for in a description.
const MIN_PART: usize = 3;

impl Attributes {
    /// What lists call the series: description or protocol, and the date of the study; `None` if they state none of these.
    pub fn label(&self) -> Option<String> {
        series_label(|keyword| self.value(keyword).map(str::to_owned))
    }
}

/// A label for a series, from its attributes by keyword: description or protocol, and the date of the study.
///
/// Of a description that contains a part of the patient's name or id, only the words for kinds of sequences are used.
/// `None` if the attributes state neither description nor protocol nor date.
pub(super) fn series_label(value: impl Fn(&str) -> Option<String>) -> Option<String> {
    let value = |keyword: &str| {
        let text = value(keyword).unwrap_or_default();
        text.trim().to_owned()
    };
    let names = ["SeriesDescription", "ProtocolName"].map(value);
    let description = names.into_iter().find(|name| !name.is_empty());
    let patient = ["PatientName", "PatientID"].map(value);
    let description = description.map(|text| match names_somebody(&text, &patient) {
        true => kind_of_series(&text),
        false => text.chars().take(MAX_DESCRIPTION).collect(),
    });
    let date = day(&value("StudyDate"));
    if description.is_none() && date.is_none() {
        return None;
    }
    let description = description.filter(|text| !text.is_empty());
    let first = description.unwrap_or_else(|| value("Modality"));
    let parts = [Some(first), date];
    let parts = parts.into_iter().flatten().filter(|part| !part.is_empty());
    Some(parts.collect::<Vec<_>>().join(" · ")).filter(|label| !label.is_empty())
}

/// Whether a text contains a part of a name or an id.
fn names_somebody(text: &str, of_patient: &[String]) -> bool {
    let text = text.to_lowercase();
    let separators = |letter: char| matches!(letter, '^' | '=' | ' ' | ',' | '_' | '-');
    of_patient
        .iter()
        .flat_map(|name| name.split(separators))
        .filter(|part| part.chars().count() >= MIN_PART)
        .any(|part| text.contains(&part.to_lowercase()))
}

/// A date (DA) as in ISO 8601.
fn day(date: &str) -> Option<String> {
    let is_date = date.len() == 8 && date.bytes().all(|byte| byte.is_ascii_digit());
    is_date.then(|| format!("{}-{}-{}", &date[..4], &date[4..6], &date[6..]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn label(attributes: &[(&str, &str)]) -> Option<String> {
        series_label(|keyword| {
            let found = attributes.iter().find(|(name, _)| *name == keyword);
            found.map(|(_, value)| (*value).to_owned())
        })
    }

    #[test]
    fn a_label_has_the_description_or_the_protocol_and_the_date() {
        let date = ("StudyDate", "20260102");
        let protocol = ("ProtocolName", "epilepsy_t1");
        for (attributes, expected) in [
            (
                &[("SeriesDescription", " T1 MPRAGE "), protocol, date][..],
                Some("T1 MPRAGE · 2026-01-02"),
            ),
            (&[protocol, ("StudyDate", "2026")], Some("epilepsy_t1")),
            (&[("Modality", "MR"), date], Some("MR · 2026-01-02")),
            (&[date], Some("2026-01-02")),
            (&[("Modality", "MR")], None),
            (&[], None),
        ] {
            assert_eq!(label(attributes).as_deref(), expected, "{attributes:?}");
        }
    }

    #[test]
    fn a_description_that_names_the_patient_is_not_used() {
        let patient = [
            ("PatientName", "Doe^Jane"),
            ("PatientID", "P-4711"),
            ("Modality", "MR"),
        ];
        for (description, expected) in [
            ("JANE t1 mprage", "t1 mprage · 2026-01-02"),
            ("scan of 4711", "MR · 2026-01-02"),
            ("t1 P", "t1 P · 2026-01-02"),
        ] {
            let own = [
                ("SeriesDescription", description),
                ("StudyDate", "20260102"),
            ];
            let attributes = [&patient[..], &own].concat();
            assert_eq!(label(&attributes).as_deref(), Some(expected));
        }
    }
}
