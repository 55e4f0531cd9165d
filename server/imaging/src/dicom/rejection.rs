//! Rejection notes: Key Object Selections that withdraw what they name (IHE RAD, Imaging Object Change Management).

use dicom_core::Tag;
use dicom_dictionary_std::tags;
use dicom_object::InMemDicomObject;
use serde::{Deserialize, Serialize};

use super::DicomError;
use super::code::{self, Code};
use super::error::damaged;
use super::header::parse;
use super::numbers::{items, text};
use super::scan::scan;

/// The titles of rejection notes: quality, patient safety, incorrect worklist entry, end of retention (PS3.16 CID 7011).
const TITLES: [Code; 4] = [
    code::REJECTED_FOR_QUALITY,
    code::REJECTED_FOR_SAFETY,
    code::INCORRECT_WORKLIST_ENTRY,
    code::RETENTION_EXPIRED,
];

/// The most instances of a note.
const MAX_INSTANCES: usize = 5000;

const WANTED: [Tag; 9] = [
    tags::CODE_VALUE,
    tags::CODING_SCHEME_DESIGNATOR,
    tags::REFERENCED_SERIES_SEQUENCE,
    tags::REFERENCED_SOP_SEQUENCE,
    tags::REFERENCED_SOP_INSTANCE_UID,
    tags::STUDY_INSTANCE_UID,
    tags::SERIES_INSTANCE_UID,
    tags::CONCEPT_NAME_CODE_SEQUENCE,
    tags::CURRENT_REQUESTED_PROCEDURE_EVIDENCE_SEQUENCE,
];

/// What a note rejects.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rejection {
    /// Whether the instances may come again.
    pub may_return: bool,
    /// The instances of each series.
    pub series: Vec<RejectedSeries>,
}

/// Instances of a series that are rejected.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RejectedSeries {
    /// The study.
    pub study_uid: String,
    /// The series.
    pub series_uid: String,
    /// The instances.
    pub instance_uids: Vec<String>,
}

/// What a Key Object Selection rejects; `None` if it has another title.
///
/// # Errors
/// If it is damaged, or names more than 5,000 instances.
pub(super) fn rejection(file: &[u8]) -> Result<Option<Rejection>, DicomError> {
    let mut wanted = WANTED;
    wanted.sort_unstable();
    let note = parse(&scan(file, &wanted)?)?;
    let Some(title) = items(&note, tags::CONCEPT_NAME_CODE_SEQUENCE).first() else {
        return Ok(None);
    };
    let code = text(title, tags::CODE_VALUE).unwrap_or_default();
    let scheme = text(title, tags::CODING_SCHEME_DESIGNATOR);
    let is_it = |title: &Code| scheme.as_deref() == Some(title.scheme) && code == title.value;
    if !TITLES.iter().any(is_it) {
        return Ok(None);
    }
    let mut found = Vec::new();
    for study in items(&note, tags::CURRENT_REQUESTED_PROCEDURE_EVIDENCE_SEQUENCE) {
        for series in items(study, tags::REFERENCED_SERIES_SEQUENCE) {
            let instances = items(series, tags::REFERENCED_SOP_SEQUENCE).iter();
            found.push(RejectedSeries {
                study_uid: uid(study, tags::STUDY_INSTANCE_UID)?,
                series_uid: uid(series, tags::SERIES_INSTANCE_UID)?,
                instance_uids: instances
                    .map(|item| uid(item, tags::REFERENCED_SOP_INSTANCE_UID))
                    .collect::<Result<_, _>>()?,
            });
        }
    }
    let count: usize = found.iter().map(|series| series.instance_uids.len()).sum();
    if !(1..=MAX_INSTANCES).contains(&count) {
        return Err(damaged(
            "it is a rejection note of no instances, or of more than 5,000",
        ));
    }
    Ok(Some(Rejection {
        // What is rejected because it was kept long enough may come again.
        may_return: is_it(&code::RETENTION_EXPIRED),
        series: found,
    }))
}

fn uid(object: &InMemDicomObject, tag: Tag) -> Result<String, DicomError> {
    let uid = text(object, tag).filter(|uid| !uid.is_empty());
    uid.ok_or(damaged(
        "it is a rejection note without the UID of a study, a series or an instance",
    ))
}
