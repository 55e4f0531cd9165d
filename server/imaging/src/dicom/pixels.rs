//! The pixels of frames as integers.

use super::header::{Frame, Image, PixelFormat};
use super::jpeg_2000::Decoded;
use super::scan::PixelBytes;
use super::syntax::Packing;
use super::{DicomError, jpeg_2000, jpeg_lossless, jpeg_ls, rle};

/// Decodes all frames of an image and passes each to `take`, with its number from 0.
pub(super) fn for_each_frame(
    image: &Image,
    pixels: &PixelBytes,
    mut take: impl FnMut(usize, &Frame, &[i32]),
) -> Result<(), DicomError> {
    let format = image.format.as_ref().map_err(Clone::clone)?;
    let frames = image.frames.as_ref().map_err(Clone::clone)?;
    let source = Source {
        format,
        packing: image.packing,
        pixels,
        frames: frames.len(),
    };
    for (number, frame) in frames.iter().enumerate() {
        let samples = source
            .decode(number)
            .map_err(|refusal| refusal.of(frame.instance))?;
        take(number, frame, &samples);
    }
    Ok(())
}

/// The number of frames of an image, and the samples of some of them as they are stored, in little endian. `None` for a
/// frame that it does not have.
pub(super) fn stored_samples(
    image: &Image,
    pixels: &PixelBytes,
    frames: &[usize],
) -> Result<Vec<Option<Vec<u8>>>, DicomError> {
    let format = image.format.as_ref().map_err(Clone::clone)?;
    let all = image.frames.as_ref().map_err(Clone::clone)?;
    let source = Source {
        format,
        packing: image.packing,
        pixels,
        frames: all.len(),
    };
    let samples = |&number: &usize| {
        let Some(frame) = all.get(number) else {
            return Ok(None);
        };
        let samples = source
            .decode(number)
            .map_err(|refusal| refusal.of(frame.instance))?;
        Ok(Some(Stored::of(format).bytes(&samples, format)))
    };
    frames.iter().map(samples).collect()
}

/// The pixels of an image.
struct Source<'a> {
    format: &'a PixelFormat,
    packing: Packing,
    pixels: &'a PixelBytes<'a>,
    frames: usize,
}

enum Refusal {
    Unsupported(&'static str),
    Damaged(&'static str),
}

impl Refusal {
    fn of(self, instance: i64) -> DicomError {
        match self {
            Self::Unsupported(what) => DicomError::Unsupported { what },
            Self::Damaged(what) => DicomError::Pixels { instance, what },
        }
    }
}

impl From<&'static str> for Refusal {
    fn from(what: &'static str) -> Self {
        Self::Damaged(what)
    }
}

impl Source<'_> {
    fn decode(&self, frame: usize) -> Result<Vec<i32>, Refusal> {
        let format = self.format;
        let size = [format.columns, format.rows];
        let count = format.columns * format.rows;
        let bytes_per_sample = (format.bits_allocated / 8) as usize;
        let packed = || self.packed(frame);
        Ok(match self.packing {
            Packing::Native => native(
                self.native(frame, count * bytes_per_sample)?,
                format,
                format.big_endian,
            ),
            Packing::Rle => {
                let samples = rle::decode(&packed()?, count, bytes_per_sample)?;
                native(&samples, format, false)
            }
            Packing::Jpeg => whole(jpeg_lossless::decode(&packed()?, size)?, count, format)?,
            Packing::JpegLs => whole(jpeg_ls::decode(&packed()?, size)?, count, format)?,
            Packing::Jpeg2000 => jpeg_2000_samples(&packed()?, size, format)?,
            Packing::Unsupported(name) => return Err(Refusal::Unsupported(name)),
        })
    }

    /// The bytes of an uncompressed frame.
    fn native(&self, frame: usize, length: usize) -> Result<&[u8], &'static str> {
        let PixelBytes::Native(bytes) = self.pixels else {
            return Err("its pixels are compressed, although its header states otherwise");
        };
        let range = frame * length..(frame + 1) * length;
        bytes.get(range).ok_or("its pixel data is truncated")
    }

    /// The bytes of a compressed frame.
    fn packed(&self, frame: usize) -> Result<Vec<u8>, &'static str> {
        let PixelBytes::Encapsulated { offsets, fragments } = self.pixels else {
            return Err("its pixels are not compressed, although its header states so");
        };
        gather(offsets, fragments, frame, self.frames)
    }
}

fn whole(samples: Vec<u16>, count: usize, format: &PixelFormat) -> Result<Vec<i32>, &'static str> {
    if samples.len() != count {
        return Err("its number of pixels differs from its header");
    }
    let stored = Stored::of(format);
    Ok(samples.into_iter().map(|raw| stored.value(raw)).collect())
}

fn jpeg_2000_samples(
    packed: &[u8],
    size: [usize; 2],
    format: &PixelFormat,
) -> Result<Vec<i32>, &'static str> {
    Ok(as_stated(jpeg_2000::decode(packed, size)?, format))
}

/// Samples with the sign and the bits that the header states, as for other codecs.
///
/// Some writers encode signed pixels as unsigned, or the reverse, or with more bits than are stored. The sign is the highest bit
/// stored, or that of a codestream with fewer.
fn as_stated(decoded: Decoded, format: &PixelFormat) -> Vec<i32> {
    let Decoded {
        mut samples,
        bits,
        signed,
        is_exact,
    } = decoded;
    // Values that lost something may exceed the bits stored by a little.
    if signed == format.signed && !(is_exact && bits > format.bits_stored) {
        return samples;
    }
    let unused = 32 - bits.min(format.bits_stored);
    for sample in &mut samples {
        let cut = (*sample as u32) << unused;
        *sample = match format.signed {
            true => cut as i32 >> unused,
            false => (cut >> unused) as i32,
        };
    }
    samples
}

/// The compressed bytes of a frame: its fragments, concatenated.
fn gather(
    offsets: &[u8],
    fragments: &[&[u8]],
    frame: usize,
    frames: usize,
) -> Result<Vec<u8>, &'static str> {
    if frames == 1 {
        return Ok(fragments.concat());
    }
    if fragments.len() == frames {
        return Ok(fragments[frame].to_vec());
    }
    let starts: Vec<usize> = offsets
        .chunks_exact(4)
        .map(|bytes| u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]) as usize)
        .collect();
    if starts.len() != frames {
        return Err("it does not state which fragments belong to which frame");
    }
    let end = starts.get(frame + 1).copied().unwrap_or(usize::MAX);
    let mut at = 0;
    let mut packed = Vec::new();
    for fragment in fragments {
        if (starts[frame]..end).contains(&at) {
            packed.extend_from_slice(fragment);
        }
        // Each fragment begins with a tag and a length: 8 bytes.
        at += 8 + fragment.len();
    }
    Ok(packed)
}

/// Which bits of a stored sample are its value.
#[derive(Clone, Copy)]
struct Stored {
    above: u32,
    below: u32,
    signed: bool,
}

impl Stored {
    fn of(format: &PixelFormat) -> Self {
        Self {
            above: 31 - format.high_bit,
            below: 32 - format.bits_stored,
            signed: format.signed,
        }
    }

    /// Values as stored samples, in little endian.
    fn bytes(self, samples: &[i32], format: &PixelFormat) -> Vec<u8> {
        let stored = samples
            .iter()
            .map(|&value| (value as u32) << self.below >> self.above);
        match format.bits_allocated {
            8 => stored.map(|sample| sample as u8).collect(),
            _ => stored
                .flat_map(|sample| (sample as u16).to_le_bytes())
                .collect(),
        }
    }

    /// The value of a sample. Bits above the high bit, such as old overlays, are dropped.
    fn value(self, raw: u16) -> i32 {
        let high = u32::from(raw) << self.above;
        if self.signed {
            high as i32 >> self.below
        } else {
            (high >> self.below) as i32
        }
    }
}

fn native(bytes: &[u8], format: &PixelFormat, big_endian: bool) -> Vec<i32> {
    let stored = Stored::of(format);
    match (format.bits_allocated, big_endian) {
        (8, _) => bytes.iter().map(|&raw| stored.value(raw.into())).collect(),
        (_, false) => bytes
            .chunks_exact(2)
            .map(|raw| stored.value(u16::from_le_bytes([raw[0], raw[1]])))
            .collect(),
        (_, true) => bytes
            .chunks_exact(2)
            .map(|raw| stored.value(u16::from_be_bytes([raw[0], raw[1]])))
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn format(bits_stored: u32, high_bit: u32, signed: bool) -> PixelFormat {
        PixelFormat {
            rows: 1,
            columns: 1,
            bits_allocated: 16,
            bits_stored,
            high_bit,
            signed,
            big_endian: false,
        }
    }

    #[test]
    fn only_the_stored_bits_count_and_the_highest_may_be_a_sign() {
        let of = |bits, high, signed, raw| Stored::of(&format(bits, high, signed)).value(raw);
        assert_eq!(of(12, 11, false, 0xF123), 0x123);
        assert_eq!(of(12, 11, true, 0x0FFF), -1);
        assert_eq!(of(12, 15, false, 0x1230), 0x123);
        assert_eq!(of(16, 15, true, 0x8000), -32768);
        assert_eq!(of(16, 15, false, 0xFFFF), 65535);
    }

    #[test]
    fn a_codestream_of_another_sign_or_depth_has_the_values_of_the_header() {
        // Bits and sign of the codestream, bits stored and sign of the header, the sample and its value.
        for (bits, signed, stored, is_signed, sample, value) in [
            (16, false, 12, true, 0x0FEC, -20),
            (16, false, 12, true, 1751, 1751),
            (16, false, 16, true, 0xFFEC, -20),
            (12, false, 16, true, 0x0FEC, -20),
            (16, true, 16, false, -2, 65_534),
            (16, true, 16, false, 63, 63),
            (16, true, 12, false, -1, 4095),
            (16, true, 12, true, 0x0FEC, -20),
            (16, true, 16, true, -20, -20),
            (16, false, 12, false, 0x7123, 0x123),
            (12, false, 12, false, 0x123, 0x123),
        ] {
            let decoded = |is_exact| Decoded {
                samples: vec![sample],
                bits,
                signed,
                is_exact,
            };
            let format = format(stored, stored - 1, is_signed);
            assert_eq!(
                as_stated(decoded(true), &format),
                [value],
                "{bits} {signed} {stored} {is_signed}"
            );
            if signed == is_signed {
                assert_eq!(
                    as_stated(decoded(false), &format),
                    [sample],
                    "it lost something"
                );
            }
        }
    }

    #[test]
    fn values_are_stored_again_as_they_were() {
        for (bits, high, signed, raw) in [
            (12, 11, false, 0x123),
            (12, 11, true, 0x0FFF),
            (12, 15, false, 0x1230),
            (16, 15, true, 0x8000),
        ] {
            let format = format(bits, high, signed);
            let stored = Stored::of(&format);
            let bytes = stored.bytes(&[stored.value(raw)], &format);
            assert_eq!(bytes, raw.to_le_bytes(), "{bits} {high}");
        }
    }

    #[test]
    fn fragments_are_gathered_by_the_offset_table() {
        let fragments: [&[u8]; 3] = [b"aa", b"bb", b"cc"];
        let offsets = [0u32, 10].map(u32::to_le_bytes).concat();
        assert_eq!(gather(&offsets, &fragments, 0, 2).unwrap(), b"aa");
        assert_eq!(gather(&offsets, &fragments, 1, 2).unwrap(), b"bbcc");
        assert_eq!(gather(&[], &fragments, 0, 1).unwrap(), b"aabbcc");
        assert!(gather(&[], &fragments, 0, 2).is_err());
    }
}
