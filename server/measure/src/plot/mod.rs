//! Lines of numbers as a picture: SVG, which every browser shows.

mod scale;

use std::fmt::Write as _;

pub use self::scale::Axis;
use self::scale::{Scale, tick_text};

const WIDTH: f64 = 760.0;
const HEIGHT: f64 = 460.0;
/// The corners of the plot's field.
const LEFT: f64 = 78.0;
const RIGHT: f64 = WIDTH - 24.0;
const TOP: f64 = 46.0;
const BOTTOM: f64 = HEIGHT - 58.0;
/// Height of a line of the legend.
const LEGEND_LINE: f64 = 18.0;

/// Colours that the colour-blind tell apart (Okabe and Ito).
const COLORS: [&str; 7] = [
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000",
];

/// A picture of lines.
#[derive(Debug, Clone, PartialEq)]
pub struct Plot {
    /// What it shows.
    pub title: String,
    /// To the right.
    pub x: Axis,
    /// Upwards.
    pub y: Axis,
    /// Its lines.
    pub series: Vec<Series>,
}

/// A line of a plot.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// What the legend says.
    pub name: String,
    /// (x, y), in the order of x.
    pub points: Vec<(f64, f64)>,
    /// Whether only the points are drawn, and no line between them.
    pub is_marks: bool,
}

impl Series {
    /// Points and the line through them.
    pub fn line(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self {
            name: name.into(),
            points,
            is_marks: false,
        }
    }

    /// Points alone.
    pub fn marks(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self {
            is_marks: true,
            ..Self::line(name, points)
        }
    }
}

/// From numbers to places in the picture.
struct Field {
    x: Scale,
    y: Scale,
}

impl Field {
    fn at(&self, (x, y): (f64, f64)) -> Option<(f64, f64)> {
        Some((self.right_of(x)?, self.below(y)?))
    }

    fn right_of(&self, x: f64) -> Option<f64> {
        self.x.place(x).map(|place| LEFT + place * (RIGHT - LEFT))
    }

    fn below(&self, y: f64) -> Option<f64> {
        self.y.place(y).map(|place| BOTTOM - place * (BOTTOM - TOP))
    }
}

impl Plot {
    /// The picture.
    pub fn svg(&self) -> String {
        let points = || self.series.iter().flat_map(|series| &series.points);
        let field = Field {
            x: Scale::around(&self.x, points().map(|(x, _)| *x)),
            y: Scale::around(&self.y, points().map(|(_, y)| *y)),
        };
        let height = HEIGHT + self.series.len() as f64 * LEGEND_LINE;
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" \
             font-family=\"sans-serif\" font-size=\"12\">\n\
             <rect width=\"{WIDTH}\" height=\"{height}\" fill=\"white\"/>\n"
        );
        let _ = writeln!(
            svg,
            "<text x=\"{LEFT}\" y=\"24\" font-size=\"15\" font-weight=\"bold\">{}</text>",
            escaped(&self.title)
        );
        self.grid(&field, &mut svg);
        for (number, series) in self.series.iter().enumerate() {
            series.draw(&field, number, &mut svg);
        }
        self.legend(&mut svg);
        svg.push_str("</svg>\n");
        svg
    }

    fn grid(&self, field: &Field, svg: &mut String) {
        for tick in field.x.ticks() {
            let Some(x) = field.right_of(tick) else {
                continue;
            };
            let text = tick_text(tick);
            let below = BOTTOM + 18.0;
            let _ = writeln!(
                svg,
                "<path d=\"M{x:.1} {TOP}V{BOTTOM}\" stroke=\"#e4e4e4\"/>\
                 <text x=\"{x:.1}\" y=\"{below}\" text-anchor=\"middle\">{text}</text>"
            );
        }
        for tick in field.y.ticks() {
            let Some(y) = field.below(tick) else {
                continue;
            };
            let text = tick_text(tick);
            let (beside, baseline) = (LEFT - 8.0, y + 4.0);
            let _ = writeln!(
                svg,
                "<path d=\"M{LEFT} {y:.1}H{RIGHT}\" stroke=\"#e4e4e4\"/>\
                 <text x=\"{beside}\" y=\"{baseline:.1}\" text-anchor=\"end\">{text}</text>"
            );
        }
        let (middle, lowest) = ((LEFT + RIGHT) / 2.0, HEIGHT - 16.0);
        let halfway = (TOP + BOTTOM) / 2.0;
        let _ = writeln!(
            svg,
            "<path d=\"M{LEFT} {TOP}V{BOTTOM}H{RIGHT}\" stroke=\"black\" fill=\"none\"/>\n\
             <text x=\"{middle}\" y=\"{lowest}\" text-anchor=\"middle\">{}</text>\n\
             <text transform=\"translate(20 {halfway}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
            escaped(&self.x.label),
            escaped(&self.y.label)
        );
    }

    /// The legend, below the field, where it hides nothing.
    fn legend(&self, svg: &mut String) {
        for (number, series) in self.series.iter().enumerate() {
            let y = HEIGHT + number as f64 * LEGEND_LINE;
            let (mark, text, baseline) = (LEFT + 16.0, LEFT + 32.0, y + 4.0);
            let color = COLORS[number % COLORS.len()];
            if !series.is_marks {
                let (from, to) = (LEFT + 6.0, LEFT + 26.0);
                let _ = write!(
                    svg,
                    "<path d=\"M{from:.1} {y:.1}H{to:.1}\" stroke=\"{color}\" stroke-width=\"2\"/>"
                );
            }
            svg.push_str(&mark_at((mark, y), number));
            let name = escaped(&series.name);
            let _ = writeln!(
                svg,
                "<text x=\"{text:.1}\" y=\"{baseline:.1}\">{name}</text>"
            );
        }
    }
}

impl Series {
    fn draw(&self, field: &Field, number: usize, svg: &mut String) {
        let color = COLORS[number % COLORS.len()];
        let places: Vec<_> = self.places(field).collect();
        if !self.is_marks && places.len() > 1 {
            let corners: Vec<String> = places
                .iter()
                .map(|(x, y)| format!("{x:.1},{y:.1}"))
                .collect();
            let _ = writeln!(
                svg,
                "<polyline points=\"{}\" stroke=\"{color}\" stroke-width=\"2\" fill=\"none\"/>",
                corners.join(" ")
            );
        }
        for place in places {
            svg.push_str(&mark_at(place, number));
            svg.push('\n');
        }
    }

    fn places(&self, field: &Field) -> impl Iterator<Item = (f64, f64)> {
        self.points.iter().filter_map(|&point| field.at(point))
    }
}

/// A mark whose shape tells the series as well as its colour does.
fn mark_at((x, y): (f64, f64), number: usize) -> String {
    let color = COLORS[number % COLORS.len()];
    match number % 4 {
        0 => format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\" fill=\"{color}\"/>"),
        1 => format!(
            "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"8\" height=\"8\" fill=\"{color}\"/>",
            x - 4.0,
            y - 4.0
        ),
        2 => format!(
            "<path d=\"M{x:.1} {:.1}l5 9h-10z\" fill=\"{color}\"/>",
            y - 5.0
        ),
        _ => format!(
            "<path d=\"M{x:.1} {:.1}l5 5l-5 5l-5 -5z\" fill=\"{color}\"/>",
            y - 5.0
        ),
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot() -> Plot {
        Plot {
            title: "Frames & <triangles>".to_owned(),
            x: Axis::log("triangles"),
            y: Axis::linear("frames/s"),
            series: vec![
                Series::line("here", vec![(200.0, 100.0), (8000.0, 50.0)]),
                Series::marks("paper", vec![(1800.0, 75.0), (0.0, 1.0)]),
            ],
        }
    }

    #[test]
    fn every_point_that_has_a_place_gets_a_mark_and_lines_join_theirs() {
        let svg = plot().svg();
        // A mark of each series is in the legend as well.
        assert_eq!(svg.matches("<circle").count(), 3);
        assert_eq!(svg.matches("width=\"8\" height=\"8\"").count(), 2);
        assert_eq!(svg.matches("<polyline").count(), 1);
    }

    #[test]
    fn axes_have_their_labels_and_no_text_is_taken_for_markup() {
        let svg = plot().svg();
        assert!(svg.contains(">triangles<") && svg.contains(">frames/s<"));
        assert!(svg.contains("Frames &amp; &lt;triangles>"));
        assert_eq!(svg.matches("<text").count(), svg.matches("</text>").count());
    }

    #[test]
    fn the_legend_stands_below_all_that_is_drawn() {
        let svg = plot().svg();
        let place = |text: &str| -> f64 {
            let line = svg.lines().find(|line| line.contains(text));
            let line = line.expect("the text stands in the plot");
            let (_, after) = line.rsplit_once(" y=\"").expect("a text has a place");
            let (number, _) = after.split_once('"').expect("a place ends");
            number.parse().expect("a place is a number")
        };
        assert!(place(">here<") > place(">triangles<"));
        assert!(place(">paper<") > place(">here<"));
    }

    #[test]
    fn a_plot_of_nothing_is_a_picture() {
        let svg = Plot {
            series: Vec::new(),
            ..plot()
        };
        assert!(svg.svg().ends_with("</svg>\n"));
    }
}
