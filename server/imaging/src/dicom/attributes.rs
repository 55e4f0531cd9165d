//! The attributes that are read, and those that identify the patient.

use dicom_core::Tag;
use dicom_dictionary_std::tags;
use dicom_object::InMemDicomObject;
use serde::{Deserialize, Serialize};

use super::DicomError;
use super::header::parse;
use super::scan::scan;
use super::sequences::SEQUENCES;

/// Attributes that describe the pixels and their position.
const TECHNICAL: [Tag; 60] = [
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
    tags::PIXEL_PADDING_VALUE,
    tags::PIXEL_PADDING_RANGE_LIMIT,
    tags::FRAME_TYPE,
    tags::COMPLEX_IMAGE_COMPONENT,
    tags::VELOCITY_ENCODING_DIRECTION,
    tags::RESCALE_INTERCEPT,
    tags::RESCALE_SLOPE,
    tags::PATIENT_ID,
    tags::CORRECTED_IMAGE,
    tags::RADIOPHARMACEUTICAL_INFORMATION_SEQUENCE,
    tags::RADIOPHARMACEUTICAL_START_TIME,
    tags::RADIOPHARMACEUTICAL_START_DATE_TIME,
    tags::RADIONUCLIDE_TOTAL_DOSE,
    tags::RADIONUCLIDE_HALF_LIFE,
    tags::UNITS,
    tags::DECAY_CORRECTION,
    tags::CODE_VALUE,
    tags::CODING_SCHEME_DESIGNATOR,
    tags::CODE_MEANING,
];

/// Attributes that are stored with a case, by keyword (PS3.6).
const KEPT: [(Tag, &str); 48] = [
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
    (tags::ACQUISITION_DATE_TIME, "AcquisitionDateTime"),
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
    (tags::CONTRAST_BOLUS_AGENT, "ContrastBolusAgent"),
    (
        tags::PHOTOMETRIC_INTERPRETATION,
        "PhotometricInterpretation",
    ),
    (tags::LOSSY_IMAGE_COMPRESSION, "LossyImageCompression"),
    (
        tags::LOSSY_IMAGE_COMPRESSION_RATIO,
        "LossyImageCompressionRatio",
    ),
    (
        tags::LOSSY_IMAGE_COMPRESSION_METHOD,
        "LossyImageCompressionMethod",
    ),
    (tags::PATIENT_IDENTITY_REMOVED, "PatientIdentityRemoved"),
    (tags::DEIDENTIFICATION_METHOD, "DeidentificationMethod"),
    (tags::TIMEZONE_OFFSET_FROM_UTC, "TimezoneOffsetFromUTC"),
];

/// The longest text that is stored for an attribute, in bytes.
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

/// The identity of the patient and the images of the volume, stored separately from the pixels.
///
/// This is patient data. It must not reach a log, an error, an address or a file name.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Attributes {
    /// Values from the first slice, by DICOM keyword; backslashes separate several values of one attribute.
    pub attributes: Vec<(String, String)>,
    /// The images, slice by slice.
    pub instances: Vec<Instance>,
    /// Numbers of the interpolated slices, from 1.
    pub interpolated_slices: Vec<usize>,
}

impl Attributes {
    /// The value of an attribute, as it is stored; `None` if it is absent.
    pub fn value(&self, keyword: &str) -> Option<&str> {
        let found = self.attributes.iter().find(|(name, _)| name == keyword);
        found.map(|(_, value)| value.as_str())
    }
}

/// The image of a slice.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Instance {
    /// The SOP class of the image.
    pub sop_class_uid: String,
    /// The image.
    pub sop_instance_uid: String,
    /// The frame in a multi-frame image, from 1.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub frame: Option<usize>,
    /// The number of the image in its series, or of the frame in a multi-frame image; `None` in layers.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub number: Option<i64>,
}

/// The tags and keywords of the attributes that are stored with a case.
pub(super) fn kept_tags() -> impl Iterator<Item = (Tag, &'static str)> {
    KEPT.into_iter()
}

/// What a file states of the attributes that are stored with a case; nothing of its images.
///
/// # Errors
/// If the file is damaged before its pixels.
pub fn attributes(file: &[u8]) -> Result<Attributes, DicomError> {
    let object = parse(&scan(file, &wanted())?)?;
    Ok(Attributes {
        attributes: kept(&object),
        ..Attributes::default()
    })
}

/// The values of the stored attributes.
pub(super) fn kept(object: &InMemDicomObject) -> Vec<(String, String)> {
    KEPT.iter()
        .filter_map(|&(tag, keyword)| {
            let value = super::numbers::text(object, tag).filter(|value| !value.is_empty());
            let value = match tag {
                tags::DEIDENTIFICATION_METHOD => value.or_else(|| coded_method(object)),
                _ => value,
            }?;
            let fits = !value.is_empty() && value.len() <= MAX_TEXT_BYTES;
            fits.then(|| (keyword.to_owned(), value))
        })
        .collect()
}

/// How the identity was removed, in the words of its codes.
fn coded_method(object: &InMemDicomObject) -> Option<String> {
    let codes = object.get(tags::DEIDENTIFICATION_METHOD_CODE_SEQUENCE)?;
    let meaning = |item| super::numbers::text(item, tags::CODE_MEANING);
    let meanings: Vec<String> = codes.items()?.iter().filter_map(meaning).collect();
    Some(meanings.join("\\"))
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
