//! What names the images, series and studies of DICOM, and so what a case was made of.

use std::fmt;

use serde::{Deserialize, Serialize};

/// The longest UID (PS3.5 §9.1).
const MAX_UID_LENGTH: usize = 64;

/// The longest accession number that is kept, in bytes: 16 characters (PS3.5 §6.2).
const MAX_ACCESSION_NUMBER_LENGTH: usize = 64;

/// A UID: numbers with points between them (PS3.5 §9.1). Leading zeros, which the standard forbids, are accepted, because
/// scanners write them.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Uid(String);

impl Uid {
    /// A UID without its padding; `None` for anything that is not one.
    pub fn parse(text: &str) -> Option<Self> {
        let text = text.trim_end_matches(['\0', ' ']);
        let fits = (1..=MAX_UID_LENGTH).contains(&text.len());
        let is_number =
            |part: &str| !part.is_empty() && part.bytes().all(|byte| byte.is_ascii_digit());
        (fits && text.split('.').all(is_number)).then(|| Self(text.to_owned()))
    }

    /// Whether it may be written: no number has leading zeros.
    pub fn is_strict(&self) -> bool {
        let has_zeros = |part: &str| part.len() > 1 && part.starts_with('0');
        !self.0.split('.').any(has_zeros)
    }

    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl Serialize for Uid {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&self.0)
    }
}

impl<'de> Deserialize<'de> for Uid {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        Self::parse(&text).ok_or_else(|| serde::de::Error::custom("it is no UID"))
    }
}

/// UIDs lead to patients, so they are not shown in logs.
impl fmt::Debug for Uid {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("Uid(…)")
    }
}

/// An accession number, which leads to a patient and so is not shown in logs either.
#[derive(Clone, PartialEq, Eq)]
pub struct AccessionNumber(String);

impl AccessionNumber {
    /// A number without its padding; `None` if it is empty or too long.
    pub fn parse(text: &str) -> Option<Self> {
        let text = text.trim_matches(['\0', ' ']);
        let fits = (1..=MAX_ACCESSION_NUMBER_LENGTH).contains(&text.len());
        (fits && !text.chars().any(char::is_control)).then(|| Self(text.to_owned()))
    }

    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl fmt::Debug for AccessionNumber {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("AccessionNumber(…)")
    }
}

/// What stands for a Patient ID (0010,0020) in rows: a keyed digest. Whoever knows the ID finds its cases; rows do not state it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PatientDigest(blake3::Hash);

impl PatientDigest {
    /// The digest of an ID without its padding; `None` if nothing is left.
    pub fn of(id: &str) -> Option<Self> {
        const KEY: &str = "isocortex 2026-11-28 Patient ID";
        let id = id.trim_matches(['\0', ' ']);
        (!id.is_empty()).then(|| Self(blake3::derive_key(KEY, id.as_bytes()).into()))
    }

    /// The digest of a row; `None` for anything else.
    pub fn from_hex(text: &str) -> Option<Self> {
        blake3::Hash::from_hex(text).ok().map(Self)
    }

    /// Its text in a row.
    pub fn to_hex(self) -> String {
        self.0.to_string()
    }
}

/// A series and its study.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SeriesUids {
    pub study: Uid,
    pub series: Uid,
}

/// The series of a case.
#[derive(Debug, Clone, PartialEq)]
pub struct CaseSeries {
    pub uids: SeriesUids,
    /// The accession number of the study.
    pub accession_number: Option<AccessionNumber>,
    /// The patient, if the images state a Patient ID.
    pub patient: Option<PatientDigest>,
}

/// What a request for a case names.
#[derive(Debug, Clone, PartialEq)]
pub enum SeriesQuery {
    /// A study, or one of its series.
    Study(Uid, Option<Uid>),
    /// All studies with an accession number.
    AccessionNumber(AccessionNumber),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_uid_is_digits_and_points_without_its_padding() {
        assert_eq!(Uid::parse("1.2.840\0").unwrap().as_str(), "1.2.840");
        for text in [
            "",
            "1.2a",
            "1/2",
            "..\\x",
            &"1".repeat(65),
            ".",
            "..",
            "1..2",
            ".1",
            "1.",
        ] {
            assert_eq!(Uid::parse(text), None, "{text}");
        }
        assert!(Uid::parse("1.0.2").unwrap().is_strict());
        assert!(!Uid::parse("1.002").unwrap().is_strict());
    }

    #[test]
    fn identifiers_are_not_shown() {
        let uid = Uid::parse("1.2.3").unwrap();
        let number = AccessionNumber::parse(" A7 ").unwrap();
        assert_eq!(number.as_str(), "A7");
        assert_eq!(format!("{uid:?} {number:?}"), "Uid(…) AccessionNumber(…)");
        assert_eq!(AccessionNumber::parse("a\nb"), None);
        assert_eq!(AccessionNumber::parse("  "), None);
    }

    #[test]
    fn a_patient_id_is_known_by_its_digest_without_padding() {
        let digest = PatientDigest::of("P-77 ").unwrap();
        assert_eq!(Some(digest), PatientDigest::of("P-77"));
        assert_ne!(Some(digest), PatientDigest::of("p-77"));
        assert_eq!(PatientDigest::from_hex(&digest.to_hex()), Some(digest));
        assert_ne!(digest.to_hex(), blake3::hash(b"P-77").to_string());
        assert_eq!(PatientDigest::of(" \0"), None);
    }
}
