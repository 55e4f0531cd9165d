//! The report as HTML. Every text of a reader or of a file is escaped by the template.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use maud::{DOCTYPE, Markup, PreEscaped, html};

use crate::contents::{
    Block, Contents, Facts, KEY_MM, Line, Overview, Picture, Piece, Section, SectionKind, Table,
};
use crate::pictures::{BAR, PolyLine};

/// The look of the report, on a screen and on A4 and Letter.
const STYLE: &str = include_str!("report.css");

/// What the file may load: nothing but the pictures in it.
pub const POLICY: &str = "default-src 'none'; img-src data:; style-src 'unsafe-inline'";

impl Contents<'_> {
    pub(crate) fn html(&self) -> String {
        let page = html! {
            (DOCTYPE)
            html lang=(self.language) {
                head {
                    meta charset="utf-8";
                    meta http-equiv="Content-Security-Policy" content=(POLICY);
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    title { (self.title) " · " (self.identity) }
                    style { (PreEscaped(STYLE)) (PreEscaped(self.margins())) }
                }
                body { main {
                    @for section in &self.sections { (self.section(section)) }
                } }
            }
        };
        page.into_string()
    }

    /// The words of all sections, without pictures.
    pub(crate) fn text(&self) -> String {
        let text = html! {
            article lang=(self.language) {
                @for section in &self.sections { @for block in &section.blocks { (words_of(block, self.unsigned)) } }
            }
        };
        text.into_string()
    }

    /// The words in the margins of every printed page.
    fn margins(&self) -> String {
        format!(
            "@page {{ @top-left {{ content: {} }} @top-right {{ content: {} }} @bottom-left {{ content: {} }} }}",
            css_text(&format!("Isocortex · {}", self.identity)),
            css_text(self.doubt.as_deref().unwrap_or_default()),
            css_text(self.notice),
        )
    }

    /// A section. All but the first, which says it in full, begin with the verdict on the mask: not every browser prints the margins
    /// of pages.
    fn section(&self, section: &Section<'_>) -> Markup {
        let doubt =
            html! { @if let Some(doubt) = &self.doubt { p.warning { strong { (doubt) } } } };
        let blocks = html! { @for each in &section.blocks { (block(each)) } };
        match (section.kind, section.blocks.split_first()) {
            (SectionKind::Front, _) => html! { section.front { (blocks) } },
            (SectionKind::Finding, Some((heading, rest))) => {
                html! { section.page.finding { (sheet(&html! { (doubt) (block(heading)) }, rest)) } }
            }
            _ => html! { section.page.appendix { (doubt) (blocks) } },
        }
    }
}

/// Blocks below a head. Where they go on to the next printed page, it stands above them again, as the head of a table does.
fn sheet(head: &Markup, blocks: &[Block<'_>]) -> Markup {
    html! {
        table.sheet role="presentation" {
            thead { tr { td { (head) } } }
            tbody { @for each in blocks { tr { td { (block(each)) } } } }
        }
    }
}

fn block(block: &Block<'_>) -> Markup {
    match block {
        Block::Title(title) => html! { h1 { (title) } },
        Block::Notice(notice) => html! { p.notice { (notice) } },
        Block::Warning(doubt, reasons) => html! {
            div.warning { strong { (doubt) } @for reason in reasons { p { (reason) } } }
        },
        Block::KeyPicture(each) => html! { div.key { (picture(each, KEY_MM)) } },
        Block::Heading(text) => html! { h2 { (line(text)) } },
        Block::Subheading(text) => html! { h3 { (line(text)) } },
        Block::Large(text) => html! { p.large.text[!text.is_own()] { (line(text)) } },
        Block::Text(text) => html! { p.text[!text.is_own()] { (line(text)) } },
        Block::List(lines) => html! { ul { @for each in lines { li { (line(each)) } } } },
        Block::Facts(each) => facts(each),
        Block::Table(each) => table(each),
        Block::Pictures(side_mm, rows) => pictures(rows, *side_mm),
        Block::PicturesAndFacts(side_mm, rows, about, numbers) => html! {
            div.beside {
                (pictures(rows, *side_mm))
                div { (facts(about)) @if let Some(numbers) = numbers { (table(numbers)) } }
            }
        },
        Block::Sign(fields) => html! {
            div.sign { @for (name, value) in fields { div { span { (line(value)) } small { (name) } } } }
        },
        Block::Overview(each) => overview(each),
    }
}

/// A block without its pictures. Nothing is signed by hand on a screen: a signature that is not there yet is said to be missing.
fn words_of(each: &Block<'_>, unsigned: &'static str) -> Markup {
    match each {
        Block::KeyPicture(_) | Block::Pictures(..) | Block::Overview(_) => Markup::default(),
        Block::Sign(fields) => {
            let (mut there, empty): (Facts, Facts) =
                (fields.iter().cloned()).partition(|(_, value)| !value.plain().is_empty());
            // The signature is the last field.
            if let (Some((name, _)), true) = (empty.last(), !there.is_empty()) {
                there.push((*name, unsigned.into()));
            }
            html! { @if !there.is_empty() { (facts(&there)) } }
        }
        Block::PicturesAndFacts(_, _, about, numbers) => html! {
            @if !about.is_empty() { (facts(about)) }
            @if let Some(numbers) = numbers { (table(numbers)) }
        },
        words => block(words),
    }
}

fn pictures(rows: &[Vec<Picture<'_>>], side_mm: f64) -> Markup {
    html! { div.rows { @for row in rows { div.row { @for each in row { (picture(each, side_mm)) } } } } }
}

/// A text; what a reader wrote keeps its own direction.
fn line(Line(pieces): &Line) -> Markup {
    html! {
        @for piece in pieces {
            @match piece {
                Piece::Own(text) => (text),
                Piece::Strong(text) => strong { (text) },
                Piece::Foreign(text) => bdi { (text) },
            }
        }
    }
}

fn facts(facts: &Facts) -> Markup {
    html! { table.about { @for (name, value) in facts { tr { th { (name) } td { (line(value)) } } } } }
}

fn table(Table { head, rows }: &Table) -> Markup {
    html! {
        table.numbers {
            thead { tr { @for name in head { @if name.is_empty() { td {} } @else { th { (name) } } } } }
            @for row in rows {
                tr { @for cell in row { td.number[cell.is_number()].text[!cell.is_own()] { (line(cell)) } } }
            }
        }
    }
}

fn overview(overview: &Overview<'_>) -> Markup {
    html! {
        div.overview {
            h2 { (overview.title) }
            table {
                tr { td {} @for column in &overview.columns { th { (column) } } }
                @for (name, pictures) in &overview.rows {
                    tr { th { (name) } @for each in pictures { td { (drawing(each)) } } }
                }
            }
        }
    }
}

/// A picture above what it shows.
fn picture(picture: &Picture<'_>, side_mm: f64) -> Markup {
    html! { figure style={ "width: " (side_mm) "mm" } { (drawing(picture)) figcaption { (line(&picture.caption)) } } }
}

/// A picture with its marks and the patient's directions at its edges. It is one drawing, which no printer divides.
fn drawing(picture: &Picture<'_>) -> Markup {
    let shot = picture.shot;
    let png = format!("data:image/png;base64,{}", STANDARD.encode(&shot.png));
    let side = shot.side;
    let flip = format!("translate({side} 0) scale(-1 1)");
    let lines: String = shot.lines().iter().map(path).collect();
    let size = format!("{:.1}", shot.letter_size());
    html! {
        svg viewBox={ "0 0 " (side) " " (side) } role="img" aria-label=(picture.caption.plain()) {
            image href=(png) width=(side) height=(side) transform=[shot.is_flipped.then_some(flip)] {}
            @if !lines.is_empty() { @for class in ["halo", "mark"] { path class=(class) d=(lines) {} } }
            @if let Some([[left, y], [right, _]]) = shot.bar() {
                path.bar d={ "M" (format!("{left:.1} {y:.1}")) "H" (format!("{right:.1}")) } {}
            }
            @if let Some(([x, y], size)) = shot.bar_name() {
                text.bar x=(format!("{x:.1}")) y=(format!("{y:.1}")) font-size=(format!("{size:.1}")) { (BAR) }
            }
            @for (letters, [x, y]) in shot.directions.iter().zip(shot.letter_places()) {
                text x=(format!("{x:.1}")) y=(format!("{y:.1}")) font-size=(size) { (letters) }
            }
        }
    }
}

/// A line in the words of SVG.
fn path(line: &PolyLine) -> String {
    let points = line.points.iter().map(|[x, y]| format!("{x:.1} {y:.1}"));
    let end = if line.is_closed { "Z" } else { "" };
    format!("M{}{end}", points.collect::<Vec<_>>().join("L"))
}

/// A text as a string of CSS. Everything but letters, digits and spaces is escaped, so that no text ends the string or the
/// style.
fn css_text(text: &str) -> String {
    let mut quoted = String::from("\"");
    for character in text.chars() {
        if character.is_alphanumeric() || character == ' ' {
            quoted.push(character);
        } else {
            quoted.push_str(&format!("\\{:x} ", u32::from(character)));
        }
    }
    quoted.push('"');
    quoted
}
