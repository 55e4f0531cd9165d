//! The pixels of a stored image without compression, and a file with them.

use dicom_core::value::PrimitiveValue;
use dicom_core::{DataElement, VR};
use dicom_dictionary_std::{tags, uids};
use dicom_object::InMemDicomObject;

use super::DicomError;
use super::attributes::wanted;
use super::error::{damaged, unsupported};
use super::header::{NO_PIXELS, parse, read_image};
use super::numbers::{integer, text};
use super::pixels::stored_samples;
use super::scan::{PixelBytes, Scanned, scan};
use super::syntax::{Encoding, Packing};
use super::write::written;

/// The most frames of an image.
const MAX_FRAMES: usize = 1 << 16;

/// Frames of an image, by their numbers from 0: uncompressed samples in little endian; the bits of a segmentation begin
/// with a byte. `None` for a frame that the image does not have.
///
/// # Errors
/// If the file is damaged, or its pixels cannot be decoded.
fn frames(file: &[u8], numbers: &[usize]) -> Result<Vec<Option<Vec<u8>>>, DicomError> {
    let scanned = scan(file, &wanted())?;
    let object = parse(&scanned)?;
    let pixels = scanned.pixels().ok_or(NO_PIXELS)?;
    match (scanned.syntax.packing, &pixels) {
        (Packing::Native, PixelBytes::Native(bytes)) => {
            let layout = Layout::read(&object, scanned.syntax.encoding)?;
            Ok(numbers
                .iter()
                .map(|&number| layout.frame(bytes, number))
                .collect())
        }
        _ => decoded(file, &scanned, &pixels, numbers),
    }
}

fn decoded(
    file: &[u8],
    scanned: &Scanned,
    pixels: &PixelBytes,
    numbers: &[usize],
) -> Result<Vec<Option<Vec<u8>>>, DicomError> {
    let image = read_image(0, file, scanned)?.ok_or(unsupported(
        "a compressed image that is neither MR, CT nor PET",
    ))?;
    stored_samples(&image, pixels, numbers)
}

/// Where the frames of an uncompressed image are.
struct Layout {
    /// Bits of a frame.
    bits: usize,
    frames: usize,
    /// Whether samples of 16 bits are in big endian.
    is_swapped: bool,
}

impl Layout {
    fn read(object: &InMemDicomObject, encoding: Encoding) -> Result<Self, DicomError> {
        let number = |tag| integer(object, tag).and_then(|value| usize::try_from(value).ok());
        let side = |tag| number(tag).filter(|&side| (1..=usize::from(u16::MAX)).contains(&side));
        let sides = side(tags::ROWS).zip(side(tags::COLUMNS));
        let allocated = number(tags::BITS_ALLOCATED).filter(|bits| [1, 8, 16, 32].contains(bits));
        let samples = number(tags::SAMPLES_PER_PIXEL).unwrap_or(1);
        let frames = number(tags::NUMBER_OF_FRAMES).unwrap_or(1);
        let Some(((rows, columns), allocated)) = sides.zip(allocated) else {
            return Err(damaged("an image does not state how its pixels are stored"));
        };
        if !(1..=4).contains(&samples) || frames > MAX_FRAMES {
            return Err(damaged(
                "an image has more samples or frames than are possible",
            ));
        }
        Ok(Self {
            bits: rows * columns * samples * allocated,
            frames,
            is_swapped: encoding == Encoding::ExplicitBig && allocated == 16,
        })
    }

    fn frame(&self, bytes: &[u8], number: usize) -> Option<Vec<u8>> {
        let start = (number < self.frames).then(|| number.checked_mul(self.bits))??;
        let range = start / 8..start.checked_add(self.bits)?.div_ceil(8);
        let mut frame = bytes.get(range)?.to_vec();
        let shift = start % 8;
        if shift > 0 {
            let following = frame.iter().skip(1).copied().chain([0]).collect::<Vec<_>>();
            for (byte, next) in frame.iter_mut().zip(following) {
                *byte = *byte >> shift | next << (8 - shift);
            }
        }
        frame.truncate(self.bits.div_ceil(8));
        // Bits of the next frame.
        if let (Some(last), over @ 1..) = (frame.last_mut(), self.bits % 8) {
            *last &= (1 << over) - 1;
        }
        if self.is_swapped {
            frame.chunks_exact_mut(2).for_each(<[u8]>::reverse);
        }
        Some(frame)
    }
}

/// All pixels of a file, uncompressed, in little endian.
pub(super) fn pixel_bytes(
    file: &[u8],
    scanned: &Scanned,
    object: &InMemDicomObject,
) -> Result<Vec<u8>, DicomError> {
    if let (Packing::Native, PixelBytes::Native(bytes)) =
        (scanned.syntax.packing, scanned.pixels().ok_or(NO_PIXELS)?)
    {
        let mut bytes = bytes.to_vec();
        let is_of_words = integer(object, tags::BITS_ALLOCATED) == Some(16);
        if scanned.syntax.encoding == Encoding::ExplicitBig && is_of_words {
            bytes.chunks_exact_mut(2).for_each(<[u8]>::reverse);
        }
        return Ok(bytes);
    }
    let count = integer(object, tags::NUMBER_OF_FRAMES).unwrap_or(1);
    let count = usize::try_from(count).unwrap_or(0).min(MAX_FRAMES);
    let all: Vec<usize> = (0..count).collect();
    let mut bytes: Vec<u8> = frames(file, &all)?
        .into_iter()
        .flatten()
        .flatten()
        .collect();
    if bytes.len() % 2 == 1 {
        bytes.push(0);
    }
    Ok(bytes)
}

/// A file in Explicit VR Little Endian.
pub(super) fn write_explicit(
    mut object: InMemDicomObject,
    pixels: Vec<u8>,
) -> Result<Vec<u8>, DicomError> {
    let vr = match integer(&object, tags::BITS_ALLOCATED) {
        Some(16) => VR::OW,
        _ => VR::OB,
    };
    let pixels = PrimitiveValue::U8(pixels.into());
    object.put(DataElement::new(tags::PIXEL_DATA, vr, pixels));
    let uid = |tag| text(&object, tag).unwrap_or_default();
    let [class, instance] = [tags::SOP_CLASS_UID, tags::SOP_INSTANCE_UID].map(uid);
    let syntax = uids::EXPLICIT_VR_LITTLE_ENDIAN;
    written(object, syntax, [&class, &instance]).map_err(|_| {
        damaged("it lacks the UID of its class or its instance, or cannot be written again")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_of_bits_begin_with_a_byte() {
        // Two frames of 2 × 3 pixels, the first pixel in the lowest bit.
        let layout = Layout {
            bits: 6,
            frames: 2,
            is_swapped: false,
        };
        let bytes = [0b0110_1101, 0b0000_1100];
        let first = layout.frame(&bytes, 0).unwrap();
        assert_eq!(first, [0b0010_1101]);
        assert_eq!(layout.frame(&bytes, 1).unwrap(), [0b0011_0001]);
        assert_eq!(layout.frame(&bytes, 2), None);
    }

    #[test]
    fn samples_of_big_endian_are_swapped_and_a_truncated_frame_is_none() {
        let layout = Layout {
            bits: 32,
            frames: 2,
            is_swapped: true,
        };
        assert_eq!(layout.frame(&[0, 1, 0, 2, 0, 3], 0).unwrap(), [1, 0, 2, 0]);
        assert_eq!(layout.frame(&[0, 1, 0, 2, 0, 3], 1), None);
    }
}
