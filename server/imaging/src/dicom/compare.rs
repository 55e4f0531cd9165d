//! Whether two files of one SOP Instance UID are the same image.

use dicom_core::Tag;
use dicom_dictionary_std::tags;
use dicom_object::InMemDicomObject;
use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::DicomError;
use super::attributes::wanted;
use super::frames::whole_pixel_bytes;
use super::header::{Frame, Image, parse, read_image};
use super::numbers::text;
use super::scan::scan;

/// Attributes that tell whose image it is and which study it belongs to.
const OWNER: [Tag; 11] = [
    tags::PATIENT_NAME,
    tags::PATIENT_ID,
    tags::ISSUER_OF_PATIENT_ID,
    tags::PATIENT_BIRTH_DATE,
    tags::PATIENT_SEX,
    tags::STUDY_ID,
    tags::STUDY_DATE,
    tags::STUDY_TIME,
    tags::STUDY_DESCRIPTION,
    tags::ACCESSION_NUMBER,
    tags::REFERRING_PHYSICIAN_NAME,
];

/// Attributes that tell which of several heads of a study counts, and what kind of image it is.
const CHOICE: [Tag; 3] = [
    tags::IMAGE_TYPE,
    tags::CONTRAST_BOLUS_AGENT,
    tags::SOP_CLASS_UID,
];

/// What is different about an image that was known before.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Difference {
    /// Nothing that counts: another transfer syntax and other file meta information are no change.
    None,
    /// The pixels, or what decides which head of a study counts, and no place by more than rounding.
    Pixels,
    /// The place in the patient or its frame of reference, and perhaps the pixels as well.
    Place,
    /// The patient or the study, and perhaps the pixels as well.
    Owner,
}

/// How far a corner of an image may move, in mm: numbers may be written with fewer digits.
pub const ROUNDING_MM: f64 = 0.1;

/// A file, decoded.
struct Decoded {
    owner: Vec<String>,
    /// The frame of reference of its positions.
    frame: String,
    /// What decides which head of a study counts.
    choice: Vec<String>,
    image: Option<Image>,
    pixels: Vec<u8>,
}

impl Decoded {
    fn read(file: &[u8]) -> Result<Self, DicomError> {
        let scanned = scan(file, &wanted())?;
        let object = parse(&scanned)?;
        Ok(Self {
            owner: OWNER.iter().map(|&tag| plain(&object, tag)).collect(),
            frame: plain(&object, tags::FRAME_OF_REFERENCE_UID),
            choice: CHOICE.iter().map(|&tag| plain(&object, tag)).collect(),
            image: read_image(0, file, &scanned)?,
            pixels: whole_pixel_bytes(file, &scanned, &object)?,
        })
    }

    /// Whether it states how its pixels are stored and where they lie.
    fn is_placed(&self) -> bool {
        let image = self.image.as_ref();
        image.is_some_and(|image| {
            let frames = image.frames.iter().flatten();
            let mut places = frames.map(|frame| {
                frame.position.is_some() && frame.axes.is_some() && frame.spacing_mm.is_some()
            });
            image.format.is_ok() && image.frames.is_ok() && places.all(|is_stated| is_stated)
        })
    }

    /// Whether the pixels are the same and lie in the same place.
    fn shows_the_same(&self, other: &Self) -> bool {
        // A byte that makes the length even is not a pixel.
        let length = self.pixels.len().min(other.pixels.len());
        let is_padded = self.pixels.len().abs_diff(other.pixels.len()) <= 1;
        is_padded
            && self.pixels[..length] == other.pixels[..length]
            && self.choice == other.choice
            && self.lies_where(other)
    }

    /// Whether the corners of a frame lie elsewhere, or its size is another one. Other frames are a matter of the whole series.
    fn is_moved_from(&self, other: &Self) -> bool {
        let [Some(image), Some(before)] = [self, other].map(|decoded| decoded.image.as_ref())
        else {
            return false;
        };
        let [
            (Ok(format), Ok(frames)),
            (Ok(format_before), Ok(frames_before)),
        ] = [image, before].map(|image| (image.format.as_ref(), image.frames.as_ref()))
        else {
            return false;
        };
        let size = [format.columns, format.rows];
        let is_apart = |(one, other): (&Frame, &Frame)| {
            let corners = corners(one, size).zip(corners(other, size));
            corners.is_some_and(|(one, other)| {
                let mut corners = one.iter().zip(other);
                corners.any(|(one, other)| one.distance(other) > ROUNDING_MM)
            })
        };
        size != [format_before.columns, format_before.rows]
            || frames.iter().zip(frames_before).any(is_apart)
    }

    fn lies_where(&self, other: &Self) -> bool {
        let places = |decoded: &Self| {
            let image = decoded.image.as_ref()?;
            let format = image.format.as_ref().ok();
            let format = format.map(|format| (format.rows, format.columns, format.signed));
            let frames = image.frames.as_ref().ok().map(|frames| {
                let frames = frames.iter();
                let places = frames
                    .map(|frame| (frame.position, frame.axes, frame.spacing_mm, frame.rescale));
                places.collect::<Vec<_>>()
            });
            Some((image.modality, format, frames))
        };
        places(self) == places(other)
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

/// What is different about a new file of an image that is stored already.
///
/// # Errors
/// If the new file cannot be decoded, or states no place that the stored one states. A stored one that cannot be decoded differs
/// from every other.
pub fn difference(stored: &[u8], new: &[u8]) -> Result<Difference, DicomError> {
    let new = Decoded::read(new)?;
    let Ok(stored) = Decoded::read(stored) else {
        return Ok(Difference::Pixels);
    };
    if stored.is_placed() && !new.is_placed() {
        return Err(DicomError::Damaged {
            what: "an image does not state how its pixels are stored or where they lie",
        });
    }
    Ok(match stored.owner == new.owner {
        false => Difference::Owner,
        true if new.frame != stored.frame || new.is_moved_from(&stored) => Difference::Place,
        true if stored.shows_the_same(&new) => Difference::None,
        true => Difference::Pixels,
    })
}
