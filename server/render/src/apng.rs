use std::io::Write;
use std::num::NonZeroU32;
use std::sync::{Arc, Mutex, PoisonError};

use crate::png::{add_text, color_type};
use crate::{Frame, FrameSize, PixelFormat, RESEARCH_USE_NOTICE, RenderError};

/// Writes an animated PNG frame by frame; the animation repeats for ever.
pub struct AnimatedPng {
    writer: png::Writer<Shared>,
    bytes: Shared,
    missing: u32,
}

impl std::fmt::Debug for AnimatedPng {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter
            .debug_struct("AnimatedPng")
            .finish_non_exhaustive()
    }
}

impl AnimatedPng {
    /// Begins an animation of exactly `frames` pictures of one size and format, each shown for `delay_ms`, with texts
    /// as in [`encode_png`](crate::encode_png).
    ///
    /// # Errors
    /// If a keyword is not 1 to 79 printable Latin-1 characters.
    pub fn begin(
        size: FrameSize,
        format: PixelFormat,
        frames: NonZeroU32,
        delay_ms: u16,
        texts: &[(&str, String)],
    ) -> Result<Self, RenderError> {
        let failed = |_: png::EncodingError| RenderError::PngEncoding;
        let bytes = Shared::default();
        let mut encoder = png::Encoder::new(bytes.clone(), size.width(), size.height());
        encoder.set_color(color_type(format));
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::Fast);
        encoder.set_animated(frames.get(), 0).map_err(failed)?;
        encoder.set_frame_delay(delay_ms, 1000).map_err(failed)?;
        add_text(&mut encoder, "Disclaimer", RESEARCH_USE_NOTICE)?;
        for (keyword, value) in texts {
            add_text(&mut encoder, keyword, value)?;
        }
        let writer = encoder.write_header().map_err(failed)?;
        Ok(Self {
            writer,
            bytes,
            missing: frames.get(),
        })
    }

    /// Adds the next picture.
    ///
    /// # Errors
    /// If its size or format differs from the animation, or if there is one too many.
    pub fn add(&mut self, frame: &Frame) -> Result<(), RenderError> {
        self.missing = self
            .missing
            .checked_sub(1)
            .ok_or(RenderError::PngEncoding)?;
        let written = self.writer.write_image_data(frame.bytes());
        written.map_err(|_| RenderError::PngEncoding)
    }

    /// The file.
    ///
    /// # Errors
    /// If pictures are missing.
    pub fn finish(self) -> Result<Vec<u8>, RenderError> {
        if self.missing > 0 {
            return Err(RenderError::PngEncoding);
        }
        self.writer.finish().map_err(|_| RenderError::PngEncoding)?;
        Ok(std::mem::take(&mut *self.bytes.lock()))
    }
}

/// The file so far, shared with the encoder, which does not return its writer.
#[derive(Debug, Clone, Default)]
struct Shared(Arc<Mutex<Vec<u8>>>);

impl Shared {
    /// No code panics while the lock is held, so a poisoned lock is sound.
    fn lock(&self) -> std::sync::MutexGuard<'_, Vec<u8>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Write for Shared {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.lock().write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn animation(frames: u32) -> AnimatedPng {
        let size = FrameSize::new(3, 2).unwrap();
        let frames = NonZeroU32::new(frames).unwrap();
        AnimatedPng::begin(
            size,
            PixelFormat::Grey8,
            frames,
            80,
            &[("Case", "a".to_owned())],
        )
        .unwrap()
    }

    fn grey(value: u8) -> Frame {
        Frame::new(
            FrameSize::new(3, 2).unwrap(),
            PixelFormat::Grey8,
            vec![value; 6],
        )
    }

    #[test]
    fn every_picture_comes_back() {
        let mut animation = animation(3);
        for value in [10, 20, 30] {
            animation.add(&grey(value)).unwrap();
        }
        let bytes = animation.finish().unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes))
            .read_info()
            .unwrap();
        assert_eq!(reader.info().animation_control.unwrap().num_frames, 3);
        let mut pixels = vec![0; 6];
        for value in [10, 20, 30] {
            reader.next_frame(&mut pixels).unwrap();
            assert_eq!(pixels, [value; 6]);
        }
    }

    #[test]
    fn as_many_pictures_as_were_announced() {
        let mut short = animation(2);
        short.add(&grey(1)).unwrap();
        assert!(short.finish().is_err());
        let mut long = animation(1);
        long.add(&grey(1)).unwrap();
        assert!(long.add(&grey(2)).is_err());
    }
}
