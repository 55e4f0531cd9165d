//! A rejection note: a Key Object Selection of objects of one study, with a reason as its title.

use dicom_core::VR;
use dicom_dictionary_std::{tags, uids};
use serde::{Deserialize, Serialize};

use super::common::{Head, WriteError, file, referenced};
use super::content::{related, text};
use super::item::Item;
use crate::dicom::code::{self, Code};

// The reasons of CID 7011, as clients give them.
/// Why results are withdrawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "kebab-case")]
pub enum KeyObjectTitle {
    /// For quality reasons.
    RejectedForQuality,
    /// For patient safety reasons, such as a wrong patient or side.
    RejectedForSafety,
    /// An incorrect worklist entry.
    IncorrectWorklistEntry,
    /// The data retention policy has expired.
    RetentionExpired,
}

impl KeyObjectTitle {
    fn code(self) -> Code {
        match self {
            Self::RejectedForQuality => code::REJECTED_FOR_QUALITY,
            Self::RejectedForSafety => code::REJECTED_FOR_SAFETY,
            Self::IncorrectWorklistEntry => code::INCORRECT_WORKLIST_ENTRY,
            Self::RetentionExpired => code::RETENTION_EXPIRED,
        }
    }
}

/// An object of a list.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Listed {
    /// Its series.
    pub series_uid: String,
    /// Its class.
    pub sop_class_uid: String,
    /// The object.
    pub sop_instance_uid: String,
}

impl Listed {
    fn reference(&self) -> Item {
        referenced(&self.sop_class_uid, &self.sop_instance_uid)
    }
}

/// A Key Object Selection of objects of the study of the source (PS3.3 A.35.4, PS3.16 TID 2010).
///
/// # Errors
/// If there is no object or no study, and as [`WriteError`].
pub fn key_object(
    head: &Head<'_>,
    title: KeyObjectTitle,
    listed: &[Listed],
) -> Result<Vec<u8>, WriteError> {
    let study = head
        .of_source("StudyInstanceUID")
        .ok_or(WriteError::NoStudy)?;
    if listed.is_empty() {
        return Err(WriteError::Empty);
    }
    let class = uids::KEY_OBJECT_SELECTION_DOCUMENT_STORAGE;
    let mut item = head.begin_document(class, "KO")?;
    let remark = text("CONTAINS", code::KEY_OBJECT_DESCRIPTION, head.comment);
    let image = |listed: &Listed| {
        let mut item = related("CONTAINS");
        item.text(tags::VALUE_TYPE, VR::CS, "IMAGE")
            .items(tags::REFERENCED_SOP_SEQUENCE, [listed.reference()]);
        item
    };
    let content = std::iter::once(remark).chain(listed.iter().map(image));
    item.items(tags::REFERENCED_PERFORMED_PROCEDURE_STEP_SEQUENCE, [])
        .items(
            tags::CURRENT_REQUESTED_PROCEDURE_EVIDENCE_SEQUENCE,
            [evidence_of(study, listed)],
        )
        .container(title.code(), Some("2010"), content);
    file(item, class, head.instance_uid)
}

/// The objects of a study by their series, in the order in which the series come first.
pub(super) fn evidence_of(study: &str, listed: &[Listed]) -> Item {
    let mut series: Vec<(&str, Vec<Item>)> = Vec::new();
    for each in listed {
        let known = series.iter_mut().find(|(uid, _)| *uid == each.series_uid);
        match known {
            Some((_, items)) => items.push(each.reference()),
            None => series.push((&each.series_uid, vec![each.reference()])),
        }
    }
    let item = |(uid, references): (&str, Vec<Item>)| {
        let mut item = Item::new();
        item.text(tags::SERIES_INSTANCE_UID, VR::UI, uid)
            .items(tags::REFERENCED_SOP_SEQUENCE, references);
        item
    };
    let mut evidence = Item::new();
    let series = series.into_iter().map(item);
    evidence
        .text(tags::STUDY_INSTANCE_UID, VR::UI, study)
        .items(tags::REFERENCED_SERIES_SEQUENCE, series);
    evidence
}
