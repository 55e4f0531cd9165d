//! Which attributes are read, and those that say whose head it is.

use dicom_core::Tag;
use dicom_dictionary_std::tags;
use dicom_object::InMemDicomObject;
use serde::{Deserialize, Serialize};

/// Sequences that are looked into. Sorted, for the search.
pub(super) const SEQUENCES: [Tag; 9] = [
    tags::MR_ECHO_SEQUENCE,
    tags::FRAME_CONTENT_SEQUENCE,
    tags::PLANE_POSITION_SEQUENCE,
    tags::PLANE_ORIENTATION_SEQUENCE,
    tags::MODALITY_LUT_SEQUENCE,
    tags::PIXEL_MEASURES_SEQUENCE,
    tags::PIXEL_VALUE_TRANSFORMATION_SEQUENCE,
    tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE,
    tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE,
];

/// Attributes, beside the identifying ones, that say where and what the pixels are.
const TECHNICAL: [Tag; 44] = [
    tags::SPECIFIC_CHARACTER_SET,
    tags::IMAGE_TYPE,
    tags::SOP_CLASS_UID,
    tags::SOP_INSTANCE_UID,
    tags::MODALITY,
    tags::SERIES_DESCRIPTION,
    tags::SEQUENCE_VARIANT,
    tags::SCANNING_SEQUENCE,
    tags::MR_ACQUISITION_TYPE,
    tags::SEQUENCE_NAME,
    tags::REPETITION_TIME,
    tags::ECHO_TIME,
    tags::INVERSION_TIME,
    tags::SPACING_BETWEEN_SLICES,
    tags::SLICE_THICKNESS,
    tags::PROTOCOL_NAME,
    tags::EFFECTIVE_ECHO_TIME,
    tags::MR_ECHO_SEQUENCE,
    tags::DIFFUSION_B_VALUE,
    tags::STUDY_INSTANCE_UID,
    tags::SERIES_INSTANCE_UID,
    tags::SERIES_NUMBER,
    tags::ACQUISITION_NUMBER,
    tags::INSTANCE_NUMBER,
    tags::IMAGE_POSITION_PATIENT,
    tags::IMAGE_ORIENTATION_PATIENT,
    tags::TEMPORAL_POSITION_IDENTIFIER,
    tags::FRAME_CONTENT_SEQUENCE,
    tags::PLANE_POSITION_SEQUENCE,
    tags::PLANE_ORIENTATION_SEQUENCE,
    tags::TEMPORAL_POSITION_INDEX,
    tags::SAMPLES_PER_PIXEL,
    tags::PHOTOMETRIC_INTERPRETATION,
    tags::NUMBER_OF_FRAMES,
    tags::ROWS,
    tags::COLUMNS,
    tags::PIXEL_SPACING,
    tags::BITS_ALLOCATED,
    tags::BITS_STORED,
    tags::HIGH_BIT,
    tags::PIXEL_REPRESENTATION,
    tags::RESCALE_INTERCEPT,
    tags::RESCALE_SLOPE,
    tags::PATIENT_ID,
];

/// Attributes that are kept with a case, by their keywords (PS3.6).
const KEPT: [(Tag, &str); 40] = [
    (tags::PATIENT_NAME, "PatientName"),
    (tags::PATIENT_ID, "PatientID"),
    (tags::ISSUER_OF_PATIENT_ID, "IssuerOfPatientID"),
    (tags::PATIENT_BIRTH_DATE, "PatientBirthDate"),
    (tags::PATIENT_SEX, "PatientSex"),
    (tags::PATIENT_AGE, "PatientAge"),
    (tags::PATIENT_SIZE, "PatientSize"),
    (tags::PATIENT_WEIGHT, "PatientWeight"),
    (tags::STUDY_INSTANCE_UID, "StudyInstanceUID"),
    (tags::STUDY_ID, "StudyID"),
    (tags::STUDY_DATE, "StudyDate"),
    (tags::STUDY_TIME, "StudyTime"),
    (tags::STUDY_DESCRIPTION, "StudyDescription"),
    (tags::ACCESSION_NUMBER, "AccessionNumber"),
    (tags::REFERRING_PHYSICIAN_NAME, "ReferringPhysicianName"),
    (tags::SERIES_INSTANCE_UID, "SeriesInstanceUID"),
    (tags::SERIES_NUMBER, "SeriesNumber"),
    (tags::SERIES_DATE, "SeriesDate"),
    (tags::SERIES_TIME, "SeriesTime"),
    (tags::SERIES_DESCRIPTION, "SeriesDescription"),
    (tags::PROTOCOL_NAME, "ProtocolName"),
    (tags::MODALITY, "Modality"),
    (tags::BODY_PART_EXAMINED, "BodyPartExamined"),
    (tags::PATIENT_POSITION, "PatientPosition"),
    (tags::FRAME_OF_REFERENCE_UID, "FrameOfReferenceUID"),
    (
        tags::POSITION_REFERENCE_INDICATOR,
        "PositionReferenceIndicator",
    ),
    (tags::ACQUISITION_DATE, "AcquisitionDate"),
    (tags::ACQUISITION_TIME, "AcquisitionTime"),
    (tags::MANUFACTURER, "Manufacturer"),
    (tags::MANUFACTURER_MODEL_NAME, "ManufacturerModelName"),
    (tags::INSTITUTION_NAME, "InstitutionName"),
    (tags::STATION_NAME, "StationName"),
    (tags::MAGNETIC_FIELD_STRENGTH, "MagneticFieldStrength"),
    (tags::SEQUENCE_NAME, "SequenceName"),
    (tags::REPETITION_TIME, "RepetitionTime"),
    (tags::ECHO_TIME, "EchoTime"),
    (tags::INVERSION_TIME, "InversionTime"),
    (tags::FLIP_ANGLE, "FlipAngle"),
    (tags::IMAGE_TYPE, "ImageType"),
    (
        tags::PHOTOMETRIC_INTERPRETATION,
        "PhotometricInterpretation",
    ),
];

/// The longest text of an attribute that is kept, in bytes.
const MAX_TEXT_BYTES: usize = 1024;

/// Every tag that is read, sorted.
pub(super) fn wanted() -> Vec<Tag> {
    let mut tags = TECHNICAL.to_vec();
    tags.extend(KEPT.map(|(tag, _)| tag));
    tags.extend(SEQUENCES);
    tags.sort_unstable();
    tags.dedup();
    tags
}

/// Whose head it is, and which images it was made of: kept apart from the pixels.
///
/// This is patient data. It belongs into no log, no error, no address and no file name.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Attributes {
    /// Values by DICOM keyword, of the first slice; several values of one attribute are separated by a backslash.
    pub attributes: Vec<(String, String)>,
    /// The images, slice by slice.
    pub instances: Vec<Instance>,
    /// Numbers of the slices, from 1, that were interpolated between their neighbours.
    pub interpolated_slices: Vec<usize>,
}

/// The image of a slice.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Instance {
    /// What kind of image it is.
    pub sop_class_uid: String,
    /// Which image.
    pub sop_instance_uid: String,
    /// Its frame, from 1, where it holds several.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub frame: Option<usize>,
}

/// The values of the attributes that are kept.
pub(super) fn kept(object: &InMemDicomObject) -> Vec<(String, String)> {
    KEPT.iter()
        .filter_map(|&(tag, keyword)| {
            let value = super::header::text(object, tag)?;
            let fits = !value.is_empty() && value.len() <= MAX_TEXT_BYTES;
            fits.then(|| (keyword.to_owned(), value))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use dicom_core::dictionary::DataDictionary;
    use dicom_dictionary_std::StandardDataDictionary;

    use super::*;

    #[test]
    fn keywords_are_those_of_the_dictionary() {
        for (tag, keyword) in KEPT {
            let entry = StandardDataDictionary.by_tag(tag).unwrap();
            assert_eq!(entry.alias, keyword);
        }
    }
}
