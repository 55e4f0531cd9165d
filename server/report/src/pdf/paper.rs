//! Pages: what is drawn on them, in mm from their upper left corner, and the file that they become.

use std::collections::BTreeMap;

use pdf_writer::types::{LineCapStyle, LineJoinStyle, Predictor, TextRenderingMode};
use pdf_writer::{Content, Filter, Finish as _, Name, Pdf, Rect, Ref, Str, TextStr};

use super::deflate::deflated;
use super::typeface::{self, Letter, Text, glyph};
use crate::Error;
use crate::contents::Picture;
use crate::pictures::{BAR, PolyLine, Shot};

/// A page as wide as A4 and nearly as high as Letter, so that both hold all of it at its size.
pub(crate) const PAGE_MM: [f64; 2] = [210.0, 279.0];

/// Points in a mm.
const POINTS: f64 = 72.0 / 25.4;

/// A point as mm.
pub(crate) const PT: f64 = 25.4 / 72.0;

const FONT: Name<'_> = Name(b"F");

/// The stroke of a strong letter, as a part of its height.
const STRONG: f64 = 0.03;

/// A colour, red, green and blue, 0 to 1.
pub(crate) type Colour = [f32; 3];

pub(crate) const BLACK: Colour = [0.067; 3];
pub(crate) const RED: Colour = [0.64, 0.0, 0.0];
pub(crate) const GREY: Colour = [0.8; 3];
const HALO: Colour = [0.0; 3];
const MARK: Colour = [1.0, 0.69, 0.0];
const LETTERS: Colour = [1.0, 0.824, 0.478];
const WHITE: Colour = [1.0; 3];

/// The widths of a mark, of a bar and of a letter's border in a picture, in its pixels.
const MARK_WIDTH: f32 = 2.0;
const HALO_WIDTH: f32 = 4.0;
const BAR_WIDTH: f32 = 3.0;
const BORDER_WIDTH: f32 = 3.0;

/// A page in the making.
pub(crate) struct Page {
    content: Content,
    /// Whether numbers stand for characters that the font lacks.
    pub(crate) lacks: bool,
}

/// All pages, and what they share.
pub(crate) struct Paper<'a> {
    pub(crate) pages: Vec<Page>,
    shots: Vec<&'a Shot>,
    /// The glyphs that are used, with their characters.
    used: BTreeMap<u16, char>,
}

/// What a file says about itself.
pub(crate) struct About<'a> {
    pub(crate) title: &'a str,
    pub(crate) language: &'a str,
}

impl<'a> Paper<'a> {
    pub(crate) fn new() -> Self {
        Self {
            pages: Vec::new(),
            shots: Vec::new(),
            used: BTreeMap::new(),
        }
    }

    pub(crate) fn add_page(&mut self) {
        let mut content = Content::new();
        let scale = POINTS as f32;
        let height = (PAGE_MM[1] * POINTS) as f32;
        content.transform([scale, 0.0, 0.0, -scale, 0.0, height]);
        content.set_line_join(LineJoinStyle::RoundJoin);
        self.pages.push(Page {
            content,
            lacks: false,
        });
    }

    /// Draws a line of text on a page, from the left end of its base line on.
    pub(crate) fn text(
        &mut self,
        page: usize,
        text: &Text,
        [x, y]: [f64; 2],
        size: f64,
        colour: Colour,
    ) {
        let mut x = x;
        self.pages[page].lacks |= text.lacks;
        let runs = text
            .letters
            .chunk_by(|one, next| one.is_strong == next.is_strong);
        for run in runs {
            let bytes = self.encoded(run);
            let content = &mut self.pages[page].content;
            let [red, green, blue] = colour;
            content.set_fill_rgb(red, green, blue);
            let is_strong = run[0].is_strong;
            if is_strong {
                content.set_stroke_rgb(red, green, blue);
                content.set_line_width(rounded(STRONG * size));
            }
            let mode = match is_strong {
                true => TextRenderingMode::FillStroke,
                false => TextRenderingMode::Fill,
            };
            show(content, &bytes, [x, y], size, mode);
            let run = Text {
                letters: run.to_vec(),
                lacks: false,
            };
            x += run.width(size);
        }
    }

    /// The numbers of the glyphs of letters.
    fn encoded(&mut self, letters: &[Letter]) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(2 * letters.len());
        for letter in letters {
            let glyph = glyph(letter.character);
            self.used.entry(glyph).or_insert(letter.character);
            bytes.extend(glyph.to_be_bytes());
        }
        bytes
    }

    /// Draws a horizontal line.
    pub(crate) fn rule(&mut self, page: usize, [x, y]: [f64; 2], width: f64, colour: Colour) {
        let content = &mut self.pages[page].content;
        let [red, green, blue] = colour;
        content.set_stroke_rgb(red, green, blue);
        content.set_line_width(0.2);
        content.move_to(rounded(x), rounded(y));
        content.line_to(rounded(x + width), rounded(y)).stroke();
    }

    /// Draws the border of a box.
    pub(crate) fn frame(&mut self, page: usize, [x, y]: [f64; 2], [width, height]: [f64; 2]) {
        let content = &mut self.pages[page].content;
        let [red, green, blue] = RED;
        content.set_stroke_rgb(red, green, blue);
        content.set_line_width(0.5);
        content.rect(rounded(x), rounded(y), rounded(width), rounded(height));
        content.stroke();
    }

    /// Draws a picture with its marks and letters into a square.
    pub(crate) fn picture(
        &mut self,
        page: usize,
        picture: &Picture<'a>,
        [x, y]: [f64; 2],
        width: f64,
    ) {
        let shot = picture.shot;
        let known = self.shots.iter().position(|one| std::ptr::eq(*one, shot));
        let number = known.unwrap_or_else(|| {
            self.shots.push(shot);
            self.shots.len() - 1
        });
        let name = format!("I{number}");
        let size = shot.letter_size();
        let directions = shot.directions.iter().zip(shot.letter_places());
        let directions = directions.map(|(letters, [x, y])| {
            let text = Text::strong(letters);
            // The middle of a capital is in the middle of its place.
            let at = [x - text.width(size) / 2.0, y + 0.365 * size];
            (text, at, size, LETTERS)
        });
        let name_of_bar = shot.bar_name();
        let name_of_bar = name_of_bar.map(|(at, size)| (Text::strong(BAR), at, size, WHITE));
        let letters = directions.chain(name_of_bar);
        let letters = letters.map(|(text, at, size, colour)| {
            let glyphs = self.encoded(&text.letters);
            (glyphs, at, size, colour)
        });
        let letters: Vec<_> = letters.collect();
        let content = &mut self.pages[page].content;
        let side = shot.side as f32;
        let scale = rounded(width / f64::from(shot.side));
        content.save_state();
        content.transform([scale, 0.0, 0.0, scale, rounded(x), rounded(y)]);
        content.rect(0.0, 0.0, side, side).clip_nonzero().end_path();
        content.save_state();
        content.transform(match shot.is_flipped {
            true => [-side, 0.0, 0.0, -side, side, side],
            false => [side, 0.0, 0.0, -side, 0.0, side],
        });
        content.x_object(Name(name.as_bytes())).restore_state();
        content.set_line_cap(LineCapStyle::ButtCap);
        let bar = shot.bar().map(|points| PolyLine {
            points: points.to_vec(),
            is_closed: false,
        });
        let marks = shot.lines();
        for (colour, width, lines) in [
            (HALO, HALO_WIDTH, &marks[..]),
            (MARK, MARK_WIDTH, &marks[..]),
            (WHITE, BAR_WIDTH, bar.as_slice()),
        ] {
            let [red, green, blue] = colour;
            content.set_stroke_rgb(red, green, blue);
            content.set_line_width(width);
            for line in lines {
                trace(content, line);
            }
        }
        for (letters, at, size, [red, green, blue]) in letters {
            content.set_fill_rgb(red, green, blue);
            content.set_stroke_rgb(HALO[0], HALO[1], HALO[2]);
            content.set_line_width(BORDER_WIDTH);
            show(content, &letters, at, size, TextRenderingMode::Stroke);
            content.set_stroke_rgb(red, green, blue);
            content.set_line_width(rounded(STRONG * size));
            show(content, &letters, at, size, TextRenderingMode::FillStroke);
        }
        content.restore_state();
    }

    /// The file. The same pages give the same bytes.
    ///
    /// # Errors
    /// If a picture is not an opaque PNG of 8 bits without interlacing.
    pub(crate) fn file(self, about: &About<'_>) -> Result<Vec<u8>, Error> {
        let Self { pages, shots, used } = self;
        let mut numbers = (1..).map(Ref::new);
        let mut next = || numbers.next().expect("there is no last number");
        let [catalog, tree, info] = [(); 3].map(|()| next());
        let fonts = [(); 5].map(|()| next());
        let page_refs: Vec<_> = pages.iter().map(|_| [next(), next()]).collect();
        let image_refs: Vec<_> = shots.iter().map(|_| next()).collect();
        let mut pdf = Pdf::new();
        pdf.set_version(1, 7);
        let mut root = pdf.catalog(catalog);
        root.pages(tree).lang(TextStr(about.language));
        root.viewer_preferences().display_doc_title(true);
        root.finish();
        let mut information = pdf.document_info(info);
        information.title(TextStr(about.title));
        let producer = format!("Isocortex {}", env!("CARGO_PKG_VERSION"));
        information
            .creator(TextStr(&producer))
            .producer(TextStr(&producer));
        information.subject(TextStr(render::RESEARCH_USE_NOTICE));
        information.finish();
        let [width, height] = PAGE_MM.map(|mm| rounded(mm * POINTS));
        let mut all = pdf.pages(tree);
        all.kids(page_refs.iter().map(|[page, _]| *page));
        all.count(page_refs.len() as i32);
        all.media_box(Rect::new(0.0, 0.0, width, height));
        let mut resources = all.resources();
        resources.fonts().pair(FONT, fonts[0]);
        let mut images = resources.x_objects();
        for (at, image) in image_refs.iter().enumerate() {
            images.pair(Name(format!("I{at}").as_bytes()), *image);
        }
        images.finish();
        resources.finish();
        all.finish();
        for ([page, content], made) in page_refs.iter().zip(pages) {
            pdf.page(*page).parent(tree).contents(*content);
            let bytes = deflated(made.content.finish().as_slice());
            pdf.stream(*content, &bytes).filter(Filter::FlateDecode);
        }
        typeface::embed(&mut pdf, fonts, used);
        for (reference, shot) in image_refs.into_iter().zip(shots) {
            embed(&mut pdf, reference, shot)?;
        }
        Ok(pdf.finish())
    }
}

/// Shows glyphs. Text stands upright although the heights of a page grow downwards.
fn show(
    content: &mut Content,
    glyphs: &[u8],
    [x, y]: [f64; 2],
    size: f64,
    mode: TextRenderingMode,
) {
    content.begin_text().set_font(FONT, rounded(size));
    content.set_text_rendering_mode(mode);
    content.set_text_matrix([1.0, 0.0, 0.0, -1.0, rounded(x), rounded(y)]);
    content.show(Str(glyphs)).end_text();
}

fn trace(content: &mut Content, line: &PolyLine) {
    for (at, &[x, y]) in line.points.iter().enumerate() {
        match at {
            0 => content.move_to(rounded(x), rounded(y)),
            _ => content.line_to(rounded(x), rounded(y)),
        };
    }
    match line.is_closed {
        true => content.close_and_stroke(),
        false => content.stroke(),
    };
}

/// Puts a picture into a file. The compressed pixels of a PNG are those of a PDF: nothing is decoded, and nothing lost.
fn embed(pdf: &mut Pdf, reference: Ref, shot: &Shot) -> Result<(), Error> {
    let png = Png::read(&shot.png).ok_or(Error::Picture)?;
    let [width, height] = png.size.map(|side| side as i32);
    let mut image = pdf.image_xobject(reference, &png.pixels);
    image.width(width).height(height).bits_per_component(8);
    match png.channels {
        1 => image.color_space().device_gray(),
        _ => image.color_space().device_rgb(),
    }
    image.filter(Filter::FlateDecode);
    let mut parameters = image.decode_parms();
    parameters.predictor(Predictor::PngOptimum);
    parameters.colors(png.channels).bits_per_component(8);
    parameters.columns(width);
    Ok(())
}

/// What a PDF needs of a PNG.
struct Png {
    size: [u32; 2],
    channels: i32,
    /// Filtered and compressed.
    pixels: Vec<u8>,
}

impl Png {
    /// Reads an opaque PNG of 8 bits without interlacing; `None` for any other.
    fn read(file: &[u8]) -> Option<Self> {
        let mut rest = file.strip_prefix(b"\x89PNG\r\n\x1a\n")?;
        let (mut size, mut channels, mut pixels) = ([0; 2], 0, Vec::new());
        loop {
            let (length, after) = rest.split_first_chunk()?;
            let (kind, after) = after.split_first_chunk::<4>()?;
            let (data, after) = after.split_at_checked(u32::from_be_bytes(*length) as usize)?;
            rest = after.get(4..)?;
            match kind {
                b"IHDR" => {
                    let (width, after) = data.split_first_chunk()?;
                    let (height, after) = after.split_first_chunk()?;
                    size = [width, height].map(|side| u32::from_be_bytes(*side));
                    // Depth, kind of colours, compression, filters, interlacing.
                    channels = match after {
                        [8, 0, 0, 0, 0] => 1,
                        [8, 2, 0, 0, 0] => 3,
                        _ => return None,
                    };
                }
                b"IDAT" => pixels.extend_from_slice(data),
                b"IEND" => break,
                _ => {}
            }
        }
        (channels > 0).then_some(Self {
            size,
            channels,
            pixels,
        })
    }
}

/// A number with three digits after the point, which no eye tells from the whole one.
fn rounded(value: f64) -> f32 {
    ((value * 1000.0).round() / 1000.0) as f32
}
