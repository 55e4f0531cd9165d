//! Converts pixels of the device to a frame.

use super::target::MISS;
use crate::{Frame, FrameSize, PixelFormat};

/// A frame from rows of red, green, blue and alpha, premultiplied, each with padding at its end.
pub(super) fn frame<'a>(
    size: FrameSize,
    format: PixelFormat,
    rows: impl Iterator<Item = &'a [u8]>,
) -> Frame {
    let mut bytes = Vec::with_capacity(size.pixel_count() * format.bytes_per_pixel());
    for row in rows {
        let (pixels, _) = row.as_chunks::<4>();
        let pixels = &pixels[..size.width() as usize];
        match format {
            PixelFormat::Grey8 => bytes.extend(pixels.iter().map(|[red, ..]| red)),
            PixelFormat::Rgb8 => bytes.extend(pixels.iter().flat_map(|[r, g, b, _]| [r, g, b])),
            PixelFormat::GreyAlpha8 => bytes.extend(
                pixels
                    .iter()
                    .flat_map(|&[red, _, _, alpha]| [straight(red, alpha), alpha]),
            ),
            PixelFormat::Rgba8 => bytes.extend(pixels.iter().flat_map(|&[r, g, b, alpha]| {
                [
                    straight(r, alpha),
                    straight(g, alpha),
                    straight(b, alpha),
                    alpha,
                ]
            })),
        }
    }
    Frame::new(size, format, bytes)
}

/// A colour channel without its multiplication by alpha.
fn straight(color: u8, alpha: u8) -> u8 {
    match alpha {
        0 => 0,
        255 => color,
        _ => ((u16::from(color) * 255 + u16::from(alpha) / 2) / u16::from(alpha)).min(255) as u8,
    }
}

/// Heights in mm from rows of single-precision numbers; −∞ for the background.
pub(super) fn heights<'a>(size: FrameSize, rows: impl Iterator<Item = &'a [u8]>) -> Vec<f32> {
    rows.flat_map(|row| {
        let (heights, _) = row.as_chunks::<4>();
        heights[..size.width() as usize].iter().map(|&bytes| {
            let height = f32::from_ne_bytes(bytes);
            if height > MISS {
                height
            } else {
                f32::NEG_INFINITY
            }
        })
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn padding_is_cut_off_and_alpha_taken_out() {
        let size = FrameSize::new(2, 1).unwrap();
        let row = [10, 20, 30, 255, 50, 60, 70, 128, 9, 9, 9, 9];
        let draw = |format| frame(size, format, [&row[..]].into_iter()).bytes().to_vec();
        assert_eq!(draw(PixelFormat::Grey8), [10, 50]);
        assert_eq!(draw(PixelFormat::Rgb8), [10, 20, 30, 50, 60, 70]);
        assert_eq!(draw(PixelFormat::GreyAlpha8), [10, 255, 100, 128]);
        assert_eq!(
            draw(PixelFormat::Rgba8),
            [10, 20, 30, 255, 100, 120, 139, 128]
        );
    }

    #[test]
    fn a_miss_is_no_height() {
        let size = FrameSize::new(2, 1).unwrap();
        let row: Vec<u8> = [-3.5, MISS, 7.0]
            .into_iter()
            .flat_map(f32::to_ne_bytes)
            .collect();
        assert_eq!(
            heights(size, [&row[..]].into_iter()),
            [-3.5, f32::NEG_INFINITY]
        );
    }
}
