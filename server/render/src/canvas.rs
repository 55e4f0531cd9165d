//! Text and rectangles on a picture.

use crate::lettering::{Coverage, Lettering};
use crate::{Frame, FrameSize, PixelFormat};

const BLACK: u8 = 0;
const WHITE: u8 = 255;

/// Width and height of a letter in a picture whose smaller side is `side` pixels, for planning a layout.
pub(crate) fn letter_size(side: u32) -> [u32; 2] {
    let lettering = Lettering::for_side(side);
    [lettering.width("0"), lettering.line_height()]
}

/// A picture to write on.
#[derive(Debug)]
pub(crate) struct Canvas {
    size: FrameSize,
    format: PixelFormat,
    bytes: Vec<u8>,
    lettering: Lettering,
}

impl Canvas {
    /// A picture to write on, with letters that fit a picture whose smaller side is `side` pixels.
    pub(crate) fn new(frame: Frame, side: u32) -> Self {
        Self {
            size: frame.size(),
            format: frame.format(),
            bytes: frame.bytes().to_vec(),
            lettering: Lettering::for_side(side),
        }
    }

    pub(crate) fn size(&self) -> FrameSize {
        self.size
    }

    /// Pixels from one line to the next.
    pub(crate) fn line_height(&self) -> i32 {
        self.lettering.line_height() as i32
    }

    /// Pixels of a line of text.
    pub(crate) fn text_width(&self, text: &str) -> i32 {
        self.lettering.width(text) as i32
    }

    /// The width of the rim around what is written, in pixels.
    fn rim(&self) -> usize {
        (self.lettering.line_height() as usize / 14).max(1)
    }

    /// Writes a line in white with a black rim; `left` and `top` are in pixels; parts outside the picture are dropped.
    pub(crate) fn write(&mut self, text: &str, left: i32, top: i32) {
        let letters = self.lettering.coverage(text);
        let rim = self.rim();
        let offset = rim as i32;
        self.paint(&letters.spread(rim), [left - offset, top - offset], BLACK);
        self.paint(&letters, [left, top], WHITE);
    }

    /// Blends a level of grey over the pixels from a corner on, by the coverage of each.
    fn paint(&mut self, coverage: &Coverage, [left, top]: [i32; 2], level: u8) {
        let width = coverage.size[0].max(1);
        for (index, &share) in coverage.shares.iter().enumerate() {
            let [x, y] = [index % width, index / width].map(|place| place as i32);
            self.blend(left + x, top + y, (level, share));
        }
    }

    /// Fills a rectangle in white with a black rim.
    pub(crate) fn bar(&mut self, left: i32, top: i32, width: i32, height: i32) {
        let rim = self.rim() as i32;
        self.fill(
            left - rim,
            top - rim,
            [width + 2 * rim, height + 2 * rim],
            BLACK,
        );
        self.fill(left, top, [width, height], WHITE);
    }

    /// Fills a rectangle of a picture in [`PixelFormat::Rgb8`] with a colour.
    pub(crate) fn swatch(
        &mut self,
        [left, top]: [i32; 2],
        [width, height]: [i32; 2],
        color: [u8; 3],
    ) {
        for y in top..top + height {
            for x in left..left + width {
                if let Some(pixel) = self.pixel(x, y) {
                    pixel.copy_from_slice(&color);
                }
            }
        }
    }

    fn fill(&mut self, left: i32, top: i32, [width, height]: [i32; 2], level: u8) {
        for y in top..top + height {
            for x in left..left + width {
                self.blend(x, y, (level, 1.0));
            }
        }
    }

    /// The bytes of a pixel, if it lies inside.
    fn pixel(&mut self, x: i32, y: i32) -> Option<&mut [u8]> {
        let (x, y) = (u32::try_from(x).ok()?, u32::try_from(y).ok()?);
        if x >= self.size.width() || y >= self.size.height() {
            return None;
        }
        let length = self.format.bytes_per_pixel();
        let start = length * (y as usize * self.size.width() as usize + x as usize);
        self.bytes.get_mut(start..start + length)
    }

    /// Blends a level of grey over a pixel.
    pub(crate) fn blend(&mut self, x: i32, y: i32, (level, share): (u8, f32)) {
        let format = self.format;
        let Some(pixel) = self.pixel(x, y).filter(|_| share > 0.0) else {
            return;
        };
        let (colors, alpha) = match format {
            PixelFormat::Grey8 | PixelFormat::Rgb8 => (pixel, None),
            PixelFormat::GreyAlpha8 | PixelFormat::Rgba8 => {
                let (colors, alpha) = pixel.split_at_mut(format.bytes_per_pixel() - 1);
                (colors, alpha.first_mut())
            }
        };
        let before = alpha
            .as_deref()
            .map_or(1.0, |&alpha| f32::from(alpha) / 255.0);
        let after = share + (1.0 - share) * before;
        // Colours are not premultiplied by alpha.
        let new = share / after;
        for color in colors {
            let mixed = f32::from(*color) * (1.0 - new) + f32::from(level) * new;
            *color = (mixed + 0.5) as u8;
        }
        if let Some(alpha) = alpha {
            *alpha = (after * 255.0 + 0.5) as u8;
        }
    }

    /// Puts a picture in the same format onto this one; it must lie inside.
    pub(crate) fn put(&mut self, frame: &Frame, left: u32, top: u32) {
        let length = self.format.bytes_per_pixel();
        let row = frame.size().width() as usize * length;
        for (y, pixels) in frame.bytes().chunks_exact(row).enumerate() {
            let at = (top as usize + y) * self.size.width() as usize + left as usize;
            self.bytes[at * length..at * length + row].copy_from_slice(pixels);
        }
    }

    pub(crate) fn into_frame(self) -> Frame {
        Frame::new(self.size, self.format, self.bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_on_nothing_is_as_opaque_as_it_covers() {
        let size = FrameSize::new(2, 1).unwrap();
        let empty = Frame::new(size, PixelFormat::GreyAlpha8, vec![0, 0, 100, 255]);
        let mut canvas = Canvas::new(empty, 512);
        let half = Coverage {
            size: [2, 1],
            shares: vec![0.5, 0.5],
        };
        canvas.paint(&half, [0, 0], WHITE);
        assert_eq!(canvas.into_frame().bytes(), [255, 128, 178, 255]);
    }

    #[test]
    fn colours_are_painted_in_all_their_parts() {
        let size = FrameSize::new(1, 1).unwrap();
        let red = Frame::new(size, PixelFormat::Rgb8, vec![200, 0, 0]);
        let mut canvas = Canvas::new(red, 512);
        canvas.fill(-3, -3, [9, 9], WHITE);
        assert_eq!(canvas.into_frame().bytes(), [255; 3]);
    }
}
