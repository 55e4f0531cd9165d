//! What comes from a PACS: series that arrive, and the index of the series of cases.
//!
//! Each instance is an object that its arrival refers to, from the moment it is acknowledged until its series is
//! forgotten. A series is due when nothing has come for it for a while; reading it is then a job. An image that comes
//! meanwhile fences that job off.

use std::fmt;
use std::time::Duration;

use crate::images::Fingerprint;
use crate::{CaseId, Failure, JobState};
use jiff::Timestamp;
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

    /// Its text.
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

    /// Its text.
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

/// A word in a column.
macro_rules! words {
    ($(#[$docs:meta])* $name:ident { $($(#[$variant_docs:meta])* $variant:ident = $word:literal),+ $(,)? }) => {
        $(#[$docs])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum $name { $($(#[$variant_docs])* $variant),+ }

        impl $name {
            /// The word in rows and answers.
            pub fn name(self) -> &'static str {
                match self { $(Self::$variant => $word),+ }
            }

            /// What a word means.
            pub fn from_name(name: &str) -> Option<Self> {
                match name { $($word => Some(Self::$variant),)+ _ => None }
            }
        }
    };
}

words! {
    /// How a series came.
    ArrivalSource {
        /// By STOW-RS.
        Stow = "stow",
        /// By C-STORE.
        CStore = "c-store",
        /// It was fetched from a node.
        Retrieval = "retrieval",
    }
}

words! {
    /// What became of a series.
    ArrivalState {
        /// Images are coming, or it waits to be read.
        Receiving = "receiving",
        /// It became a case.
        Case = "case",
        /// It became a layer, which its reason states too.
        Layer = "layer",
        /// It became nothing, for a reason.
        Nothing = "nothing",
    }
}

/// How somebody took a series, whatever the rules for series make of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Taken {
    /// What it becomes.
    #[serde(rename = "as")]
    pub kind: TakenAs,
    /// Whether missing slices are interpolated.
    #[serde(default)]
    pub allow_gaps: bool,
}

/// What a series becomes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TakenAs {
    Case,
    /// A layer of the case of its study.
    Layer,
}

/// An image that has come.
#[derive(Debug, Clone, PartialEq)]
pub struct NewInstance {
    pub uids: SeriesUids,
    /// The accession number of its study.
    pub accession_number: Option<AccessionNumber>,
    /// The image.
    pub sop_instance_uid: Uid,
    /// The digest of its file, which is an object of the kind `instance`.
    pub digest: blake3::Hash,
    /// The label of its series, if it may be kept.
    pub label: Option<String>,
    /// What it states and shows; none if it cannot be decoded.
    pub fingerprint: Option<Fingerprint>,
}

/// What a rejection note withdraws.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rejection {
    /// Whether an instance counts again when it comes again.
    pub may_return: bool,
    /// The instances of each series.
    pub series: Vec<(SeriesUids, Vec<Uid>)>,
}

/// What a rejection note has rejected of a series, until it is lifted.
#[derive(Debug, Clone, PartialEq)]
pub struct Rejected {
    /// Its name in addresses: 32 hexadecimal digits without a meaning.
    pub id: String,
    pub uids: SeriesUids,
    /// How many instances of the series.
    pub instances: usize,
    /// Whether an instance counts again when it comes again.
    pub may_return: bool,
    /// Who has sent the note, as far as that is known.
    pub by: String,
    /// When the note came.
    pub at: Timestamp,
}

/// What became of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reception {
    /// It is new.
    New,
    /// It was there, and stays as it is.
    Known,
    /// It is another one than the last with its UID, and counts from now on.
    Corrected,
    /// It has the UID of an image that can be decoded and placed, and cannot be itself: that one stays.
    Refused,
}

/// A series that came.
#[derive(Debug, Clone, PartialEq)]
pub struct Arrival {
    /// Its name in addresses: 32 hexadecimal digits without a meaning.
    pub id: String,
    pub uids: SeriesUids,
    /// The accession number of its study.
    pub accession_number: Option<AccessionNumber>,
    /// How its first image came.
    pub source: ArrivalSource,
    /// What lists call it: from the series, never from the patient.
    pub label: Option<String>,
    /// What became of it.
    pub state: ArrivalState,
    /// The reason, if it became a layer or nothing.
    pub reason: Option<Failure>,
    /// How somebody took it.
    pub taken: Option<Taken>,
    /// The reason for which it was refused before it was taken.
    pub refused: Option<Failure>,
    /// The case that it is, or of which it is a layer; also while late images are coming, but not if images were corrected or
    /// rejected since.
    pub case: Option<CaseId>,
    /// Images so far.
    pub instances: usize,
    /// How many the sender says there are.
    pub expected: Option<usize>,
    /// Images that took the place of others with the same UID since it was read before, or taken.
    pub corrected: usize,
    /// Objects that are no images and were not kept.
    pub ignored: usize,
    /// When its first image came.
    pub first_at: Timestamp,
    /// When its last image came.
    pub last_at: Timestamp,
}

/// Which series to list; without a condition, all.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct ArrivalQuery {
    /// What became of them.
    pub state: Option<ArrivalState>,
    /// The case that they became, or of which they became a layer.
    pub case: Option<CaseId>,
    /// A part of the label, whether in upper or lower case.
    pub text: Option<String>,
    /// The first image came then or later.
    pub since: Option<Timestamp>,
    /// The first image came earlier than that.
    pub until: Option<Timestamp>,
}

/// When a series is due.
#[derive(Debug, Clone, Copy)]
pub struct DueTerms {
    /// How long nothing may have come for it, unless it is known to be complete.
    pub stable: Duration,
    /// How long to wait for images that the sender announced.
    pub patience: Duration,
}

/// The reason of a series that became a layer.
pub const BECAME_LAYER: &str = "series-is-layer";

/// The reason of a series that is not T1-weighted. It waits for a case of its study, to become a layer of it.
pub const NOT_T1: &str = "series-not-t1";

/// The reason of a series that was taken as a layer and whose study has no case.
pub const NO_CASE: &str = "no-case-of-study";

/// The reason of a series whose images the PACS has rejected.
pub const REJECTED: &str = "rejected";

/// Why a series becomes nothing whose images are rejected.
pub fn images_rejected() -> Failure {
    Failure::unusable(REJECTED, "the PACS has rejected images of the series")
}

/// The reason of a series whose images have come again under another study or series.
pub const MOVED: &str = "moved";

/// The reason of a series with a stored image that is damaged.
pub const IMAGES_LOST: &str = "images-lost";

/// The reason of a corrected series of which not all images have come again.
pub const INCOMPLETE_CORRECTION: &str = "incomplete-correction";

/// The reason of a series without any image.
pub const OTHER_OBJECTS: &str = "other-objects";

/// What became of a leased series.
#[derive(Debug, Clone)]
pub enum Outcome {
    Case(CaseId),
    /// A layer of this case, which is of the same study.
    Layer(CaseId),
    /// Nothing, for this reason.
    Nothing(Failure),
}

/// Which results to list; without a condition, all.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TransferQuery {
    /// The case that a result was made from.
    pub case: Option<CaseId>,
    /// How far they are.
    pub state: Option<JobState>,
}

/// The place in a list after an item, given by its time and id.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ArrivalCursor {
    /// Microseconds since 1970.
    pub at: i64,
    /// The id of the series.
    pub id: String,
}

impl ArrivalCursor {
    /// Parses the output of `Display`; `None` for anything else.
    pub fn parse(text: &str) -> Option<Self> {
        let (at, id) = text.split_once('-')?;
        is_id(id).then_some(Self {
            at: at.parse().ok()?,
            id: id.to_owned(),
        })
    }
}

impl fmt::Display for ArrivalCursor {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}-{}", self.at, self.id)
    }
}

/// Whether a text can be the id of an arrival, a result or a job.
pub fn is_id(text: &str) -> bool {
    let allowed = |byte: u8| byte.is_ascii_digit() || (b'a'..=b'f').contains(&byte);
    text.len() == 32 && text.bytes().all(allowed)
}

/// The series of a case.
#[derive(Debug, Clone, PartialEq)]
pub struct CaseSeries {
    pub case: CaseId,
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

    #[test]
    fn a_cursor_is_read_back_as_it_was_written() {
        let cursor = ArrivalCursor {
            at: 17,
            id: "0123456789abcdef0123456789abcdef".to_owned(),
        };
        assert_eq!(ArrivalCursor::parse(&cursor.to_string()), Some(cursor));
        for text in ["", "1-2", "x-0123456789abcdef0123456789abcdef"] {
            assert_eq!(ArrivalCursor::parse(text), None, "{text}");
        }
    }
}
