//! The font of the file.

use std::sync::LazyLock;

use ab_glyph::{Font as _, FontRef};
use pdf_writer::types::{CidFontType, FontFlags, SystemInfo, UnicodeCmap};
use pdf_writer::{Filter, Finish as _, Name, Pdf, Rect, Ref, Str};

use super::deflate::deflated;
use crate::contents::{Line, Piece};

/// DejaVu Sans Condensed, its Latin, Greek and Cyrillic; its licence is in `fonts/LICENSE.txt`.
const FONT: &[u8] = include_bytes!("../fonts/DejaVuSansCondensed-subset.ttf");

static FACE: LazyLock<FontRef<'static>> =
    LazyLock::new(|| FontRef::try_from_slice(FONT).expect("a sound font, which a test reads"));

/// Six letters and a sign mark the name of a subset (ISO 32000-1, 9.6.4).
const NAME: Name<'_> = Name(b"ISOCTX+DejaVuSansCondensed");

/// The extents of the font in thousandths of its height, from its tables.
const BOX: [f32; 4] = [-918.0, -463.0, 1614.0, 1232.0];
const ASCENT: f32 = 928.0;
const DESCENT: f32 = -236.0;
const CAPITALS: f32 = 729.0;

const IDENTITY: SystemInfo<'_> = SystemInfo {
    registry: Str(b"Adobe"),
    ordering: Str(b"Identity"),
    supplement: 0,
};

/// A character, and whether it is strong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Letter {
    pub(crate) character: char,
    pub(crate) is_strong: bool,
}

/// A text that has a glyph for each of its characters.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Text {
    pub(crate) letters: Vec<Letter>,
    /// Whether numbers stand for characters that the font lacks.
    pub(crate) lacks: bool,
}

impl Text {
    pub(crate) fn plain(text: &str) -> Self {
        Self::default().with(text, false)
    }

    pub(crate) fn strong(text: &str) -> Self {
        Self::default().with(text, true)
    }

    pub(crate) fn of(line: &Line, is_strong: bool) -> Self {
        let add = |text: Self, piece: &Piece| {
            text.with(piece.text(), is_strong || matches!(piece, Piece::Strong(_)))
        };
        line.0.iter().fold(Self::default(), add)
    }

    /// Adds a text. A character without a glyph becomes its number, so that nothing is lost without a trace.
    fn with(mut self, text: &str, is_strong: bool) -> Self {
        for character in text.chars() {
            let letter = |character| Letter {
                character,
                is_strong,
            };
            match character {
                '\r' => {}
                '\n' => self.letters.push(letter('\n')),
                '\t' => self.letters.push(letter(' ')),
                known if glyph(known) != 0 => self.letters.push(letter(known)),
                unknown => {
                    let number = format!("‹U+{:04X}›", u32::from(unknown));
                    self.letters.extend(number.chars().map(letter));
                    self.lacks = true;
                }
            }
        }
        self
    }

    /// Its width if letters are `size` high.
    pub(crate) fn width(&self, size: f64) -> f64 {
        width_of(&self.letters, size)
    }

    /// Its lines, none wider than `width`. They end at spaces, but within words that are too long for a line.
    pub(crate) fn wrapped(&self, size: f64, width: f64) -> Vec<Self> {
        let mut lines = Vec::new();
        for paragraph in self.letters.split(|letter| letter.character == '\n') {
            let mut rest = paragraph;
            loop {
                let (line, after) = rest.split_at(line_end(rest, size, width));
                let end = line.iter().rposition(|letter| letter.character != ' ');
                lines.push(Self {
                    letters: line[..end.map_or(0, |last| last + 1)].to_vec(),
                    lacks: self.lacks,
                });
                rest = after;
                if rest.is_empty() {
                    break;
                }
            }
        }
        lines
    }

    /// Its beginning, with an ellipsis if it is wider than `width`.
    pub(crate) fn cut(mut self, size: f64, width: f64) -> Self {
        if self.width(size) <= width {
            return self;
        }
        let ellipsis = Self::plain("…");
        while !self.letters.is_empty() && self.width(size) + ellipsis.width(size) > width {
            self.letters.pop();
        }
        self.letters.extend(ellipsis.letters);
        self
    }
}

/// Where the first line of a paragraph ends.
fn line_end(letters: &[Letter], size: f64, width: f64) -> usize {
    let mut x = 0.0;
    let mut after_space = None;
    for (at, letter) in letters.iter().enumerate() {
        x += width_of(std::slice::from_ref(letter), size);
        if letter.character == ' ' {
            after_space = Some(at + 1);
        } else if x > width && at > 0 {
            return after_space.unwrap_or(at);
        }
    }
    letters.len()
}

fn width_of(letters: &[Letter], size: f64) -> f64 {
    let thousandths = letters
        .iter()
        .map(|letter| advance(glyph(letter.character)));
    f64::from(thousandths.sum::<f32>()) / 1000.0 * size
}

/// The number of a character's glyph; 0 if there is none.
pub(crate) fn glyph(character: char) -> u16 {
    FACE.glyph_id(character).0
}

/// In thousandths of the height of a letter.
fn advance(glyph: u16) -> f32 {
    let units = FACE.units_per_em().unwrap_or(1000.0);
    (FACE.h_advance_unscaled(ab_glyph::GlyphId(glyph)) * 1000.0 / units).round()
}

/// Puts the font into a file, with the meaning of the glyphs that were used.
pub(crate) fn embed(
    pdf: &mut Pdf,
    [font, cid_font, descriptor, file, meaning]: [Ref; 5],
    used: impl IntoIterator<Item = (u16, char)>,
) {
    let mut map = UnicodeCmap::new(Name(b"Isocortex"), IDENTITY);
    let mut type_0 = pdf.type0_font(font);
    type_0.base_font(NAME);
    type_0.encoding_predefined(Name(b"Identity-H"));
    type_0.descendant_font(cid_font).to_unicode(meaning);
    type_0.finish();
    let mut cid = pdf.cid_font(cid_font);
    cid.subtype(CidFontType::Type2);
    cid.base_font(NAME).system_info(IDENTITY);
    cid.font_descriptor(descriptor).default_width(0.0);
    cid.cid_to_gid_map_predefined(Name(b"Identity"));
    let mut widths = cid.widths();
    for (glyph, character) in used {
        widths.consecutive(glyph, [advance(glyph)]);
        map.pair(glyph, character);
    }
    widths.finish();
    cid.finish();
    let mut about = pdf.font_descriptor(descriptor);
    about.name(NAME).flags(FontFlags::NON_SYMBOLIC);
    about.bbox(Rect::new(BOX[0], BOX[1], BOX[2], BOX[3]));
    about.italic_angle(0.0).stem_v(80.0);
    about.ascent(ASCENT).descent(DESCENT).cap_height(CAPITALS);
    about.font_file2(file);
    about.finish();
    pdf.stream(file, &deflated(FONT))
        .filter(Filter::FlateDecode)
        .pair(Name(b"Length1"), FONT.len() as i32);
    let map = map.finish();
    pdf.cmap(meaning, &deflated(map.as_slice()))
        .filter(Filter::FlateDecode);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &Text) -> String {
        text.letters.iter().map(|letter| letter.character).collect()
    }

    #[test]
    fn what_the_font_lacks_is_written_as_its_number() {
        let known = Text::plain("Ångström, ação, Łódź, Ελλάδα, Кора, ≥ 6 mm³ – “½” → 5 µm");
        assert!(!known.lacks);
        for (text, expected) in [
            ("灰質?", "‹U+7070›‹U+8CEA›?"),
            ("a\u{202e}b", "a‹U+202E›b"),
            ("🧠\tx\u{0}", "‹U+1F9E0› x‹U+0000›"),
        ] {
            let text = Text::plain(text);
            assert!(text.lacks);
            assert_eq!(read(&text), expected);
        }
    }

    #[test]
    fn lines_fit_and_lose_nothing_but_the_spaces_at_their_ends() {
        let long = "word ".repeat(40) + &"x".repeat(200) + "\n\nend";
        let text = Text::plain(&long);
        let lines = text.wrapped(3.0, 50.0);
        assert!(lines.iter().all(|line| line.width(3.0) <= 50.0));
        let letters = |text: &str| text.replace([' ', '\n'], "");
        let all: String = lines.iter().map(read).collect();
        assert_eq!(letters(&all), letters(&long));
        assert_eq!(read(&lines[0]).len() % 5, 4, "whole words");
        assert_eq!(lines[lines.len() - 2].letters, []);
        assert_eq!(read(&lines[lines.len() - 1]), "end");
    }

    #[test]
    fn a_text_that_is_cut_fits_and_says_so() {
        let cut = Text::plain(&"name ".repeat(50)).cut(3.0, 40.0);
        assert!(cut.width(3.0) <= 40.0 && read(&cut).ends_with('…'));
        assert_eq!(read(&Text::plain("name").cut(3.0, 40.0)), "name");
    }
}
