//! Removes the identity of the patient (PS3.15 annex E, Basic Profile, pixels apart).
//!
//! Only what is needed to read a volume is kept: attributes of a short list, and UIDs that are replaced. The same UID has
//! the same replacement everywhere, so that the images of a series stay together.

use dicom_core::value::{DataSetSequence, PrimitiveValue};
use dicom_core::{DataElement, Tag, VR};
use dicom_dictionary_std::{tags, uids};
use dicom_object::InMemDicomObject;

use super::DicomError;
use super::attributes::{Attributes, kept_tags, wanted};
use super::choose::{OTHER_WORDS, T1_WORDS, sequence_name};
use super::frames::{pixel_bytes, write_explicit};
use super::header::parse;
use super::loss::lost;
use super::numbers::text;
use super::scan::scan;
use super::write::uid_of;

/// What replaced UIDs are derived for.
const CONTEXT: &str = "Isocortex 2026-11-22 replaced UID";

/// Attributes that are kept although they describe more than the pixels: the Basic Profile does not remove them.
const KEPT: [&str; 16] = [
    "SeriesNumber",
    "Modality",
    "BodyPartExamined",
    "PatientPosition",
    "Manufacturer",
    "ManufacturerModelName",
    "MagneticFieldStrength",
    "RepetitionTime",
    "EchoTime",
    "InversionTime",
    "FlipAngle",
    "ImageType",
    "PhotometricInterpretation",
    "LossyImageCompression",
    "LossyImageCompressionRatio",
    "LossyImageCompressionMethod",
];

const REPLACED: [&str; 3] = [
    "StudyInstanceUID",
    "SeriesInstanceUID",
    "FrameOfReferenceUID",
];

const REPLACED_TAGS: [Tag; 4] = [
    tags::STUDY_INSTANCE_UID,
    tags::SERIES_INSTANCE_UID,
    tags::FRAME_OF_REFERENCE_UID,
    tags::SOP_INSTANCE_UID,
];

/// Attributes besides those that are stored with a case.
const REMOVED: [Tag; 2] = [
    tags::RADIOPHARMACEUTICAL_START_TIME,
    tags::RADIOPHARMACEUTICAL_START_DATE_TIME,
];

/// Attributes of patient, study and series that an image must have, if only without a value (type 2).
const REQUIRED: [(Tag, VR); 13] = [
    (tags::PATIENT_BIRTH_DATE, VR::DA),
    (tags::PATIENT_SEX, VR::CS),
    (tags::STUDY_DATE, VR::DA),
    (tags::STUDY_TIME, VR::TM),
    (tags::REFERRING_PHYSICIAN_NAME, VR::PN),
    (tags::STUDY_ID, VR::SH),
    (tags::ACCESSION_NUMBER, VR::SH),
    (tags::SERIES_NUMBER, VR::IS),
    (tags::LATERALITY, VR::CS),
    (tags::PATIENT_POSITION, VR::CS),
    (tags::MANUFACTURER, VR::LO),
    (tags::POSITION_REFERENCE_INDICATOR, VR::LO),
    (tags::INSTANCE_NUMBER, VR::IS),
];

/// Those of an MR image.
const REQUIRED_OF_MR: [(Tag, VR); 5] = [
    (tags::SCAN_OPTIONS, VR::CS),
    (tags::MR_ACQUISITION_TYPE, VR::CS),
    (tags::REPETITION_TIME, VR::DS),
    (tags::ECHO_TIME, VR::DS),
    (tags::ECHO_TRAIN_LENGTH, VR::IS),
];

/// Words of the names of a series that tell its kind, besides those by which a series is chosen. Nothing else of these names is kept.
const FURTHER_WORDS: [&str; 3] = ["ep2d", "epi_", "3d"];

/// The UID in place of another one.
pub fn replaced_uid(uid: &str) -> String {
    uid_of(&blake3::derive_key(CONTEXT, uid.as_bytes()).into())
}

/// The words in the names of a series that tell its kind. Nothing else of the names is in it, which may be somebody's.
pub fn kind_of_series(names: &str) -> String {
    // As where the kind is recognised: a protocol for epilepsy is not echo-planar.
    let names = names.to_lowercase().replace("epilep", "");
    let words = T1_WORDS.iter().chain(&OTHER_WORDS).chain(&FURTHER_WORDS);
    let kept: Vec<&str> = words.copied().filter(|word| names.contains(word)).collect();
    kept.join(" ")
}

impl Attributes {
    /// The same without the identity of the patient.
    #[must_use]
    pub fn deidentified(self) -> Self {
        let value = |name| self.value(name).unwrap_or("");
        let names = [value("SeriesDescription"), value("ProtocolName")].join(" ");
        let description = kind_of_series(&names);
        let kept = self.attributes.iter().filter_map(|(keyword, value)| {
            let value = match keyword.as_str() {
                "SequenceName" => sequence_name(value)?.to_owned(),
                name if KEPT.contains(&name) => value.clone(),
                name if REPLACED.contains(&name) => replaced_uid(value),
                _ => return None,
            };
            Some((keyword.clone(), value))
        });
        let mut attributes: Vec<_> = kept.collect();
        if !description.is_empty() {
            attributes.push(("SeriesDescription".to_owned(), description));
        }
        let mut instances = self.instances;
        for instance in &mut instances {
            instance.sop_instance_uid = replaced_uid(&instance.sop_instance_uid);
        }
        Self {
            attributes,
            instances,
            interpolated_slices: self.interpolated_slices,
        }
    }
}

/// An image without the identity of the patient, as a file in Explicit VR Little Endian. Only attributes that are needed to
/// read a volume remain.
///
/// # Errors
/// If the file is damaged, or its pixels cannot be decoded.
pub fn deidentified_file(file: &[u8]) -> Result<Vec<u8>, DicomError> {
    let scanned = scan(file, &wanted())?;
    let object = parse(&scanned)?;
    let pixels = pixel_bytes(file, &scanned, &object)?;
    let names = [tags::SERIES_DESCRIPTION, tags::PROTOCOL_NAME];
    let names = names.map(|tag| text(&object, tag).unwrap_or_default());
    let mut kept = without_identity(&object);
    let sequence = text(&object, tags::SEQUENCE_NAME).unwrap_or_default();
    kept.remove_element(tags::SEQUENCE_NAME);
    if let Some(name) = sequence_name(&sequence) {
        let name = PrimitiveValue::from(name);
        kept.put(DataElement::new(tags::SEQUENCE_NAME, VR::SH, name));
    }
    let class = text(&object, tags::SOP_CLASS_UID);
    let is_mr = class.as_deref() == Some(uids::MR_IMAGE_STORAGE);
    let of_mr = REQUIRED_OF_MR.into_iter().filter(|_| is_mr);
    // A head has no side; without a value, Laterality would state that the body part has an unknown one.
    let has_part = text(&kept, tags::BODY_PART_EXAMINED).is_some_and(|part| !part.is_empty());
    for (tag, vr) in REQUIRED.into_iter().chain(of_mr) {
        let is_needed = tag != tags::LATERALITY || !has_part;
        if is_needed && kept.get(tag).is_none() {
            kept.put(DataElement::new(tag, vr, PrimitiveValue::Empty));
        }
    }
    // The pixels are written without compression, but what was lost stays lost.
    for (_, tag, vr, value) in lost(file, &scanned, &object)? {
        if kept.get(tag).is_none() {
            kept.put(DataElement::new(tag, vr, PrimitiveValue::from(value)));
        }
    }
    for (tag, vr, value) in [
        (
            tags::SERIES_DESCRIPTION,
            VR::LO,
            kind_of_series(&names.join(" ")),
        ),
        (tags::PATIENT_NAME, VR::PN, String::new()),
        (tags::PATIENT_ID, VR::LO, String::new()),
        (tags::PATIENT_IDENTITY_REMOVED, VR::CS, "YES".to_owned()),
        (
            tags::DEIDENTIFICATION_METHOD,
            VR::LO,
            "PS3.15 Basic Profile, pixels apart".to_owned(),
        ),
        (
            tags::LONGITUDINAL_TEMPORAL_INFORMATION_MODIFIED,
            VR::CS,
            "REMOVED".to_owned(),
        ),
    ] {
        let value = match value.is_empty() {
            true => PrimitiveValue::Empty,
            false => PrimitiveValue::from(value),
        };
        kept.put(DataElement::new(tag, vr, value));
    }
    write_explicit(kept, pixels)
}

/// What is kept of a data set, or of an item in it.
fn without_identity(object: &InMemDicomObject) -> InMemDicomObject {
    let mut kept = InMemDicomObject::new_empty();
    for element in object {
        let header = element.header();
        let tag = header.tag;
        if REPLACED_TAGS.contains(&tag) {
            let uid = text(object, tag).unwrap_or_default();
            kept.put(DataElement::new(
                tag,
                VR::UI,
                PrimitiveValue::from(replaced_uid(&uid)),
            ));
        } else if let Some(items) = element.items() {
            let items: Vec<_> = items.iter().map(without_identity).collect();
            kept.put(DataElement::new(tag, VR::SQ, DataSetSequence::from(items)));
        } else if is_kept(tag) {
            kept.put(element.clone());
        }
    }
    kept
}

/// Whether an attribute that is needed to read a volume may stay.
fn is_kept(tag: Tag) -> bool {
    let mut stored = kept_tags();
    let is_allowed = stored.find(|(stored, _)| *stored == tag);
    let is_allowed = is_allowed.is_none_or(|(_, keyword)| KEPT.contains(&keyword));
    is_allowed && !REMOVED.contains(&tag)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dicom::Instance;

    #[test]
    fn a_uid_has_one_replacement_which_is_a_uid() {
        let uid = replaced_uid("1.2.3");
        assert!(uid.starts_with("2.25.") && uid.len() <= 64);
        assert_eq!(uid, replaced_uid("1.2.3"));
        assert_ne!(uid, replaced_uid("1.2.4"));
    }

    #[test]
    fn only_the_kind_remains_of_names() {
        assert_eq!(kind_of_series("T1_MPRAGE Somebody epilepsy"), "t1 mprage");
        assert_eq!(kind_of_series("Somebody"), "");
    }

    #[test]
    fn stored_attributes_lose_everything_that_is_not_listed() {
        let text = |name: &str, value: &str| (name.to_owned(), value.to_owned());
        let attributes = Attributes {
            attributes: vec![
                text("PatientName", "Somebody"),
                text("StudyInstanceUID", "1.2.3"),
                text("SeriesDescription", "t1 of Somebody"),
                text("StudyDate", "20261101"),
                text("EchoTime", "2.98"),
            ],
            instances: vec![Instance {
                sop_class_uid: "1.2".to_owned(),
                sop_instance_uid: "1.2.3.4".to_owned(),
                frame: None,
                number: Some(7),
            }],
            interpolated_slices: vec![3],
        };
        let left = attributes.deidentified();
        assert_eq!(
            left.attributes,
            [
                text("StudyInstanceUID", &replaced_uid("1.2.3")),
                text("EchoTime", "2.98"),
                text("SeriesDescription", "t1"),
            ]
        );
        assert_eq!(left.instances[0].sop_instance_uid, replaced_uid("1.2.3.4"));
        assert_eq!(left.interpolated_slices, [3]);
    }
}
