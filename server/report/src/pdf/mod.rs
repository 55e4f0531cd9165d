//! The report as PDF: its contents laid out on pages that A4 and Letter hold, without a browser.
//!
//! Pictures keep their compressed pixels, marks and letters are drawn over them, and the same report gives the same bytes.
//!
//! `krilla` was tried in place of `pdf-writer` and this module's files: it is as deterministic and embeds 27 kB less of the font, but it
//! compresses pixels again without the filters of PNG (43 kB for a slice of 29 kB) and brings 16 more crates; the layout stays ours.

mod deflate;
mod paper;
mod typeface;

use self::paper::{About, BLACK, PAGE_MM, PT, Paper, RED};
use self::typeface::Text;
use crate::Error;
use crate::contents::{Block, Contents, Facts, GAP_MM, Line, Overview, Picture, Section, Table};

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
const HEADING: f64 = 12.5 * PT;
const SUBHEADING: f64 = 10.5 * PT;
const BODY: f64 = 9.5 * PT;
const CELL: f64 = 8.5 * PT;
const CAPTION: f64 = 7.0 * PT;
const EDGE: f64 = 7.5 * PT;

/// From one line to the next, as a part of the height of letters; and from its upper edge to its base line.
const LEADING: f64 = 1.32;
const BASE: f64 = 0.98;

/// What must fit below a heading, in mm.
const BELOW_HEADING_MM: f64 = 25.0;

/// The side of a picture of an overview, and what separates two, in mm.
const SMALL_PICTURE_MM: f64 = 26.0;
const SMALL_GAP_MM: f64 = 1.0;

/// What separates two columns of a table, in mm.
const COLUMN_GAP_MM: f64 = 4.0;

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
            of: Text::default(),
        };
        for section in &self.sections {
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
        let room = WIDTH_MM - doubt.width(EDGE) - COLUMN_GAP_MM;
        let identity = Text::plain(&identity).cut(EDGE, room);
        let unprintable = Text::plain(self.unprintable);
        for page in 0..count {
            let [head, foot] = [10.0, PAGE_MM[1] - 8.5];
            paper.text(page, &identity, [MARGIN_MM, head], EDGE, BLACK);
            paper.text(page, &doubt, [right - doubt.width(EDGE), head], EDGE, RED);
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
            Some(Block::Heading(text)) if self.is_finding => {
                Text::of(text, true).cut(BODY, WIDTH_MM)
            }
            _ => Text::default(),
        }
    }
}

/// Pages, and where the next block begins on the last one.
struct Layout<'a> {
    paper: Paper<'a>,
    y: f64,
    /// The finding that is laid out.
    of: Text,
}

impl<'a> Layout<'a> {
    fn begin_page(&mut self) {
        self.paper.add_page();
        self.y = HEAD_MM;
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
                self.draw(&name, [MARGIN_MM, self.y], BODY);
                self.y += LEADING * BODY + 1.5;
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
        match block {
            Block::Title(title) => self.lines(&Text::strong(title), TITLE, 1.0),
            Block::Notice(notice) => self.lines(&Text::strong(notice), BODY, 2.0),
            Block::Warning(doubt, reasons) => self.warning(doubt, reasons),
            Block::Heading(text) => self.heading(&Text::of(text, true), HEADING, 4.0),
            Block::Subheading(text) => self.heading(&Text::of(text, true), SUBHEADING, 2.0),
            Block::Text(text) => self.lines(&Text::of(text, false), BODY, 1.5),
            Block::List(lines) => {
                for line in lines {
                    self.item(line);
                }
            }
            Block::Facts(facts) => {
                for row in &named(facts, WIDTH_MM).rows {
                    self.need(row.height);
                    self.row(row, MARGIN_MM);
                }
                self.y += 1.5;
            }
            Block::Table(table) => self.table(table),
            Block::FactsAndTable(facts, table) => self.facts_and_table(facts, table),
            Block::Pictures(side_mm, rows) => self.pictures(*side_mm, rows),
            Block::Overview(overview) => self.overview(overview),
        }
    }

    /// Draws a line of text at a place of the page, below its upper edge.
    fn draw(&mut self, text: &Text, [x, y]: [f64; 2], size: f64) {
        let page = self.page();
        let at = [x, y + BASE * size];
        self.paper.text(page, text, at, size, BLACK);
    }

    /// Lines as wide as the page; one that does not fit goes to the next.
    fn lines(&mut self, text: &Text, size: f64, below: f64) {
        for line in text.wrapped(size, WIDTH_MM) {
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
        let indent = 4.0;
        let lines = Text::of(line, false).wrapped(BODY, WIDTH_MM - indent);
        for (at, line) in lines.iter().enumerate() {
            self.need(LEADING * BODY);
            if at == 0 {
                self.draw(&Text::plain("•"), [MARGIN_MM + 1.0, self.y], BODY);
            }
            self.draw(line, [MARGIN_MM + indent, self.y], BODY);
            self.y += LEADING * BODY;
        }
    }

    /// What is wrong with the mask, in a frame.
    fn warning(&mut self, doubt: &str, reasons: &[String]) {
        let inside = 2.5;
        let width = WIDTH_MM - 2.0 * inside;
        let reasons = reasons.iter().map(|reason| Text::plain(reason));
        let texts = std::iter::once(Text::strong(doubt)).chain(reasons);
        let lines: Vec<_> = texts.flat_map(|text| text.wrapped(BODY, width)).collect();
        let height = lines.len() as f64 * LEADING * BODY + 2.0 * inside;
        self.need(height);
        let page = self.page();
        let at = [MARGIN_MM, self.y];
        self.paper.frame(page, at, [WIDTH_MM, height]);
        for (number, line) in lines.iter().enumerate() {
            let y = self.y + inside + number as f64 * LEADING * BODY;
            self.draw(line, [MARGIN_MM + inside, y], BODY);
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
            self.paper.rule(page, [left, self.y], width);
        }
    }

    /// A table, with its head on every page.
    fn table(&mut self, table: &Table) {
        let rows = Rows::of(table, WIDTH_MM);
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

    fn facts_and_table(&mut self, facts: &Facts, table: &Table) {
        let gap = 10.0;
        let right = Rows::of(table, WIDTH_MM / 2.0);
        let left = named(facts, WIDTH_MM - right.width - gap);
        let height = left.height().max(right.height());
        self.need(height);
        let y = self.y;
        let beside = MARGIN_MM + WIDTH_MM - right.width;
        for (rows, x) in [(&left, MARGIN_MM), (&right, beside)] {
            self.y = y;
            for row in &rows.rows {
                self.row(row, x);
            }
        }
        self.y = y + height + 2.0;
    }

    fn pictures(&mut self, side_mm: f64, rows: &[Vec<Picture<'a>>]) {
        let caption = |picture: &Picture<'a>| {
            let caption = Text::of(&picture.caption, false);
            caption.wrapped(CAPTION, side_mm)
        };
        let captions = rows.iter().map(|row| row.iter().map(caption).collect());
        let captions: Vec<Vec<_>> = captions.collect();
        let height = |captions: &Vec<Vec<Text>>| {
            let lines = captions.iter().map(Vec::len).max().unwrap_or(0) as f64;
            side_mm + 0.5 + lines * LEADING * CAPTION + 1.5
        };
        self.need(captions.iter().map(height).sum::<f64>() - 1.5);
        for (row, captions) in rows.iter().zip(&captions) {
            let (page, y) = (self.page(), self.y);
            for (number, (picture, caption)) in row.iter().zip(captions).enumerate() {
                let x = MARGIN_MM + number as f64 * (side_mm + GAP_MM);
                self.paper.picture(page, picture, [x, y], side_mm);
                for (number, line) in caption.iter().enumerate() {
                    let y = y + side_mm + 0.5 + number as f64 * LEADING * CAPTION;
                    self.draw(line, [x, y], CAPTION);
                }
            }
            self.y += height(captions);
        }
    }

    fn overview(&mut self, overview: &Overview<'a>) {
        let step = SMALL_PICTURE_MM + SMALL_GAP_MM;
        let names = LEADING * CELL + 0.5;
        let below = names + overview.rows.len() as f64 * step;
        let title = Text::strong(overview.title);
        self.need(4.0 + LEADING * HEADING + 1.0 + below);
        self.space(4.0);
        self.lines(&title, HEADING, 1.0);
        let column = |number: usize| MARGIN_MM + ROW_NAME_MM + number as f64 * step;
        for (number, name) in overview.columns.iter().enumerate() {
            let name = Text::strong(name).cut(CAPTION, SMALL_PICTURE_MM);
            self.draw(&name, [column(number), self.y], CAPTION);
        }
        self.y += names;
        for (name, pictures) in &overview.rows {
            self.draw(&Text::strong(name), [MARGIN_MM, self.y], CELL);
            let (page, y) = (self.page(), self.y);
            for (number, picture) in pictures.iter().enumerate() {
                let at = [column(number), y];
                self.paper.picture(page, picture, at, SMALL_PICTURE_MM);
            }
            self.y += step;
        }
    }
}

/// Rows that are laid out but not drawn.
struct Rows {
    width: f64,
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
    /// A table, its head first. The widest column gives way where they do not all fit.
    fn of(table: &Table, room: f64) -> Self {
        let head = table.head.iter().map(|name| Text::strong(name)).collect();
        let rows = table.rows.iter();
        let rows = rows.map(|row| row.iter().map(|cell| Text::of(cell, false)).collect());
        let rows: Vec<Vec<Text>> = std::iter::once(head).chain(rows).collect();
        let mut widths = natural_widths(&rows, CELL);
        let gaps = COLUMN_GAP_MM * widths.len().saturating_sub(1) as f64;
        let excess = widths.iter().sum::<f64>() + gaps - room;
        let widest = widths.iter_mut().max_by(|a, b| a.total_cmp(b));
        if let Some(widest) = widest.filter(|_| excess > 0.0) {
            *widest -= excess;
        }
        let width = widths.iter().sum::<f64>() + gaps;
        let row = |texts: Vec<Text>| Row::of(&texts, &widths, (CELL, 0.5), Some(width));
        Self {
            width,
            rows: rows.into_iter().map(row).collect(),
        }
    }

    fn height(&self) -> f64 {
        self.rows.iter().map(|row| row.height).sum()
    }
}

/// Names with values beside them, in a width.
fn named(facts: &Facts, room: f64) -> Rows {
    let texts = facts.iter();
    let texts = texts.map(|(name, value)| vec![Text::strong(name), Text::of(value, false)]);
    let texts: Vec<_> = texts.collect();
    let names = natural_widths(&texts, BODY).first().copied();
    let names = names.unwrap_or(0.0);
    let widths = [names, room - names - COLUMN_GAP_MM];
    let row = |texts: Vec<Text>| Row::of(&texts, &widths, (BODY, 0.2), None);
    Rows {
        width: room,
        rows: texts.into_iter().map(row).collect(),
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
    use crate::contents::{CUT_MM, Piece, SLICE_MM};
    use crate::pictures::{Shot, Shows};

    const SIDE: u32 = 240;

    fn shot(is_flipped: bool) -> Shot {
        let size = FrameSize::new(SIDE, SIDE).unwrap();
        let bytes = (0..3 * SIDE * SIDE).map(|at| (at.wrapping_mul(at) / 7) as u8);
        let frame = Frame::new(size, PixelFormat::Rgb8, bytes.collect());
        Shot {
            png: encode_png(&frame, &[]).unwrap(),
            side: SIDE,
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
            sections: vec![Section {
                is_finding: false,
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
    fn a_finding_that_needs_a_further_page_is_named_there() {
        let shot = shot(false);
        for is_finding in [true, false] {
            let mut blocks = vec![Block::Heading("Finding 2: a mark".into())];
            let rows = (0..6).map(|_| Block::Pictures(41.0, vec![vec![picture(&shot)]]));
            blocks.extend(rows);
            let mut made = contents(blocks);
            made.sections[0].is_finding = is_finding;
            let pages = pages(&made.pdf().unwrap());
            assert_eq!(pages.len(), 2);
            let name = shown("Finding 2: a mark");
            let named = pages.iter().map(|page| page.contains(&name));
            assert_eq!(named.collect::<Vec<_>>(), [true, is_finding]);
        }
    }

    #[test]
    fn a_finding_with_a_sentence_has_one_page_and_its_pictures_have_the_width_of_it() {
        let shot = shot(false);
        let facts = (0..9).map(|_| ("A fact", "a value".into())).collect();
        let blocks = vec![
            Block::Heading("Finding 1: a mark".into()),
            Block::Facts(facts),
            Block::Text("A sentence. ".repeat(12).into()),
            rows(2, 2, CUT_MM, &shot),
            rows(1, 4, SLICE_MM, &shot),
        ];
        let mut made = contents(blocks);
        made.sections[0].is_finding = true;
        assert_eq!(pages(&made.pdf().unwrap()).len(), 1);
        // Rows that are compared are not divided, though one of two has room.
        made.sections[0].blocks.pop();
        made.sections[0].blocks.push(rows(2, 4, SLICE_MM, &shot));
        let pages = pages(&made.pdf().unwrap());
        let drawn = pages.iter().map(|page| page.matches(" Do").count());
        assert_eq!(drawn.collect::<Vec<_>>(), [4, 8]);
        for (count, side_mm) in [(3.0, CUT_MM), (4.0, SLICE_MM)] {
            let width = count * (side_mm + GAP_MM) - GAP_MM;
            assert!((0.9 * WIDTH_MM..=WIDTH_MM).contains(&width), "{width}");
        }
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
            blocks.push(rows(1, 3, CUT_MM, &flipped));
        }
        blocks.push(overview(&shot));
        blocks.push(overview(&shot));
        let made = contents(blocks);
        let pdf = made.pdf().unwrap();
        assert!(pdf == made.pdf().unwrap(), "the same bytes");
        let (mut pictures, mut turned) = (0, 0);
        let pages = pages(&pdf);
        for page in &pages {
            for matrix in page.lines().filter_map(|line| line.strip_suffix(" cm")) {
                let numbers: Vec<f64> = matrix
                    .split(' ')
                    .map(|number| number.parse().unwrap())
                    .collect();
                turned += usize::from(matrix == "-240 0 0 -240 240 240");
                let [scale, _, _, same, x, y] = numbers[..] else {
                    panic!("{matrix}");
                };
                if scale != same || scale <= 0.0 {
                    continue;
                }
                let width = scale * f64::from(SIDE);
                let is_inside = x >= MARGIN_MM
                    && x + width <= PAGE_MM[0] - MARGIN_MM + 0.2
                    && y >= HEAD_MM
                    && y + width <= END_MM;
                assert!(is_inside, "{matrix}");
                pictures += 1;
            }
        }
        assert_eq!([pictures, turned], [7 * 7 + 48, 7 * 3]);
        // Nothing is encoded again.
        let end = shot.png.len() - 16;
        let pixels = &shot.png[end - 4000..end - 4];
        let text = String::from_utf8_lossy(&pdf);
        assert_eq!(text.matches("/Predictor 15").count(), pictures);
        let found = split(&pdf, pixels).count() - 1;
        assert_eq!(found, pictures);
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
    fn a_table_repeats_its_head_and_fits_between_the_margins() {
        let row = |number: u32| {
            let label = Line(vec![Piece::Foreign("a long label ".repeat(14))]);
            vec![number.to_string().into(), label]
        };
        let table = Table {
            head: vec!["Number", "Label"],
            rows: (0..60).map(row).collect(),
        };
        let rows = Rows::of(&table, WIDTH_MM);
        assert!(rows.width <= WIDTH_MM + 1e-6, "{}", rows.width);
        let pdf = contents(vec![Block::Table(table)]).pdf().unwrap();
        let pages = pages(&pdf);
        assert!(pages.len() > 1);
        assert!(pages.iter().all(|page| page.contains(&shown("Label"))));
        assert!(pages[pages.len() - 1].contains(&shown("59")));
    }
}
