//! RLE Lossless (PS3.5 annex G): each byte of the samples separately, compressed like PackBits.

/// Number and offsets of the segments.
const HEADER_BYTES: usize = 64;

/// Decodes one frame of `count` samples of `bytes_per_sample` bytes into little-endian samples.
pub(super) fn decode(
    packed: &[u8],
    count: usize,
    bytes_per_sample: usize,
) -> Result<Vec<u8>, &'static str> {
    let header = packed
        .get(..HEADER_BYTES)
        .ok_or("the RLE header is truncated")?;
    let number = |at: usize| {
        let bytes = [0, 1, 2, 3].map(|byte| header[4 * at + byte]);
        u32::from_le_bytes(bytes) as usize
    };
    if number(0) != bytes_per_sample {
        return Err("the number of RLE segments differs from the number of bytes per sample");
    }
    let mut samples = vec![0; count * bytes_per_sample];
    for segment in 0..bytes_per_sample {
        let start = number(segment + 1);
        let end = match segment + 1 < bytes_per_sample {
            true => number(segment + 2),
            false => packed.len(),
        };
        let segment_bytes = packed
            .get(start..end)
            .ok_or("an RLE segment lies outside the data")?;
        // The most significant byte comes first.
        let places = samples
            .iter_mut()
            .skip(bytes_per_sample - 1 - segment)
            .step_by(bytes_per_sample);
        unpack(segment_bytes, places)?;
    }
    Ok(samples)
}

/// Fills all places from the runs of a segment.
fn unpack<'a>(
    mut packed: &[u8],
    mut places: impl ExactSizeIterator<Item = &'a mut u8>,
) -> Result<(), &'static str> {
    const SHORT: &str = "an RLE segment is truncated";
    while places.len() > 0 {
        let (&control, rest) = packed.split_first().ok_or(SHORT)?;
        packed = rest;
        match control {
            0..=127 => {
                let length = usize::from(control) + 1;
                let (literal, rest) = packed.split_at_checked(length).ok_or(SHORT)?;
                packed = rest;
                for (&byte, place) in literal.iter().zip(&mut places) {
                    *place = byte;
                }
            }
            128 => {}
            _ => {
                let (&byte, rest) = packed.split_first().ok_or(SHORT)?;
                packed = rest;
                let length = 257 - usize::from(control);
                places.by_ref().take(length).for_each(|place| *place = byte);
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn packed(segments: &[&[u8]]) -> Vec<u8> {
        let mut bytes = (segments.len() as u32).to_le_bytes().to_vec();
        let mut at = HEADER_BYTES;
        for segment in segments {
            bytes.extend((at as u32).to_le_bytes());
            at += segment.len();
        }
        bytes.resize(HEADER_BYTES, 0);
        bytes.extend(segments.concat());
        bytes
    }

    #[test]
    fn literal_and_repeated_runs_are_unpacked_most_significant_byte_first() {
        // Samples 0x0102 three times, then 0x0304.
        let bytes = packed(&[&[254, 1, 0, 3], &[254, 2, 0, 4]]);
        let samples = decode(&bytes, 4, 2).unwrap();
        assert_eq!(samples, [2, 1, 2, 1, 2, 1, 4, 3]);
    }

    #[test]
    fn damaged_segments_are_refused() {
        assert!(decode(&[2; 10], 4, 2).is_err());
        assert!(decode(&packed(&[&[254, 1]]), 4, 1).is_err());
        assert!(decode(&packed(&[&[3, 1, 2]]), 4, 1).is_err());
        let mut outside = packed(&[&[254, 1, 0, 3]]);
        outside[4] = 255;
        assert!(decode(&outside, 4, 1).is_err());
    }
}
