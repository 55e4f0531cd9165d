//! Text and rectangles on a picture.

use std::convert::Infallible;

use embedded_graphics::Drawable as _;
use embedded_graphics::draw_target::DrawTarget;
use embedded_graphics::geometry::{OriginDimensions, Point, Size};
use embedded_graphics::mono_font::iso_8859_1::{FONT_6X10, FONT_9X15, FONT_10X20};
use embedded_graphics::mono_font::{MonoFont, MonoTextStyle};
use embedded_graphics::pixelcolor::Gray8;
use embedded_graphics::prelude::{GrayColor as _, Pixel};
use embedded_graphics::text::{Baseline, Text};

use crate::{Frame, FrameSize, PixelFormat};

const BLACK: u8 = 0;
const WHITE: u8 = 255;

/// The font for a picture whose smaller side is `side` pixels, and the pixels along the edge of a dot of it.
fn font_for(side: u32) -> (&'static MonoFont<'static>, u32) {
    match side {
        0..320 => (&FONT_6X10, 1),
        320..640 => (&FONT_9X15, 1),
        _ => (&FONT_10X20, side.div_ceil(1280)),
    }
}

/// Width and height of a letter in a picture whose smaller side is `side` pixels.
pub(crate) fn letter_size(side: u32) -> [u32; 2] {
    let (font, dot) = font_for(side);
    [
        font.character_size.width * dot,
        font.character_size.height * dot,
    ]
}

/// A picture that is written on. Letters are of a bitmap font, so they are the same pixels on every machine.
#[derive(Debug)]
pub(crate) struct Canvas {
    size: FrameSize,
    format: PixelFormat,
    bytes: Vec<u8>,
    font: &'static MonoFont<'static>,
    /// Pixels along the edge of a dot of the font.
    dot: u32,
}

impl Canvas {
    /// A picture to write on, with letters that fit a picture whose smaller side is `side` pixels.
    pub(crate) fn new(frame: Frame, side: u32) -> Self {
        let (font, dot) = font_for(side);
        Self {
            size: frame.size(),
            format: frame.format(),
            bytes: frame.bytes().to_vec(),
            font,
            dot,
        }
    }

    /// Pixels from one line to the next.
    pub(crate) fn line_height(&self) -> i32 {
        (self.font.character_size.height * self.dot) as i32
    }

    /// Pixels of a line of text.
    pub(crate) fn text_width(&self, text: &str) -> i32 {
        text.chars().count() as i32 * (self.font.character_size.width * self.dot) as i32
    }

    /// Writes a line in white with a black rim; `left` and `top` are pixels, what lies outside is left away.
    pub(crate) fn write(&mut self, text: &str, left: i32, top: i32) {
        let dot = self.dot as i32;
        for [right, down] in [
            [-1, -1],
            [0, -1],
            [1, -1],
            [-1, 0],
            [1, 0],
            [-1, 1],
            [0, 1],
            [1, 1],
        ] {
            self.write_in(text, [left + right * dot, top + down * dot], Gray8::BLACK);
        }
        self.write_in(text, [left, top], Gray8::WHITE);
    }

    fn write_in(&mut self, text: &str, [left, top]: [i32; 2], color: Gray8) {
        let font = self.font;
        let mut dots = Dots {
            canvas: self,
            left,
            top,
        };
        let style = MonoTextStyle::new(font, color);
        let Ok(_end) =
            Text::with_baseline(text, Point::zero(), style, Baseline::Top).draw(&mut dots);
    }

    /// Fills a rectangle in white with a black rim of a dot.
    pub(crate) fn bar(&mut self, left: i32, top: i32, width: i32, height: i32) {
        let rim = self.dot as i32;
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

    fn fill(&mut self, left: i32, top: i32, [width, height]: [i32; 2], value: u8) {
        for y in top..top + height {
            for x in left..left + width {
                self.set(x, y, value);
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

    fn set(&mut self, x: i32, y: i32, value: u8) {
        let format = self.format;
        let Some(pixel) = self.pixel(x, y) else {
            return;
        };
        pixel.fill(value);
        if let (PixelFormat::GreyAlpha8 | PixelFormat::Rgba8, Some(alpha)) =
            (format, pixel.last_mut())
        {
            *alpha = 255;
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

    /// The picture.
    pub(crate) fn into_frame(self) -> Frame {
        Frame::new(self.size, self.format, self.bytes)
    }
}

/// The canvas as the text library sees it: dots from a corner.
struct Dots<'a> {
    canvas: &'a mut Canvas,
    left: i32,
    top: i32,
}

impl OriginDimensions for Dots<'_> {
    fn size(&self) -> Size {
        Size::new(self.canvas.size.width(), self.canvas.size.height())
    }
}

impl DrawTarget for Dots<'_> {
    type Color = Gray8;
    type Error = Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<Gray8>>>(
        &mut self,
        pixels: I,
    ) -> Result<(), Infallible> {
        let edge = self.canvas.dot as i32;
        for Pixel(place, color) in pixels {
            let (left, top) = (self.left + place.x * edge, self.top + place.y * edge);
            self.canvas.fill(left, top, [edge, edge], color.luma());
        }
        Ok(())
    }
}
