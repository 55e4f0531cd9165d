//! A picture as Secondary Capture.

use dicom_core::VR;
use dicom_dictionary_std::{tags, uids};

use super::common::{Head, WriteError, file, source_image};
use crate::dicom::code::{self, Code};

/// How pictures of the isosurface are made: no voxel is resampled, so they are a rendering of a surface, and a curved
/// cut through the volume at the same time (CID 7203).
const DERIVATION: [Code; 2] = [code::SURFACE_RENDERING, code::CURVED_REFORMATTING];

/// A picture.
#[derive(Debug)]
pub struct Picture {
    /// Pixels in a row.
    pub width: u16,
    /// Rows.
    pub height: u16,
    /// Red, green and blue of each pixel in 8 bits, row by row from the top left.
    pub rgb: Vec<u8>,
    /// The patient's directions along the rows and down the columns, such as `['L', 'F']`, if all that it shows has the same.
    pub orientation: Option<[char; 2]>,
    /// The side of the brain that is seen.
    pub laterality: Laterality,
}

/// The side of the brain that a picture shows (PS3.3 C.7.6.1.1).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Laterality {
    /// The left one.
    Left,
    /// The right one.
    Right,
    /// Both.
    Both,
}

impl Laterality {
    fn code(self) -> &'static str {
        match self {
            Self::Left => "L",
            Self::Right => "R",
            Self::Both => "B",
        }
    }
}

/// A Secondary Capture.
///
/// Position and spacing are omitted, because a picture of a surface in three dimensions has none.
///
/// # Errors
/// If the pixels do not fit their size, and as [`WriteError`].
pub fn picture(head: &Head<'_>, picture: Picture) -> Result<Vec<u8>, WriteError> {
    let pixels = usize::from(picture.width) * usize::from(picture.height);
    let expected = pixels.checked_mul(3).ok_or(WriteError::Size)?;
    if expected == 0 || expected != picture.rgb.len() || u32::try_from(expected).is_err() {
        return Err(WriteError::Size);
    }
    let class = uids::SECONDARY_CAPTURE_IMAGE_STORAGE;
    let orientation = picture
        .orientation
        .map(|[row, column]| format!("{row}\\{column}"));
    let mut item = head.begin(class, "OT")?;
    item.text(tags::IMAGE_TYPE, VR::CS, r"DERIVED\SECONDARY")
        .text(tags::CONVERSION_TYPE, VR::CS, "WSD")
        .text(tags::BODY_PART_EXAMINED, VR::CS, "BRAIN")
        .text(
            tags::PATIENT_ORIENTATION,
            VR::CS,
            &orientation.unwrap_or_default(),
        )
        .text(tags::IMAGE_LATERALITY, VR::CS, picture.laterality.code())
        .codes(tags::DERIVATION_CODE_SEQUENCE, &DERIVATION)
        .shorts(tags::SAMPLES_PER_PIXEL, &[3])
        .text(tags::PHOTOMETRIC_INTERPRETATION, VR::CS, "RGB")
        .shorts(tags::PLANAR_CONFIGURATION, &[0])
        .shorts(tags::ROWS, &[picture.height])
        .shorts(tags::COLUMNS, &[picture.width])
        .shorts(tags::BITS_ALLOCATED, &[8])
        .shorts(tags::BITS_STORED, &[8])
        .shorts(tags::HIGH_BIT, &[7])
        .shorts(tags::PIXEL_REPRESENTATION, &[0]);
    let sources = head.images().map(|image| source_image(image, None));
    let sources: Vec<_> = sources.collect();
    if !sources.is_empty() {
        item.items(tags::SOURCE_IMAGE_SEQUENCE, sources);
    }
    let mut rgb = picture.rgb;
    if rgb.len() % 2 == 1 {
        rgb.push(0);
    }
    item.bytes(tags::PIXEL_DATA, rgb);
    file(item, class, head.instance_uid)
}
