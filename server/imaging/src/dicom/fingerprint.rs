//! What tells whether two files of one SOP Instance UID are the same image.

use dicom_core::Tag;
use dicom_dictionary_std::tags;
use dicom_object::InMemDicomObject;
use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::DicomError;
use super::attributes::wanted;
use super::header::{Frame, Image, NO_PIXELS, parse, read_image};
use super::loss::lost;
use super::numbers::text;
use super::pixels::for_each_frame;
use super::scan::{Scanned, scan};

/// What a result states of patient and study, what decides which head of a study counts, and the frame of reference.
const STATED: [Tag; 17] = [
    tags::PATIENT_NAME,
    tags::PATIENT_ID,
    tags::ISSUER_OF_PATIENT_ID,
    tags::PATIENT_BIRTH_DATE,
    tags::PATIENT_SEX,
    tags::STUDY_INSTANCE_UID,
    tags::SERIES_INSTANCE_UID,
    tags::STUDY_ID,
    tags::STUDY_DATE,
    tags::STUDY_TIME,
    tags::STUDY_DESCRIPTION,
    tags::ACCESSION_NUMBER,
    tags::REFERRING_PHYSICIAN_NAME,
    tags::IMAGE_TYPE,
    tags::CONTRAST_BOLUS_AGENT,
    tags::SOP_CLASS_UID,
    tags::FRAME_OF_REFERENCE_UID,
];

/// What digests are derived for.
const CONTEXT: &str = "isocortex 2026-11-28 image";

/// What an image states and shows. Another transfer syntax and other file meta information make no other one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fingerprint {
    /// A keyed digest of what it states of patient and study, of its kind, and of its decoded pixels: 32 hexadecimal digits.
    pub contents: String,
    /// The corners of each frame in LPS, in mm: x, y and z of its first pixel, of the last one of its first row, and of that of its first
    /// column. Empty if no place is stated.
    pub corners_mm: Vec<f64>,
    /// Whether its pixels have lost something by compression.
    pub is_lossy: bool,
}

/// The fingerprint of an image.
///
/// # Errors
/// If the file is no MR, CT or PET image, or its pixels cannot be decoded.
pub fn fingerprint(file: &[u8]) -> Result<Fingerprint, DicomError> {
    let scanned = scan(file, &wanted())?;
    let image = read_image(0, file, &scanned)?.ok_or(DicomError::NoImages { files: 1 })?;
    let pixels = scanned.pixels().ok_or(NO_PIXELS)?;
    let mut print = Unfinished::of(file, &scanned, &image)?;
    for_each_frame(&image, &pixels, |_, _, samples| print.add(samples))?;
    Ok(print.finish())
}

/// The fingerprint of an image whose pixels are still being decoded.
pub(super) struct Unfinished {
    hasher: blake3::Hasher,
    corners_mm: Vec<f64>,
    is_lossy: bool,
}

impl Unfinished {
    /// What the header of a file tells.
    pub(super) fn of(file: &[u8], scanned: &Scanned, image: &Image) -> Result<Self, DicomError> {
        let object = parse(scanned)?;
        let mut hasher = blake3::Hasher::new_derive_key(CONTEXT);
        for tag in STATED {
            let text = plain(&object, tag);
            hasher.update(&(text.len() as u64).to_le_bytes());
            hasher.update(text.as_bytes());
        }
        let format = image.format.as_ref().map_err(Clone::clone)?;
        let size = [format.columns, format.rows];
        let frames = image.frames.as_deref().map_err(Clone::clone)?;
        for number in [size[0], size[1], frames.len()] {
            hasher.update(&(number as u64).to_le_bytes());
        }
        for value in frames.iter().flat_map(Frame::slope_and_intercept) {
            hasher.update(&value.to_le_bytes());
        }
        let states_loss = text(&object, tags::LOSSY_IMAGE_COMPRESSION).as_deref() == Some("01");
        let corners = frames.iter().map(|frame| corners(frame, size));
        Ok(Self {
            hasher,
            corners_mm: corners
                .collect::<Option<Vec<_>>>()
                .map_or_else(Vec::new, |all| {
                    let numbers = all.into_iter().flatten().flat_map(|at| at.to_array());
                    numbers.map(|mm| (mm * 1000.0).round() / 1000.0).collect()
                }),
            is_lossy: states_loss || !lost(file, scanned, &object)?.is_empty(),
        })
    }

    /// Adds the samples of the next frame.
    pub(super) fn add(&mut self, samples: &[i32]) {
        let bytes: Vec<u8> = samples
            .iter()
            .flat_map(|sample| sample.to_le_bytes())
            .collect();
        self.hasher.update(&bytes);
    }

    pub(super) fn finish(self) -> Fingerprint {
        let digest = self.hasher.finalize().to_hex();
        Fingerprint {
            contents: digest[..32].to_owned(),
            corners_mm: self.corners_mm,
            is_lossy: self.is_lossy,
        }
    }
}

/// Where the first pixel of a frame lies, the last one of its first row, and that of its first column.
fn corners(frame: &Frame, [columns, rows]: [usize; 2]) -> Option<[DVec3; 3]> {
    let (first, axes, [between_columns, between_rows]) =
        (frame.position?, frame.axes?, frame.spacing_mm?);
    let along = |count: usize, step_mm: f64| count.saturating_sub(1) as f64 * step_mm;
    let row = axes[0] * along(columns, between_columns);
    let column = axes[1] * along(rows, between_rows);
    Some([first, first + row, first + column])
}

/// The text of an attribute, without what may differ between two ways to write one value.
fn plain(object: &InMemDicomObject, tag: Tag) -> String {
    let text = text(object, tag).unwrap_or_default();
    let text = text.trim_end_matches(['^', '=']);
    match (tag, text.split_once('.')) {
        (tags::STUDY_TIME, Some((seconds, fraction))) => {
            let fraction = fraction.trim_end_matches('0');
            format!("{seconds}.{fraction}")
                .trim_end_matches('.')
                .to_owned()
        }
        _ => text.to_owned(),
    }
}
