//! The report as PDF: its contents laid out on pages that A4 and Letter hold, without a browser.
//!
//! Pictures keep their compressed pixels, marks and letters are drawn over them, and the same report gives the same bytes.
//!
//! `krilla` was tried in place of `pdf-writer` and this module's files: it is as deterministic and embeds 27 kB less of the font, but it
//! compresses pixels again without the filters of PNG (43 kB for a slice of 29 kB) and brings 16 more crates; the layout stays ours.

mod deflate;
mod paper;
mod typeface;

use self::paper::{About, BLACK, GREY, PAGE_MM, PT, Paper, RED};
use self::typeface::Text;
use crate::Error;
use crate::contents::{
    Block, Contents, Facts, GAP_MM, KEY_MM, Line, Overview, Picture, Section, SectionKind, Table,
};

/// The margins to the left and right, and above and below the text, in mm.
const MARGIN_MM: f64 = 12.0;
const HEAD_MM: f64 = 16.0;
const FOOT_MM: f64 = 17.0;

/// The width of the text, in mm.
const WIDTH_MM: f64 = PAGE_MM[0] - 2.0 * MARGIN_MM;

/// Where the text of a page ends, in mm from its upper edge.
const END_MM: f64 = PAGE_MM[1] - FOOT_MM;

/// Heights of letters, in mm.
const TITLE: f64 = 16.0 * PT;
const LARGE: f64 = 14.0 * PT;
const CAPTION: f64 = 7.0 * PT;
const EDGE: f64 = 7.5 * PT;

/// Heights of the letters that are smaller in the appendix, in mm.
struct Sizes {
    heading: f64,
    subheading: f64,
    body: f64,
    cell: f64,
    /// Above and below the letters of a table.
    around: f64,
}

const USUAL: Sizes = Sizes {
    heading: 12.5 * PT,
    subheading: 10.5 * PT,
    body: 9.5 * PT,
    cell: 8.5 * PT,
    around: 0.5,
};

const SMALL: Sizes = Sizes {
    heading: 11.0 * PT,
    subheading: 9.0 * PT,
    body: 8.0 * PT,
    cell: 7.5 * PT,
    around: 0.2,
};

/// From one line to the next, as a part of the height of letters; and from its upper edge to its base line.
const LEADING: f64 = 1.32;
const BASE: f64 = 0.98;

/// What must fit below a heading, in mm.
const BELOW_HEADING_MM: f64 = 25.0;

/// The side of a picture of an overview, and what separates two, in mm.
const SMALL_PICTURE_MM: f64 = 23.0;
const SMALL_GAP_MM: f64 = 1.0;

/// What separates two columns of a table, in mm.
const COLUMN_GAP_MM: f64 = 3.5;

/// What separates pictures from what stands beside them, and two lines to write on, in mm.
const BESIDE_GAP_MM: f64 = 5.0;

/// The width of the names of an overview's rows, in mm.
const ROW_NAME_MM: f64 = WIDTH_MM - 6.0 * (SMALL_PICTURE_MM + SMALL_GAP_MM);

impl Contents<'_> {
    /// The report as PDF.
    ///
    /// # Errors
    /// [`Error::Picture`] if a picture is not as the renderers write them.
    pub(crate) fn pdf(&self) -> Result<Vec<u8>, Error> {
        let mut layout = Layout {
            paper: Paper::new(),
            y: 0.0,
            key_end: 0.0,
            of: Text::default(),
            sizes: &USUAL,
        };
        for section in &self.sections {
            layout.sizes = match section.kind {
                SectionKind::Appendix => &SMALL,
                SectionKind::Front | SectionKind::Finding => &USUAL,
            };
            layout.of = section.name();
            layout.begin_page();
            for block in &section.blocks {
                layout.block(block);
            }
        }
        self.edges(&mut layout.paper);
        layout.paper.file(&About {
            title: &format!("{} · {}", self.title, self.identity),
            language: self.language,
        })
    }

    /// What every page states: the case, the verdict on a doubtful mask, the use, and its number.
    fn edges(&self, paper: &mut Paper<'_>) {
        let count = paper.pages.len();
        let right = PAGE_MM[0] - MARGIN_MM;
        let doubt = Text::strong(self.doubt.as_deref().unwrap_or_default());
        let notice = Text::strong(self.notice);
        let identity = format!("Isocortex · {}", self.identity);
        let identity = Text::plain(&identity).cut(EDGE, WIDTH_MM);
        // Where both have no room beside each other, the doubt stands below.
        let is_beside = identity.width(EDGE) + COLUMN_GAP_MM + doubt.width(EDGE) <= WIDTH_MM;
        let doubts = doubt.wrapped(EDGE, WIDTH_MM);
        let unprintable = Text::plain(self.unprintable);
        for page in 0..count {
            let [mut head, foot] = [if is_beside { 10.0 } else { 6.0 }, PAGE_MM[1] - 8.5];
            paper.text(page, &identity, [MARGIN_MM, head], EDGE, BLACK);
            for line in &doubts {
                head += if is_beside { 0.0 } else { LEADING * EDGE };
                let at = [right - line.width(EDGE), head];
                paper.text(page, line, at, EDGE, RED);
            }
            paper.text(page, &notice, [MARGIN_MM, foot], EDGE, BLACK);
            let number = Text::plain(&format!("{} / {count}", page + 1));
            let at = [right - number.width(EDGE), foot];
            paper.text(page, &number, at, EDGE, BLACK);
            if paper.pages[page].lacks {
                let at = [MARGIN_MM, foot - LEADING * CAPTION];
                paper.text(page, &unprintable, at, CAPTION, BLACK);
            }
        }
    }
}

impl Section<'_> {
    /// The heading of a finding; of all others, nothing.
    fn name(&self) -> Text {
        match self.blocks.first() {
            Some(Block::Heading(text)) if self.kind == SectionKind::Finding => {
                Text::of(text, true).cut(USUAL.body, WIDTH_MM)
            }
            _ => Text::default(),
        }
    }
}

/// Pages, and where the next block begins on the last one.
struct Layout<'a> {
    paper: Paper<'a>,
    y: f64,
    /// Where the picture at the right of the page ends; at its head, if there is none.
    key_end: f64,
    /// The finding that is laid out.
    of: Text,
    sizes: &'static Sizes,
}

impl<'a> Layout<'a> {
    fn begin_page(&mut self) {
        self.paper.add_page();
        (self.y, self.key_end) = (HEAD_MM, HEAD_MM);
    }

    fn page(&self) -> usize {
        self.paper.pages.len() - 1
    }

    /// Begins a page unless so much fits on this one. The pictures of a finding may go on there, so that it states which one it is.
    fn need(&mut self, height: f64) {
        if self.y + height > END_MM && self.y > HEAD_MM {
            self.begin_page();
            let name = std::mem::take(&mut self.of);
            if !name.letters.is_empty() {
                self.draw(&name, [MARGIN_MM, self.y], self.sizes.body);
                self.y += LEADING * self.sizes.body + 1.5;
            }
            self.of = name;
        }
    }

    /// Leaves a space, but not at the head of a page.
    fn space(&mut self, height: f64) {
        if self.y > HEAD_MM {
            self.y += height;
        }
    }

    fn block(&mut self, block: &Block<'a>) {
        let Sizes {
            heading,
            subheading,
            body,
            ..
        } = *self.sizes;
        match block {
            Block::Title(title) => self.lines(&Text::strong(title), TITLE, 1.0),
            Block::Notice(notice) => self.lines(&Text::strong(notice), body, 2.0),
            Block::Warning(doubt, reasons) => self.warning(doubt, reasons),
            Block::KeyPicture(picture) => self.key_picture(picture),
            Block::Heading(text) => self.heading(&Text::of(text, true), heading, 4.0),
            Block::Subheading(text) => self.heading(&Text::of(text, true), subheading, 2.0),
            Block::Large(text) => self.lines(&Text::of(text, false), LARGE, 2.0),
            Block::Text(text) => self.lines(&Text::of(text, false), body, 1.5),
            Block::List(lines) => {
                for line in lines {
                    self.item(line);
                }
            }
            Block::Facts(facts) => {
                for row in &named(facts, WIDTH_MM, body).rows {
                    self.need(row.height);
                    self.row(row, MARGIN_MM);
                }
                self.y += 1.5;
            }
            Block::Table(table) => self.table(table),
            Block::Pictures(side_mm, rows) => self.pictures(*side_mm, rows, &[]),
            Block::PicturesAndFacts(side_mm, rows, facts, table) => {
                let cell = self.sizes.cell;
                let room = WIDTH_MM - 2.0 * side_mm - GAP_MM - BESIDE_GAP_MM;
                let table = table.iter().map(|table| Rows::of(table, room, self.sizes));
                let facts = (!facts.is_empty()).then(|| named(facts, room, cell));
                let beside: Vec<_> = facts.into_iter().chain(table).collect();
                self.pictures(*side_mm, rows, &beside);
            }
            Block::Sign(fields) => self.sign(fields),
            Block::Overview(overview) => self.overview(overview),
        }
    }

    /// Draws a line of text at a place of the page, below its upper edge.
    fn draw(&mut self, text: &Text, [x, y]: [f64; 2], size: f64) {
        let page = self.page();
        let at = [x, y + BASE * size];
        self.paper.text(page, text, at, size, BLACK);
    }

    /// Lines as wide as the page, or as the picture at its right leaves it; one that does not fit goes to the next.
    fn lines(&mut self, text: &Text, size: f64, below: f64) {
        let width = match self.y < self.key_end {
            true => WIDTH_MM - KEY_MM - BESIDE_GAP_MM,
            false => WIDTH_MM,
        };
        for line in text.wrapped(size, width) {
            self.need(LEADING * size);
            self.draw(&line, [MARGIN_MM, self.y], size);
            self.y += LEADING * size;
        }
        self.y += below;
    }

    fn heading(&mut self, text: &Text, size: f64, above: f64) {
        let lines = text.wrapped(size, WIDTH_MM).len() as f64;
        self.need(above + lines * LEADING * size + BELOW_HEADING_MM);
        self.space(above);
        self.lines(text, size, 1.0);
    }

    fn item(&mut self, line: &Line) {
        let (indent, size) = (4.0, self.sizes.body);
        let lines = Text::of(line, false).wrapped(size, WIDTH_MM - indent);
        for (at, line) in lines.iter().enumerate() {
            self.need(LEADING * size);
            if at == 0 {
                self.draw(&Text::plain("•"), [MARGIN_MM + 1.0, self.y], size);
            }
            self.draw(line, [MARGIN_MM + indent, self.y], size);
            self.y += LEADING * size;
        }
    }

    /// A picture at the right, beside what follows.
    fn key_picture(&mut self, picture: &Picture<'a>) {
        let caption = Text::of(&picture.caption, false).wrapped(CAPTION, KEY_MM);
        let height = picture_height(KEY_MM, caption.len());
        self.need(height);
        let at = [MARGIN_MM + WIDTH_MM - KEY_MM, self.y];
        self.picture(picture, &caption, at, KEY_MM);
        self.key_end = self.y + height + 2.0;
    }

    /// Fields side by side: what is there already, the line below it, and its name.
    fn sign(&mut self, fields: &Facts) {
        let (size, above) = (self.sizes.body, 10.0);
        self.y = self.y.max(self.key_end);
        self.need(above + LEADING * (size + CAPTION) + 1.0);
        self.y += above;
        let page = self.page();
        let width = (WIDTH_MM + BESIDE_GAP_MM) / fields.len() as f64 - BESIDE_GAP_MM;
        for (number, (name, value)) in fields.iter().enumerate() {
            let x = MARGIN_MM + number as f64 * (width + BESIDE_GAP_MM);
            let value = Text::of(value, false).cut(size, width);
            self.draw(&value, [x, self.y], size);
            let below = self.y + LEADING * size;
            self.paper.rule(page, [x, below], width, BLACK);
            self.draw(&Text::plain(name), [x, below + 0.5], CAPTION);
        }
        self.y += LEADING * (size + CAPTION) + 2.0;
    }

    /// What is wrong with the mask, in a frame.
    fn warning(&mut self, doubt: &str, reasons: &[String]) {
        let inside = 2.5;
        let width = WIDTH_MM - 2.0 * inside;
        let reasons = reasons.iter().map(|reason| Text::plain(reason));
        let texts = std::iter::once(Text::strong(doubt)).chain(reasons);
        let lines: Vec<_> = texts
            .flat_map(|text| text.wrapped(USUAL.body, width))
            .collect();
        let height = lines.len() as f64 * LEADING * USUAL.body + 2.0 * inside;
        self.need(height);
        let page = self.page();
        let at = [MARGIN_MM, self.y];
        self.paper.frame(page, at, [WIDTH_MM, height]);
        for (number, line) in lines.iter().enumerate() {
            let y = self.y + inside + number as f64 * LEADING * USUAL.body;
            self.draw(line, [MARGIN_MM + inside, y], USUAL.body);
        }
        self.y += height + 3.0;
    }

    /// Draws a row and goes below it.
    fn row(&mut self, row: &Row, left: f64) {
        let y = self.y;
        for Cell { x, lines } in &row.cells {
            for (number, line) in lines.iter().enumerate() {
                let y = y + row.above + number as f64 * LEADING * row.size;
                self.draw(line, [left + x, y], row.size);
            }
        }
        self.y += row.height;
        if let Some(width) = row.rule {
            let page = self.page();
            self.paper.rule(page, [left, self.y], width, GREY);
        }
    }

    /// A table, with its head on every page.
    fn table(&mut self, table: &Table) {
        self.y = self.y.max(self.key_end);
        let rows = Rows::of(table, WIDTH_MM, self.sizes);
        let Some((head, rows)) = rows.rows.split_first() else {
            return;
        };
        self.need(head.height + rows.first().map_or(0.0, |row| row.height));
        self.row(head, MARGIN_MM);
        for row in rows {
            if self.y + row.height > END_MM {
                self.begin_page();
                self.row(head, MARGIN_MM);
            }
            self.row(row, MARGIN_MM);
        }
        self.y += 2.0;
    }

    /// Rows of pictures, and what stands at their right.
    fn pictures(&mut self, side_mm: f64, rows: &[Vec<Picture<'a>>], beside: &[Rows]) {
        let caption = |picture: &Picture<'a>| {
            let caption = Text::of(&picture.caption, false);
            caption.wrapped(CAPTION, side_mm)
        };
        let captions = rows.iter().map(|row| row.iter().map(caption).collect());
        let captions: Vec<Vec<_>> = captions.collect();
        let height = |captions: &Vec<Vec<Text>>| {
            let lines = captions.iter().map(Vec::len).max().unwrap_or(0);
            picture_height(side_mm, lines) + 1.5
        };
        let of_pictures = captions.iter().map(height).sum::<f64>() - 1.5;
        let of_rows = beside.iter().map(|rows| rows.height() + 3.0).sum();
        self.need(of_pictures.max(of_rows));
        let step = side_mm + GAP_MM;
        let top = self.y;
        for rows in beside {
            for row in &rows.rows {
                self.row(row, MARGIN_MM + WIDTH_MM - rows.room);
            }
            self.y += 3.0;
        }
        let end = std::mem::replace(&mut self.y, top);
        for (row, captions) in rows.iter().zip(&captions) {
            for (number, (picture, caption)) in row.iter().zip(captions).enumerate() {
                let at = [MARGIN_MM + number as f64 * step, self.y];
                self.picture(picture, caption, at, side_mm);
            }
            self.y += height(captions);
        }
        self.y = self.y.max(end);
    }

    /// A picture above the lines of its caption.
    fn picture(&mut self, picture: &Picture<'a>, caption: &[Text], [x, y]: [f64; 2], side_mm: f64) {
        let page = self.page();
        self.paper.picture(page, picture, [x, y], side_mm);
        for (number, line) in caption.iter().enumerate() {
            let y = y + picture_height(side_mm, number);
            self.draw(line, [x, y], CAPTION);
        }
    }

    fn overview(&mut self, overview: &Overview<'a>) {
        let step = SMALL_PICTURE_MM + SMALL_GAP_MM;
        let Sizes { heading, cell, .. } = *self.sizes;
        let names = LEADING * cell + 0.5;
        let below = names + overview.rows.len() as f64 * step;
        let title = Text::strong(overview.title);
        self.need(4.0 + LEADING * heading + 1.0 + below);
        self.space(4.0);
        self.lines(&title, heading, 1.0);
        let column = |number: usize| MARGIN_MM + ROW_NAME_MM + number as f64 * step;
        for (number, name) in overview.columns.iter().enumerate() {
            let name = Text::strong(name).cut(CAPTION, SMALL_PICTURE_MM);
            self.draw(&name, [column(number), self.y], CAPTION);
        }
        self.y += names;
        for (name, pictures) in &overview.rows {
            self.draw(&Text::strong(name), [MARGIN_MM, self.y], cell);
            let (page, y) = (self.page(), self.y);
            for (number, picture) in pictures.iter().enumerate() {
                let at = [column(number), y];
                self.paper.picture(page, picture, at, SMALL_PICTURE_MM);
            }
            self.y += step;
        }
    }
}

/// The height of a picture with so many lines below it.
fn picture_height(side_mm: f64, lines: usize) -> f64 {
    side_mm + 0.5 + lines as f64 * LEADING * CAPTION
}

/// Rows that are laid out but not drawn.
struct Rows {
    room: f64,
    rows: Vec<Row>,
}

struct Row {
    cells: Vec<Cell>,
    size: f64,
    above: f64,
    height: f64,
    /// The width of the line below it.
    rule: Option<f64>,
}

struct Cell {
    /// From the left end of the row.
    x: f64,
    lines: Vec<Text>,
}

impl Rows {
    /// A table, its head first. The widest columns give way where they do not all fit.
    fn of(table: &Table, room: f64, sizes: &Sizes) -> Self {
        let head = table.head.iter().map(|name| Text::strong(name)).collect();
        let rows = table.rows.iter();
        let rows = rows.map(|row| row.iter().map(|cell| Text::of(cell, false)).collect());
        let rows: Vec<Vec<Text>> = std::iter::once(head).chain(rows).collect();
        let mut widths = natural_widths(&rows, sizes.cell);
        let gaps = COLUMN_GAP_MM * widths.len().saturating_sub(1) as f64;
        fit(&mut widths, room - gaps);
        let width = widths.iter().sum::<f64>() + gaps;
        let row =
            |texts: Vec<Text>| Row::of(&texts, &widths, (sizes.cell, sizes.around), Some(width));
        Self {
            room,
            rows: rows.into_iter().map(row).collect(),
        }
    }

    fn height(&self) -> f64 {
        self.rows.iter().map(|row| row.height).sum()
    }
}

/// Names with values beside them, in a width; names have little more than a third of it.
fn named(facts: &Facts, room: f64, size: f64) -> Rows {
    let texts = facts.iter();
    let texts = texts.map(|(name, value)| vec![Text::strong(name), Text::of(value, false)]);
    let texts: Vec<_> = texts.collect();
    let names = natural_widths(&texts, size).first().copied();
    let names = names.unwrap_or(0.0).min(0.36 * room);
    let widths = [names, room - names - COLUMN_GAP_MM];
    let row = |texts: Vec<Text>| Row::of(&texts, &widths, (size, 0.2), None);
    Rows {
        room,
        rows: texts.into_iter().map(row).collect(),
    }
}

/// Makes the widest columns as wide as each other, so that all have room.
fn fit(widths: &mut [f64], room: f64) {
    let mut sorted = widths.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let mut left = room;
    for (at, width) in sorted.iter().enumerate() {
        let share = left / (sorted.len() - at) as f64;
        if *width > share {
            widths
                .iter_mut()
                .for_each(|width| *width = width.min(share));
            return;
        }
        left -= width;
    }
}

impl Row {
    fn of(texts: &[Text], widths: &[f64], (size, above): (f64, f64), rule: Option<f64>) -> Self {
        let mut x = 0.0;
        let mut cells = Vec::with_capacity(texts.len());
        for (text, width) in texts.iter().zip(widths) {
            // A width that fits to the last digit must not break the line.
            let lines = text.wrapped(size, width + 1e-6);
            cells.push(Cell { x, lines });
            x += width + COLUMN_GAP_MM;
        }
        let lines = cells.iter().map(|cell| cell.lines.len()).max();
        let lines = lines.unwrap_or(0) as f64;
        Self {
            cells,
            size,
            above,
            height: lines * LEADING * size + 2.0 * above,
            rule,
        }
    }
}

/// The width of the widest text of each column.
fn natural_widths(rows: &[Vec<Text>], size: f64) -> Vec<f64> {
    let columns = rows.first().map_or(0, Vec::len);
    let column = |at: usize| rows.iter().filter_map(move |row| row.get(at));
    let widest = |at| column(at).map(|text| text.width(size)).fold(0.0, f64::max);
    (0..columns).map(widest).collect()
}

#[cfg(test)]
mod tests {
    use std::io::Read as _;

    use flate2::read::ZlibDecoder;
    use pdf_writer::{Content, Str};
    use render::{Frame, FrameSize, PixelFormat, encode_png};

    use super::*;
    use crate::contents::{CUT_ABOVE_SLICES_MM, CUT_MM, Piece, SLICE_BELOW_CUTS_MM, SLICE_MM};
    use crate::pictures::{Shot, Shows};

    const SIDE: u32 = 240;

    fn shot(is_flipped: bool) -> Shot {
        let size = FrameSize::new(SIDE, SIDE).unwrap();
        let bytes = (0..3 * SIDE * SIDE).map(|at| (at.wrapping_mul(at) / 7) as u8);
        let frame = Frame::new(size, PixelFormat::Rgb8, bytes.collect());
        Shot {
            png: encode_png(&frame, &[]).unwrap(),
            side: SIDE,
            pixels_per_mm: 3.0,
            mark: Some([120.0, 120.0]),
            outline: vec![[100.0, 100.0], [130.0, 100.0], [130.0, 500.0]],
            is_closed: true,
            is_flipped,
            directions: ["R", "L", "A", "P"].map(str::to_owned),
            shows: Shows::Anatomy,
        }
    }

    fn picture(shot: &Shot) -> Picture<'_> {
        Picture {
            caption: "T1, 6.0 mm, from the left: left, as acquired".into(),
            shot,
        }
    }

    /// Rows of so many pictures each.
    fn rows(rows: usize, count: usize, side_mm: f64, shot: &Shot) -> Block<'_> {
        let row = |_| (0..count).map(|_| picture(shot)).collect();
        Block::Pictures(side_mm, (0..rows).map(row).collect())
    }

    fn overview(shot: &Shot) -> Block<'_> {
        let row = |mm: u32| {
            let pictures = (0..6).map(|_| picture(shot)).collect();
            (format!("{mm} mm"), pictures)
        };
        Block::Overview(Overview {
            title: "Overview",
            columns: vec!["from somewhere"; 6],
            rows: [6, 10, 15, 20].map(row).into(),
        })
    }

    fn contents(blocks: Vec<Block<'_>>) -> Contents<'_> {
        Contents {
            language: "en",
            title: "Report",
            notice: "Not for diagnosis.",
            identity: "A head · 0123abcd".to_owned(),
            doubt: Some("Brain mask: CHECK IT".to_owned()),
            unprintable: "by its number",
            unsigned: "not signed",
            sections: vec![Section {
                kind: SectionKind::Front,
                blocks,
            }],
        }
    }

    /// The operators of each page.
    fn pages(pdf: &[u8]) -> Vec<String> {
        let mut pages = Vec::new();
        for part in split(pdf, b"stream\n").skip(1) {
            let mut text = Vec::new();
            let is_page = ZlibDecoder::new(part).read_to_end(&mut text).is_ok();
            if is_page && text.ends_with(b"Q") | text.ends_with(b"ET") {
                pages.push(String::from_utf8(text).unwrap());
            }
        }
        pages
    }

    fn split<'a>(bytes: &'a [u8], by: &'a [u8]) -> impl Iterator<Item = &'a [u8]> {
        let mut rest = Some(bytes);
        std::iter::from_fn(move || {
            let here = rest?;
            let at = here.windows(by.len()).position(|window| window == by);
            rest = at.map(|at| &here[at + by.len()..]);
            Some(&here[..at.unwrap_or(here.len())])
        })
    }

    /// The operator that shows a text in one run.
    fn shown(text: &str) -> String {
        let glyphs = text
            .chars()
            .flat_map(|character| typeface::glyph(character).to_be_bytes());
        let mut content = Content::new();
        content.show(Str(&glyphs.collect::<Vec<_>>()));
        String::from_utf8(content.finish().to_vec()).unwrap()
    }

    #[test]
    fn every_page_states_the_case_the_use_the_doubt_and_its_number() {
        let note = Line(vec![Piece::Foreign("many words ".repeat(1500))]);
        let pdf = contents(vec![Block::Text(note)]).pdf().unwrap();
        let pages = pages(&pdf);
        assert!(pages.len() > 1, "{}", pages.len());
        for (number, page) in (1..).zip(&pages) {
            let number = format!("{number} / {}", pages.len());
            for text in [
                "Not for diagnosis.",
                "Brain mask: CHECK IT",
                "Isocortex · A head · 0123abcd",
                &number,
            ] {
                assert!(page.contains(&shown(text)), "{text}");
            }
            assert!(!page.contains(&shown("by its number")));
        }
        let words: usize = pages.iter().map(|page| page.matches(" Tj").count()).sum();
        assert!(words > 100, "every line is drawn: {words}");
    }

    #[test]
    fn many_doubts_leave_the_name_of_the_case() {
        let mut made = contents(vec![Block::Heading("A page".into())]);
        let doubt = "CLOSED: the archive has other pixels · SIDES IN DOUBT".repeat(4);
        made.doubt = Some(doubt.clone());
        let [page] = &pages(&made.pdf().unwrap())[..] else {
            panic!("one page");
        };
        assert!(page.contains(&shown("Isocortex · A head · 0123abcd")));
        let lines = Text::strong(&doubt).wrapped(EDGE, WIDTH_MM);
        assert!(lines.len() > 1);
        assert!(lines.iter().all(|line| line.width(EDGE) <= WIDTH_MM));
    }

    #[test]
    fn a_finding_that_needs_a_further_page_is_named_there() {
        let shot = shot(false);
        for kind in [SectionKind::Finding, SectionKind::Appendix] {
            let mut blocks = vec![Block::Heading("Finding 2: a mark".into())];
            let rows = (0..6).map(|_| Block::Pictures(41.0, vec![vec![picture(&shot)]]));
            blocks.extend(rows);
            let mut made = contents(blocks);
            made.sections[0].kind = kind;
            let pages = pages(&made.pdf().unwrap());
            assert_eq!(pages.len(), 2);
            let name = shown("Finding 2: a mark");
            let named = pages.iter().map(|page| page.contains(&name));
            let is_finding = kind == SectionKind::Finding;
            assert_eq!(named.collect::<Vec<_>>(), [true, is_finding]);
        }
    }

    /// Where each page ends: the lower edge of its last picture, in mm.
    fn ends(pdf: &[u8]) -> Vec<f64> {
        let pages = pages(pdf);
        let ends = |page: &String| {
            let ends = places(page).map(|[_, y, width]| y + width);
            ends.fold(0.0, f64::max)
        };
        pages.iter().map(ends).collect()
    }

    /// The pictures of a page: the upper left corner and the width of each, in mm.
    fn places(page: &str) -> impl Iterator<Item = [f64; 3]> + use<'_> {
        let matrices = page.lines().filter_map(|line| line.strip_suffix(" cm"));
        matrices.filter_map(|matrix| {
            let numbers: Vec<f64> = matrix.split(' ').map(|n| n.parse().unwrap()).collect();
            let [scale, _, _, same, x, y] = numbers[..] else {
                panic!("{matrix}");
            };
            (scale == same && scale > 0.0).then_some([x, y, scale * f64::from(SIDE)])
        })
    }

    #[test]
    fn a_finding_with_a_note_has_one_page_and_with_a_further_layer_two_that_are_full() {
        let shot = shot(false);
        let pairs = |rows: usize| {
            let row = |_| vec![picture(&shot), picture(&shot)];
            (0..rows).map(row).collect::<Vec<_>>()
        };
        let facts = || (0..12).map(|_| ("A fact", "a value".into())).collect();
        let table = || Table {
            head: vec!["", "Here", "Other side"],
            rows: vec![
                vec![
                    "Blur at this point (z)".into(),
                    "1.00".into(),
                    "2.00".into()
                ];
                5
            ],
        };
        let one_page = [
            Block::PicturesAndFacts(CUT_ABOVE_SLICES_MM, pairs(2), facts(), Some(table())),
            rows(2, 4, SLICE_BELOW_CUTS_MM, &shot),
        ];
        let two_pages = [
            Block::PicturesAndFacts(CUT_MM, pairs(3), facts(), Some(table())),
            rows(4, 4, SLICE_MM, &shot),
        ];
        for (blocks, full) in [(one_page, vec![220.0]), (two_pages, vec![190.0, 200.0])] {
            let first = [
                Block::Heading("Finding 1: a mark".into()),
                Block::Text("A sentence. ".repeat(40).into()),
            ];
            let mut made = contents(first.into_iter().chain(blocks).collect());
            made.sections[0].kind = SectionKind::Finding;
            let ends = ends(&made.pdf().unwrap());
            assert_eq!(ends.len(), full.len());
            assert!(
                ends.iter().zip(&full).all(|(end, full)| end > full),
                "{ends:?}"
            );
        }
        for (count, side_mm) in [(2.0, CUT_MM), (4.0, SLICE_MM), (4.0, SLICE_BELOW_CUTS_MM)] {
            let width = count * (side_mm + GAP_MM) - GAP_MM;
            assert!(width <= WIDTH_MM, "{width}");
        }
    }

    #[test]
    fn text_beside_the_key_picture_leaves_it_free_and_a_table_stands_below() {
        let shot = shot(false);
        let table = Table {
            head: vec!["Number"],
            rows: vec![vec!["1".into()]],
        };
        let made = contents(vec![
            Block::KeyPicture(picture(&shot)),
            Block::Large("many words ".repeat(9).into()),
            Block::Table(table),
            Block::Sign(vec![
                ("Reader", "A. Reader".into()),
                ("Day", Line::default()),
            ]),
        ]);
        let pages = pages(&made.pdf().unwrap());
        let [left, top, width] = places(&pages[0]).next().unwrap();
        assert!((width - KEY_MM).abs() < 0.1);
        for text in pages[0].lines().filter_map(|line| line.strip_suffix(" Tm")) {
            let numbers: Vec<f64> = text.split(' ').map(|n| n.parse().unwrap()).collect();
            let is_beside = numbers[5] > top && numbers[5] < top + width;
            // The letters in the picture have its own pixels.
            assert!(!is_beside || numbers[4] < left, "{text}");
        }
        assert!(pages[0].contains(&shown("A. Reader")));
    }

    #[test]
    fn a_page_that_has_numbers_for_characters_explains_them() {
        let lacks = Line(vec![Piece::Foreign("灰".to_owned())]);
        let pdf = contents(vec![Block::Text(lacks)]).pdf().unwrap();
        let pages = pages(&pdf);
        assert!(pages[0].contains(&shown("‹U+7070›")));
        assert!(pages[0].contains(&shown("by its number")));
    }

    #[test]
    fn each_picture_is_whole_on_its_page_and_has_its_own_pixels() {
        let (shot, flipped) = (shot(false), shot(true));
        let mut blocks = Vec::new();
        for _ in 0..7 {
            blocks.push(Block::Heading("A finding".into()));
            blocks.push(rows(1, 4, SLICE_MM, &shot));
            blocks.push(rows(1, 3, 55.0, &flipped));
        }
        blocks.push(overview(&shot));
        blocks.push(overview(&shot));
        let made = contents(blocks);
        let pdf = made.pdf().unwrap();
        assert!(pdf == made.pdf().unwrap(), "the same bytes");
        let (mut pictures, mut turned) = (0, 0);
        let pages = pages(&pdf);
        for page in &pages {
            turned += page.matches("-240 0 0 -240 240 240 cm").count();
            for [x, y, width] in places(page) {
                let is_inside = x >= MARGIN_MM
                    && x + width <= PAGE_MM[0] - MARGIN_MM + 0.2
                    && y >= HEAD_MM
                    && y + width <= END_MM;
                assert!(is_inside, "{x} {y} {width}");
                pictures += 1;
            }
        }
        assert_eq!([pictures, turned], [7 * 7 + 48, 7 * 3]);
        // Nothing is encoded again, and what is shown twice is there once.
        let end = shot.png.len() - 16;
        let pixels = &shot.png[end - 4000..end - 4];
        let text = String::from_utf8_lossy(&pdf);
        assert_eq!(text.matches("/Predictor 15").count(), 2);
        assert_eq!(split(&pdf, pixels).count() - 1, 2);
    }

    #[test]
    fn a_picture_with_an_alpha_channel_is_refused() {
        let size = FrameSize::new(8, 8).unwrap();
        let frame = Frame::new(size, PixelFormat::GreyAlpha8, vec![9; 128]);
        let shot = Shot {
            png: encode_png(&frame, &[]).unwrap(),
            ..shot(false)
        };
        let made = contents(vec![rows(1, 1, CUT_MM, &shot)]);
        assert!(matches!(made.pdf(), Err(Error::Picture)));
    }

    #[test]
    fn the_widest_columns_give_way() {
        let mut widths = [10.0, 400.0, 85.0, 20.0];
        fit(&mut widths, 180.0);
        assert_eq!(widths, [10.0, 75.0, 75.0, 20.0]);
        fit(&mut widths, 200.0);
        assert_eq!(widths, [10.0, 75.0, 75.0, 20.0]);
    }

    #[test]
    fn a_table_repeats_its_head_and_fits_between_the_margins() {
        let row = |number: u32| {
            let label = Line(vec![Piece::Foreign("a long label ".repeat(14))]);
            vec![number.to_string().into(), label]
        };
        let table = Table {
            head: vec!["Number", "Label"],
            rows: (0..60).map(row).collect(),
        };
        for row in &Rows::of(&table, WIDTH_MM, &USUAL).rows {
            assert!(row.rule.unwrap() <= WIDTH_MM + 1e-6);
        }
        let pdf = contents(vec![Block::Table(table)]).pdf().unwrap();
        let pages = pages(&pdf);
        assert!(pages.len() > 1);
        assert!(pages.iter().all(|page| page.contains(&shown("Label"))));
        assert!(pages[pages.len() - 1].contains(&shown("59")));
    }
}
