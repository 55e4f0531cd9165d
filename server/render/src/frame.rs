//! Finished pixels, before encoding.

use crate::RenderError;
use crate::error::checked;

/// The largest accepted width or height, in pixels.
pub const MAX_SIDE: u32 = 4096;

/// The size of a picture: 1 to [`MAX_SIDE`] pixels per side.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct FrameSize {
    width: u32,
    height: u32,
}

impl FrameSize {
    /// A picture of `width` × `height` pixels.
    ///
    /// # Errors
    /// If a side is not in 1..=[`MAX_SIDE`].
    pub fn new(width: u32, height: u32) -> Result<Self, RenderError> {
        let accepted = 1.0..=f64::from(MAX_SIDE);
        checked(
            "width",
            f64::from(width),
            accepted.clone(),
            "1 to 4096 pixels",
        )?;
        checked("height", f64::from(height), accepted, "1 to 4096 pixels")?;
        Ok(Self { width, height })
    }

    /// Pixels in a row.
    pub fn width(self) -> u32 {
        self.width
    }

    /// Rows.
    pub fn height(self) -> u32 {
        self.height
    }

    /// Pixels in all.
    pub fn pixel_count(self) -> usize {
        self.width as usize * self.height as usize
    }
}

impl Default for FrameSize {
    /// 512 × 512.
    fn default() -> Self {
        Self {
            width: 512,
            height: 512,
        }
    }
}

/// The format of a pixel. Alpha is not premultiplied.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum PixelFormat {
    /// Grey: one byte per pixel.
    Grey8,
    /// Grey and alpha.
    GreyAlpha8,
    /// Red, green, blue.
    Rgb8,
    /// Red, green, blue, alpha.
    Rgba8,
}

impl PixelFormat {
    /// Bytes of a pixel.
    pub fn bytes_per_pixel(self) -> usize {
        match self {
            Self::Grey8 => 1,
            Self::GreyAlpha8 => 2,
            Self::Rgb8 => 3,
            Self::Rgba8 => 4,
        }
    }
}

/// A finished picture: rows from the top, pixels from the left.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Frame {
    size: FrameSize,
    format: PixelFormat,
    bytes: Vec<u8>,
}

impl Frame {
    /// A picture of the given bytes.
    ///
    /// # Panics
    /// If the length of `bytes` does not match `size` and `format`.
    pub fn new(size: FrameSize, format: PixelFormat, bytes: Vec<u8>) -> Self {
        let expected = size.pixel_count() * format.bytes_per_pixel();
        assert_eq!(bytes.len(), expected, "a frame has all of its pixels");
        Self {
            size,
            format,
            bytes,
        }
    }

    /// Its size.
    pub fn size(&self) -> FrameSize {
        self.size
    }

    /// The format of its pixels.
    pub fn format(&self) -> PixelFormat {
        self.format
    }

    /// Its pixels, row by row.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Adds the discs of another picture of the same map, whose pixels are 0 where this one has any.
    ///
    /// # Panics
    /// If its size or format differs.
    #[must_use]
    pub fn joined(mut self, other: &Self) -> Self {
        assert_eq!(
            (self.size, self.format),
            (other.size, other.format),
            "the pictures of one map are alike"
        );
        for (byte, other) in self.bytes.iter_mut().zip(&other.bytes) {
            *byte |= other;
        }
        self
    }

    /// The bytes of a pixel, `None` outside the picture.
    pub fn pixel(&self, x: u32, y: u32) -> Option<&[u8]> {
        if x >= self.size.width || y >= self.size.height {
            return None;
        }
        let index = y as usize * self.size.width as usize + x as usize;
        self.bytes
            .chunks_exact(self.format.bytes_per_pixel())
            .nth(index)
    }
}

/// A finished picture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RenderedFrame {
    /// Its pixels, in a format that depends on the request alone.
    pub frame: Frame,
    /// How many native voxels along x, y and z became one, if the volume is too large for the graphics device.
    pub reduction: Option<[usize; 3]>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_is_found_by_column_and_row() {
        let size = FrameSize::new(3, 2).unwrap();
        let frame = Frame::new(size, PixelFormat::GreyAlpha8, (0..12).collect());
        assert_eq!(frame.pixel(2, 1), Some(&[10, 11][..]));
        assert_eq!(frame.pixel(3, 0), None);
        assert_eq!(frame.pixel(0, 2), None);
    }

    #[test]
    fn sizes_are_bounded() {
        assert!(FrameSize::new(MAX_SIDE, 1).is_ok());
        assert!(FrameSize::new(0, 5).is_err());
        assert!(FrameSize::new(5, 100_000).is_err());
    }
}
