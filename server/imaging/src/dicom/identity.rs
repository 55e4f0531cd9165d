//! What an image is and which series it belongs to, without reading the image.

use dicom_core::Tag;
use dicom_dictionary_std::{tags, uids};
use dicom_object::InMemDicomObject;
use serde::{Deserialize, Serialize};

use super::DicomError;
use super::error::damaged;
use super::fingerprint::Fingerprint;
use super::header::{IMAGE_CLASSES, parse, refuse_other};
use super::label::series_label;
use super::numbers::text;
use super::rejection::{Rejection, rejection};
use super::scan::{scan, scan_as_far_as_sound};

const WANTED: [Tag; 13] = [
    tags::SPECIFIC_CHARACTER_SET,
    tags::SOP_CLASS_UID,
    tags::SOP_INSTANCE_UID,
    tags::STUDY_DATE,
    tags::ACCESSION_NUMBER,
    tags::MODALITY,
    tags::SERIES_DESCRIPTION,
    tags::PATIENT_NAME,
    tags::PATIENT_ID,
    tags::PATIENT_BIRTH_DATE,
    tags::PROTOCOL_NAME,
    tags::STUDY_INSTANCE_UID,
    tags::SERIES_INSTANCE_UID,
];

const NO_STUDY: &str = "it has no Study Instance UID";

const NO_SERIES: &str = "it has no Series Instance UID";

/// The UIDs of a file. They lead to a patient: they must not reach a log, an error, an address or a file name.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Identity {
    /// What it is.
    pub sop_class_uid: String,
    /// Which one.
    pub sop_instance_uid: String,
    /// Its study.
    pub study_uid: String,
    /// Its series.
    pub series_uid: String,
    /// The accession number of its study, if there is one.
    pub accession_number: Option<String>,
    /// What lists call its series.
    #[serde(default)]
    pub label: Option<String>,
    /// Whether it is an MR or CT image.
    pub is_image: bool,
    /// What it rejects, if it is a rejection note.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rejection: Option<Rejection>,
    /// What it states and shows, if it is an image whose pixels can be decoded, and that was asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fingerprint: Option<Fingerprint>,
}

/// The tag of an attribute that a label is made of.
fn tag_of(keyword: &str) -> Tag {
    match keyword {
        "StudyDate" => tags::STUDY_DATE,
        "Modality" => tags::MODALITY,
        "SeriesDescription" => tags::SERIES_DESCRIPTION,
        "PatientName" => tags::PATIENT_NAME,
        "PatientID" => tags::PATIENT_ID,
        "PatientBirthDate" => tags::PATIENT_BIRTH_DATE,
        _ => tags::PROTOCOL_NAME,
    }
}

/// The UIDs of a DICOM file.
///
/// # Errors
/// If it is not DICOM, is damaged before its pixels, or lacks one of the UIDs.
pub fn identify(file: &[u8]) -> Result<Identity, DicomError> {
    refuse_other(file)?;
    let object = parse(&scan(file, &WANTED)?)?;
    let uid = |tag, what| uid_of(&object, tag, what);
    let sop_class_uid = uid(tags::SOP_CLASS_UID, "it has no SOP Class UID")?;
    let is_list = sop_class_uid == uids::KEY_OBJECT_SELECTION_DOCUMENT_STORAGE;
    Ok(Identity {
        rejection: if is_list { rejection(file)? } else { None },
        is_image: IMAGE_CLASSES.contains(&&*sop_class_uid),
        sop_class_uid,
        sop_instance_uid: uid(tags::SOP_INSTANCE_UID, "it has no SOP Instance UID")?,
        study_uid: uid(tags::STUDY_INSTANCE_UID, NO_STUDY)?,
        series_uid: uid(tags::SERIES_INSTANCE_UID, NO_SERIES)?,
        accession_number: text(&object, tags::ACCESSION_NUMBER).filter(|text| !text.is_empty()),
        label: series_label(|keyword| text(&object, tag_of(keyword))),
        fingerprint: None,
    })
}

/// The study and the series of a DICOM file, which may be damaged after their UIDs.
///
/// # Errors
/// If it is damaged before, or lacks one of them.
pub fn series_of(file: &[u8]) -> Result<[String; 2], DicomError> {
    let wanted = [tags::STUDY_INSTANCE_UID, tags::SERIES_INSTANCE_UID];
    let (scanned, _fault) = scan_as_far_as_sound(file, &wanted)?;
    let object = parse(&scanned)?;
    let study = uid_of(&object, tags::STUDY_INSTANCE_UID, NO_STUDY)?;
    Ok([
        study,
        uid_of(&object, tags::SERIES_INSTANCE_UID, NO_SERIES)?,
    ])
}

fn uid_of(object: &InMemDicomObject, tag: Tag, what: &'static str) -> Result<String, DicomError> {
    let uid = text(object, tag).filter(|uid| !uid.is_empty());
    uid.ok_or(damaged(what))
}
