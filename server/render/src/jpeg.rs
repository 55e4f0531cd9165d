//! JPEG files with the notice.

use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;

use crate::error::checked;
use crate::{Frame, PixelFormat, RESEARCH_USE_NOTICE, RenderError};

/// The marker of a comment (ITU-T T.81 B.2.4.5).
const COMMENT: [u8; 2] = [0xFF, 0xFE];

/// Bytes of the marker that begins a file, and of the marker of the first segment.
const MARKERS: usize = 4;

/// Encodes an opaque picture as JPEG, grey as grey, with [`RESEARCH_USE_NOTICE`] as its comment. `quality` is 1 to 100.
///
/// # Errors
/// If the quality is outside its range, or the picture is transparent.
pub fn encode_jpeg(frame: &Frame, quality: u8) -> Result<Vec<u8>, RenderError> {
    checked("quality", quality.into(), 1.0..=100.0, "1 to 100")?;
    let color = match frame.format() {
        PixelFormat::Grey8 => ExtendedColorType::L8,
        PixelFormat::Rgb8 => ExtendedColorType::Rgb8,
        PixelFormat::GreyAlpha8 | PixelFormat::Rgba8 => return Err(RenderError::JpegEncoding),
    };
    let size = frame.size();
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, quality)
        .encode(frame.bytes(), size.width(), size.height(), color)
        .map_err(|_| RenderError::JpegEncoding)?;
    let length = (RESEARCH_USE_NOTICE.len() + 2) as u16;
    let mut comment = COMMENT.to_vec();
    comment.extend(length.to_be_bytes());
    comment.extend(RESEARCH_USE_NOTICE.bytes());
    // JFIF asks for its own segment first.
    let length = bytes
        .get(MARKERS..MARKERS + 2)
        .ok_or(RenderError::JpegEncoding)?;
    let after = MARKERS + usize::from(u16::from_be_bytes([length[0], length[1]]));
    if after > bytes.len() {
        return Err(RenderError::JpegEncoding);
    }
    bytes.splice(after..after, comment);
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::FrameSize;

    #[test]
    fn a_jpeg_shows_nearly_the_same_and_states_the_notice() {
        let size = FrameSize::new(40, 24).unwrap();
        let bytes: Vec<u8> = (0..40 * 24 * 3).map(|at| (at / 24 % 200) as u8).collect();
        let frame = Frame::new(size, PixelFormat::Rgb8, bytes.clone());
        let jpeg = encode_jpeg(&frame, 95).unwrap();
        let read = image::load_from_memory(&jpeg).unwrap().into_rgb8();
        assert_eq!(read.dimensions(), (40, 24));
        let apart = read
            .iter()
            .zip(&bytes)
            .map(|(a, b)| u32::from(a.abs_diff(*b)));
        assert!(apart.sum::<u32>() / (bytes.len() as u32) < 6);
        let notice = RESEARCH_USE_NOTICE.as_bytes();
        assert!(jpeg.windows(notice.len()).any(|part| part == notice));
        assert_eq!(jpeg[..4], [0xFF, 0xD8, 0xFF, 0xE0], "APP0 comes first");
        assert!(encode_jpeg(&frame, 20).unwrap().len() < jpeg.len());
        assert!(encode_jpeg(&frame, 0).is_err());
    }

    #[test]
    fn grey_is_grey_and_holes_are_refused() {
        let size = FrameSize::new(8, 8).unwrap();
        let grey = Frame::new(size, PixelFormat::Grey8, vec![90; 64]);
        let jpeg = encode_jpeg(&grey, 90).unwrap();
        let read = image::load_from_memory(&jpeg).unwrap();
        assert_eq!(read.color(), image::ColorType::L8);
        let holes = Frame::new(size, PixelFormat::GreyAlpha8, vec![90; 128]);
        assert_eq!(encode_jpeg(&holes, 90), Err(RenderError::JpegEncoding));
    }
}
