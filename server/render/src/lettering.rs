//! Text as coverage of pixels, in an outline font.

use std::sync::LazyLock;

use ab_glyph::{Font as _, FontRef, Glyph, PxScaleFont, ScaleFont as _, point};

/// DejaVu Sans Bold, its printable Latin-1; its licence is in `fonts/LICENSE.txt`.
const FONT: &[u8] = include_bytes!("../fonts/DejaVuSans-Bold-subset.ttf");

static LETTERS: LazyLock<FontRef<'static>> =
    LazyLock::new(|| FontRef::try_from_slice(FONT).expect("a sound font, which a test reads"));

/// The smaller side of a picture divided by the height of a line.
const LINES_IN_A_SIDE: f32 = 30.0;

/// The smallest legible height of a line and the greatest, in pixels.
const LINE_HEIGHTS: [f32; 2] = [12.0, 128.0];

/// The font at the size that suits a picture.
///
/// Outlines are filled without the hinting of a system's font engine, so letters have the same pixels on every machine.
#[derive(Debug, Clone)]
pub(crate) struct Lettering {
    font: PxScaleFont<&'static FontRef<'static>>,
}

/// The coverage of each pixel of a block by text, row by row, 0 to 1.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Coverage {
    pub(crate) size: [usize; 2],
    pub(crate) shares: Vec<f32>,
}

impl Lettering {
    /// Letters for a picture whose smaller side is `side` pixels.
    pub(crate) fn for_side(side: u32) -> Self {
        let [least, most] = LINE_HEIGHTS;
        let height = (side as f32 / LINES_IN_A_SIDE).clamp(least, most);
        Self {
            font: LETTERS.as_scaled(height.round()),
        }
    }

    /// Pixels from one line to the next.
    pub(crate) fn line_height(&self) -> u32 {
        self.font.height().ceil() as u32
    }

    /// Pixels of a line of text.
    pub(crate) fn width(&self, text: &str) -> u32 {
        let advance = |letter| self.font.h_advance(self.font.glyph_id(letter));
        text.chars().map(advance).sum::<f32>().ceil() as u32
    }

    /// A line of text, in a block of its width and a line's height.
    pub(crate) fn coverage(&self, text: &str) -> Coverage {
        let [width, height] = [self.width(text), self.line_height()].map(|side| side as usize);
        let mut shares = vec![0.0_f32; width * height];
        for glyph in self.glyphs(text) {
            let Some(outline) = self.font.outline_glyph(glyph) else {
                continue;
            };
            let [left, top] = [outline.px_bounds().min.x, outline.px_bounds().min.y];
            outline.draw(|x, y, share| {
                let [x, y] = [left as i64 + i64::from(x), top as i64 + i64::from(y)];
                let inside = (0..width as i64).contains(&x) && (0..height as i64).contains(&y);
                if inside {
                    let pixel = &mut shares[y as usize * width + x as usize];
                    *pixel = (*pixel + share).min(1.0);
                }
            });
        }
        Coverage {
            size: [width, height],
            shares,
        }
    }

    fn glyphs(&self, text: &str) -> Vec<Glyph> {
        let mut x = 0.0;
        let place = |letter| {
            let mut glyph = self.font.scaled_glyph(letter);
            glyph.position = point(x, self.font.ascent());
            x += self.font.h_advance(glyph.id);
            glyph
        };
        text.chars().map(place).collect()
    }
}

impl Coverage {
    /// The greatest share within `radius` pixels of each pixel, in a block larger by that on every side.
    pub(crate) fn spread(&self, radius: usize) -> Self {
        let [width, height] = self.size;
        let size = [width + 2 * radius, height + 2 * radius];
        let mut shares = vec![0.0_f32; size[0] * size[1]];
        let within =
            (0..=2 * radius).flat_map(|down| (0..=2 * radius).map(move |right| [right, down]));
        for [right, down] in within {
            for y in 0..height {
                for x in 0..width {
                    let pixel = &mut shares[(y + down) * size[0] + x + right];
                    *pixel = pixel.max(self.shares[y * width + x]);
                }
            }
        }
        Self { size, shares }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_printable_letter_of_latin_1_is_drawn() {
        let lettering = Lettering::for_side(512);
        let unknown = LETTERS.glyph_id('\u{1f9e0}');
        for letter in ('!'..='~').chain('¡'..='¬').chain('®'..='ÿ').chain(['−']) {
            assert_ne!(LETTERS.glyph_id(letter), unknown, "{letter}");
            let coverage = lettering.coverage(&letter.to_string());
            let ink: f32 = coverage.shares.iter().sum();
            assert!(ink > 2.0, "{letter} has {ink} pixels of ink");
        }
        assert!(
            lettering
                .coverage(" ")
                .shares
                .iter()
                .all(|&share| share == 0.0)
        );
        assert!(lettering.coverage("").shares.is_empty());
    }

    #[test]
    fn letters_grow_with_the_picture_and_no_farther_than_can_be_read() {
        let heights = [1, 128, 512, 1024, 4096].map(|side| Lettering::for_side(side).line_height());
        assert!(heights.is_sorted() && heights[0] >= 12 && heights[0] == heights[1]);
        assert!(heights[3] > 30 && heights[4] <= 160, "{heights:?}");
    }

    #[test]
    fn a_rim_reaches_as_far_as_its_radius() {
        let dot = Coverage {
            size: [1, 1],
            shares: vec![0.5],
        };
        let spread = dot.spread(2);
        assert_eq!((spread.size, spread.shares), ([5, 5], vec![0.5; 25]));
    }
}
