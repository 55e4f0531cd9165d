//! What every result states: patient, study, series, equipment, and what it is derived from.

use std::collections::HashSet;

use dicom_core::{Tag, VR};
use dicom_dictionary_std::{tags, uids};
use dicom_object::{FileMetaTableBuilder, InMemDicomObject};

use super::item::Item;
use crate::dicom::{Attributes, Instance, code};

/// Attributes of the patient and the study, which are copied from the source. Those that are marked are present even if
/// their value is not known (type 2).
const COPIED: [(&str, Tag, VR, bool); 15] = [
    ("PatientName", tags::PATIENT_NAME, VR::PN, true),
    ("PatientID", tags::PATIENT_ID, VR::LO, true),
    (
        "IssuerOfPatientID",
        tags::ISSUER_OF_PATIENT_ID,
        VR::LO,
        false,
    ),
    ("PatientBirthDate", tags::PATIENT_BIRTH_DATE, VR::DA, true),
    ("PatientSex", tags::PATIENT_SEX, VR::CS, true),
    ("PatientAge", tags::PATIENT_AGE, VR::AS, false),
    ("PatientSize", tags::PATIENT_SIZE, VR::DS, false),
    ("PatientWeight", tags::PATIENT_WEIGHT, VR::DS, false),
    ("StudyInstanceUID", tags::STUDY_INSTANCE_UID, VR::UI, true),
    ("StudyID", tags::STUDY_ID, VR::SH, true),
    ("StudyDate", tags::STUDY_DATE, VR::DA, true),
    ("StudyTime", tags::STUDY_TIME, VR::TM, true),
    ("StudyDescription", tags::STUDY_DESCRIPTION, VR::LO, false),
    ("AccessionNumber", tags::ACCESSION_NUMBER, VR::SH, true),
    (
        "ReferringPhysicianName",
        tags::REFERRING_PHYSICIAN_NAME,
        VR::PN,
        true,
    ),
];

const MANUFACTURER: &str = "Isocortex";

/// The method by which an identity was removed, if the source does not state it in words.
const UNKNOWN_METHOD: &str = "Removed from the source";

/// This program in file meta information and in associations: a UID made from a UUID (PS3.5 B.2).
pub const IMPLEMENTATION_CLASS_UID: &str = "2.25.128694716284019362450871639201743650912";

/// Its version there.
pub const IMPLEMENTATION_VERSION_NAME: &str = concat!(
    "ISOCORTEX_",
    env!("CARGO_PKG_VERSION_MAJOR"),
    "_",
    env!("CARGO_PKG_VERSION_MINOR")
);

/// Why a result cannot be written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum WriteError {
    /// The source has no study.
    #[error("the source names no study")]
    NoStudy,
    /// A segmentation lies in the frame of reference of its source.
    #[error("the source has no Frame of Reference UID")]
    NoFrameOfReference,
    /// The mask has no voxel in the volume.
    #[error("the mask is empty")]
    Empty,
    /// A picture is not RGB of its size, or there are too many.
    #[error("the pictures do not fit into an object")]
    Size,
    /// The data set cannot be encoded.
    #[error("the data set cannot be encoded")]
    Encoding,
}

/// What every result states, besides its pixels.
#[derive(Debug, Clone)]
pub struct Head<'a> {
    /// The patient, the study and the images of the source.
    pub source: &'a Attributes,
    /// The series of the result.
    pub series_uid: &'a str,
    /// The result.
    pub instance_uid: &'a str,
    /// The number of the series in its study.
    pub series_number: u32,
    /// What viewers show in their list; at most 64 characters.
    pub series_description: &'a str,
    /// How it was derived; at most 1024 characters.
    pub derivation: &'a str,
    /// A remark for readers; at most 1024 characters.
    pub comment: &'a str,
    /// The version of the program.
    pub version: &'a str,
    /// The date, as `20261122`.
    pub date: &'a str,
    /// The time, as `153000`.
    pub time: &'a str,
    /// The offset of all dates and times from UTC, those of the source too, as `+0100`; `None` if that is not known.
    pub offset: Option<&'a str>,
    /// Whether identifying text is burned into the pixels.
    pub is_annotated: bool,
    /// Whether a face may be recognised; `None` if that is not known.
    pub is_recognizable: Option<bool>,
}

impl Head<'_> {
    /// The value of an attribute of the source.
    pub(super) fn of_source(&self, keyword: &str) -> Option<&str> {
        let mut attributes = self.source.attributes.iter();
        let found = attributes.find(|(name, value)| name == keyword && !value.is_empty());
        found.map(|(_, value)| value.as_str())
    }

    /// A data set with patient, study, series, equipment, derivation and identity, of a class and a modality.
    pub(super) fn begin(&self, class: &str, modality: &str) -> Result<Item, WriteError> {
        let mut item = self.begin_document(class, modality)?;
        item.text(
            tags::DERIVATION_DESCRIPTION,
            VR::ST,
            &cut(self.derivation, 1024),
        )
        .text(tags::IMAGE_COMMENTS, VR::LT, &cut(self.comment, 1024))
        .text(
            tags::BURNED_IN_ANNOTATION,
            VR::CS,
            yes_or_no(self.is_annotated),
        );
        self.put_compression(&mut item, class);
        if let Some(is_recognizable) = self.is_recognizable {
            let value = yes_or_no(is_recognizable);
            item.text(tags::RECOGNIZABLE_VISUAL_FEATURES, VR::CS, value);
        }
        Ok(item)
    }

    /// What is derived from an image that was compressed with loss has lost something as well (PS3.3 C.7.6.1.1.5).
    fn put_compression(&self, item: &mut Item, class: &str) {
        if self.of_source("LossyImageCompression") != Some("01") {
            item.text(tags::LOSSY_IMAGE_COMPRESSION, VR::CS, "00");
            return;
        }
        item.text(tags::LOSSY_IMAGE_COMPRESSION, VR::CS, "01");
        for (keyword, tag, vr) in [
            (
                "LossyImageCompressionRatio",
                tags::LOSSY_IMAGE_COMPRESSION_RATIO,
                VR::DS,
            ),
            (
                "LossyImageCompressionMethod",
                tags::LOSSY_IMAGE_COMPRESSION_METHOD,
                VR::CS,
            ),
        ] {
            if let Some(value) = self.of_source(keyword) {
                item.text(tag, vr, value);
            }
        }
        // A segmentation must state a ratio (PS3.3 C.8.20.2); of an unknown one it is certain that it is at least 1.
        let tag = tags::LOSSY_IMAGE_COMPRESSION_RATIO;
        if class == uids::SEGMENTATION_STORAGE
            && self.of_source("LossyImageCompressionRatio").is_none()
        {
            item.text(tag, VR::DS, "1");
        }
    }

    /// As [`Head::begin`], without what only images have.
    pub(super) fn begin_document(&self, class: &str, modality: &str) -> Result<Item, WriteError> {
        self.of_source("StudyInstanceUID")
            .ok_or(WriteError::NoStudy)?;
        let mut item = Item::new();
        item.text(tags::SPECIFIC_CHARACTER_SET, VR::CS, "ISO_IR 192");
        for (keyword, tag, vr, is_required) in COPIED {
            match self.of_source(keyword) {
                Some(value) => item.text(tag, vr, value),
                None if is_required => item.text(tag, vr, ""),
                None => &mut item,
            };
        }
        if self.of_source("PatientIdentityRemoved") == Some("YES") {
            let method = self.of_source("DeidentificationMethod");
            item.text(tags::PATIENT_IDENTITY_REMOVED, VR::CS, "YES")
                .text(
                    tags::DEIDENTIFICATION_METHOD,
                    VR::LO,
                    method.unwrap_or(UNKNOWN_METHOD),
                );
        }
        if let Some(offset) = self.offset {
            item.text(tags::TIMEZONE_OFFSET_FROM_UTC, VR::SH, offset);
        }
        item.text(tags::SOP_CLASS_UID, VR::UI, class)
            .text(tags::SOP_INSTANCE_UID, VR::UI, self.instance_uid)
            .text(tags::INSTANCE_CREATION_DATE, VR::DA, self.date)
            .text(tags::INSTANCE_CREATION_TIME, VR::TM, self.time)
            .text(tags::CONTENT_DATE, VR::DA, self.date)
            .text(tags::CONTENT_TIME, VR::TM, self.time)
            .text(tags::MODALITY, VR::CS, modality)
            .text(tags::SERIES_INSTANCE_UID, VR::UI, self.series_uid)
            .text(tags::SERIES_DATE, VR::DA, self.date)
            .text(tags::SERIES_TIME, VR::TM, self.time)
            .text(tags::SERIES_NUMBER, VR::IS, &self.series_number.to_string())
            .text(
                tags::SERIES_DESCRIPTION,
                VR::LO,
                &cut(self.series_description, 64),
            )
            .text(tags::INSTANCE_NUMBER, VR::IS, "1")
            .text(tags::MANUFACTURER, VR::LO, MANUFACTURER)
            .text(tags::MANUFACTURER_MODEL_NAME, VR::LO, MANUFACTURER)
            .text(tags::SOFTWARE_VERSIONS, VR::LO, self.version);
        Ok(item)
    }

    /// The images of the source, each once.
    pub(super) fn images(&self) -> impl Iterator<Item = &Instance> {
        each_once(self.source.instances.iter())
    }
}

/// Images, each once.
pub(super) fn each_once<'a>(
    images: impl Iterator<Item = &'a Instance>,
) -> impl Iterator<Item = &'a Instance> {
    let mut seen = HashSet::new();
    images.filter(move |image| seen.insert(&image.sop_instance_uid))
}

/// A reference to an image of the source, or to one of its frames.
pub(super) fn source_image(instance: &Instance, frame: Option<usize>) -> Item {
    let mut item = reference(instance);
    if let Some(frame) = frame {
        item.text(tags::REFERENCED_FRAME_NUMBER, VR::IS, &frame.to_string());
    }
    item.codes(
        tags::PURPOSE_OF_REFERENCE_CODE_SEQUENCE,
        &[code::SOURCE_OF_PROCESSING],
    );
    item
}

/// The class and the instance of an image.
pub(super) fn reference(instance: &Instance) -> Item {
    referenced(&instance.sop_class_uid, &instance.sop_instance_uid)
}

/// The class and the instance of an object.
pub(super) fn referenced(class: &str, uid: &str) -> Item {
    let mut item = Item::new();
    item.text(tags::REFERENCED_SOP_CLASS_UID, VR::UI, class)
        .text(tags::REFERENCED_SOP_INSTANCE_UID, VR::UI, uid);
    item
}

/// The file with a data set (PS3.10).
pub(super) fn file(item: Item, class: &str, instance: &str) -> Result<Vec<u8>, WriteError> {
    let syntax = uids::EXPLICIT_VR_LITTLE_ENDIAN;
    written(item.into_object(), syntax, [class, instance])
}

/// The file with a data set of this class and this instance, in a transfer syntax.
pub(in crate::dicom) fn written(
    object: InMemDicomObject,
    syntax: &str,
    [class, instance]: [&str; 2],
) -> Result<Vec<u8>, WriteError> {
    let meta = FileMetaTableBuilder::new()
        .implementation_class_uid(IMPLEMENTATION_CLASS_UID)
        .implementation_version_name(IMPLEMENTATION_VERSION_NAME)
        .transfer_syntax(syntax)
        .media_storage_sop_class_uid(class)
        .media_storage_sop_instance_uid(instance)
        .build()
        .map_err(|_| WriteError::Encoding)?;
    let mut bytes = Vec::new();
    let file = object.with_exact_meta(meta);
    file.write_all(&mut bytes)
        .map_err(|_| WriteError::Encoding)?;
    Ok(bytes)
}

fn yes_or_no(is: bool) -> &'static str {
    if is { "YES" } else { "NO" }
}

/// The first characters of a text.
pub(super) fn cut(text: &str, most: usize) -> String {
    text.chars().take(most).collect()
}
