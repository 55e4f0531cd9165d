//! Plots of tables as SVG.

use plotters::coord::ranged1d::{Ranged, ValueFormatter};
use plotters::prelude::*;

use crate::agreement::means;
use crate::paper::published::{FIGURE_6_MACHINE, MeshRow, TABLE_2, TABLE_2_TRIANGLES};
use crate::{Cell, Table, readable};

/// The x axis of a plot over meshes.
const TRIANGLES: &str = "triangles";

/// Width and height of a plot, in pixels.
const SIZE: (u32, u32) = (760, 520);

/// Colours for colour-blind readers (Okabe and Ito).
const COLORS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(0, 0, 0),
];

type Drawn = Result<(), DrawingAreaErrorKind<std::io::Error>>;

/// A plot over a number with a logarithmic axis.
#[derive(Debug, Clone, PartialEq)]
struct Plot {
    title: String,
    /// The label of the x axis.
    x: &'static str,
    /// The label of the y axis, with its unit.
    y: &'static str,
    is_log: bool,
    series: Vec<Series>,
}

/// A line of a plot, or single points.
#[derive(Debug, Clone, PartialEq)]
struct Series {
    name: String,
    points: Vec<(f64, f64)>,
    is_line: bool,
}

impl Series {
    fn line(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self {
            name: name.into(),
            points,
            is_line: true,
        }
    }

    fn marks(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self {
            is_line: false,
            ..Self::line(name, points)
        }
    }
}

/// The plots of a table as SVG, each with its file name without extension.
pub fn plots(table: &Table) -> Vec<(String, String)> {
    let plots = match table.name {
        "figure_5" => vec![
            (
                "figure_5_envelope",
                figure_5(table, "envelope_fps", "a: the envelope", |row| {
                    row.envelope_fps
                }),
            ),
            (
                "figure_5_inner",
                figure_5(table, "inner_fps", "b: an inner isosurface", |row| {
                    row.inner_fps
                }),
            ),
        ],
        "figure_6" => vec![("figure_6", figure_6(table))],
        "figure_7" => vec![("figure_7", figure_7(table))],
        "agreement" => vec![("agreement", agreement(table))],
        _ => Vec::new(),
    };
    plots
        .into_iter()
        .map(|(name, plot)| (name.to_owned(), plot.svg()))
        .collect()
}

fn figure_5(table: &Table, key: &str, what: &str, published: impl Fn(&MeshRow) -> f64) -> Plot {
    let mut series = Vec::new();
    for name in table.names() {
        let rows: Vec<&Vec<Cell>> = table.rows_named(&name).collect();
        let points = table.pairs_of(rows.iter().copied(), "triangles", key);
        // Without a mesh there is a single rate.
        let level = rows.first().and_then(|row| table.number_in(row, key));
        match (points.is_empty(), level) {
            (true, Some(level)) => {
                series.push(Series::line(name, vec![(200.0, level), (8000.0, level)]));
            }
            _ => series.push(Series::line(name, points)),
        }
    }
    let paper = TABLE_2.iter();
    let paper = paper.map(|row| (TABLE_2_TRIANGLES as f64, published(row)));
    let name = "paper, machines C to I, 2006";
    series.push(Series::marks(name, paper.collect()));
    Plot {
        title: format!("Rotation frame rate by mesh size, {what}"),
        x: TRIANGLES,
        y: "frames a second",
        is_log: true,
        series,
    }
}

fn figure_6(table: &Table) -> Plot {
    let line = |name: &str, key| Series::line(name, table.pairs("triangles", key));
    let paper = TABLE_2.iter().find(|row| row.machine == FIGURE_6_MACHINE);
    let paper = paper.map(|row| (TABLE_2_TRIANGLES as f64, row.derivation_s));
    Plot {
        title: "Mesh derivation time by mesh size".to_owned(),
        x: TRIANGLES,
        y: "seconds",
        is_log: true,
        series: vec![
            line("a new depth, from the table", "derivation_s"),
            line("a new depth along the paths", "walked_s"),
            line("the table of all depths, once", "table_s"),
            Series::marks("paper, machine F, 2006", paper.into_iter().collect()),
        ],
    }
}

fn figure_7(table: &Table) -> Plot {
    let line = |name: &str, key| Series::line(name, table.pairs("triangles", key));
    Plot {
        title: table.title.clone(),
        x: TRIANGLES,
        y: "mm",
        is_log: true,
        series: vec![
            line("depth of the facets, mean", "facet_depth_mean_mm"),
            line("depth of the facets, 95 %", "facet_depth_p95_mm"),
            line("isosurface to mesh, mean", "isosurface_mean_mm"),
            line("isosurface to mesh, 95 %", "isosurface_p95_mm"),
        ],
    }
}

fn agreement(table: &Table) -> Plot {
    let line = |(depth_mm, key)| {
        let points = table.pairs("triangles", key);
        Series::line(format!("{depth_mm} mm deep"), points)
    };
    Plot {
        title: "Meshes compared with exact pictures".to_owned(),
        x: TRIANGLES,
        y: "mean difference, levels of 255",
        is_log: false,
        series: means().map(line).collect(),
    }
}

impl Plot {
    fn svg(&self) -> String {
        let mut svg = String::new();
        // A string can always be written, and the ranges are never empty.
        self.draw(&mut svg).expect("a plot in memory");
        svg
    }

    fn draw(&self, svg: &mut String) -> Drawn {
        let area = SVGBackend::with_string(svg, SIZE).into_drawing_area();
        area.fill(&WHITE)?;
        let points = || self.series.iter().flat_map(|series| &series.points);
        let x = range(points().map(|(x, _)| *x)).log_scale();
        let y = range(points().map(|(_, y)| *y));
        let mut chart = ChartBuilder::on(&area);
        chart
            .margin(12)
            .margin_right(28)
            .caption(&self.title, ("sans-serif", 17))
            .x_label_area_size(44)
            .y_label_area_size(64);
        if self.is_log {
            let y = with_room_below(y).log_scale();
            self.fill(chart.build_cartesian_2d(x, y)?)?;
        } else {
            self.fill(chart.build_cartesian_2d(x, 0.0..y.end)?)?;
        }
        area.present()?;
        Ok(())
    }

    fn fill<'a, X, Y>(
        &self,
        mut chart: ChartContext<'a, SVGBackend<'a>, Cartesian2d<X, Y>>,
    ) -> Drawn
    where
        X: Ranged<ValueType = f64> + ValueFormatter<f64>,
        Y: Ranged<ValueType = f64> + ValueFormatter<f64>,
    {
        chart
            .configure_mesh()
            .x_desc(self.x)
            .y_desc(self.y)
            .light_line_style(WHITE)
            .x_labels(4)
            .x_label_formatter(&|number| format!("{number:.0}"))
            .y_label_formatter(&|number| readable(*number))
            .draw()?;
        for (series, color) in self.series.iter().zip(COLORS.iter().cycle()) {
            let points = series.points.iter().copied();
            let legend =
                move |(x, y)| Rectangle::new([(x, y - 4), (x + 12, y + 4)], color.filled());
            if series.is_line {
                let line = LineSeries::new(points.clone(), color.stroke_width(2));
                chart.draw_series(line)?;
            }
            chart
                .draw_series(points.map(|point| Circle::new(point, 3, color.filled())))?
                .label(&series.name)
                .legend(legend);
        }
        chart
            .configure_series_labels()
            .position(match self {
                Self { is_log: true, .. } => SeriesLabelPosition::LowerLeft,
                Self { x: TRIANGLES, .. } => SeriesLabelPosition::UpperRight,
                _ => SeriesLabelPosition::UpperLeft,
            })
            .background_style(WHITE.mix(0.8))
            .border_style(BLACK.mix(0.3))
            .draw()?;
        Ok(())
    }
}

/// The range, extended downwards by a third of its length on a logarithmic axis: room for the legend.
fn with_room_below(range: std::ops::Range<f64>) -> std::ops::Range<f64> {
    range.start * (range.start / range.end).cbrt()..range.end
}

/// A range from slightly below the least positive number to slightly above the greatest; never empty.
fn range(numbers: impl Iterator<Item = f64>) -> std::ops::Range<f64> {
    let (least, greatest) = numbers
        .filter(|number| *number > 0.0 && number.is_finite())
        .fold((f64::INFINITY, 0.0), |(least, greatest), number| {
            (number.min(least), number.max(greatest))
        });
    if greatest == 0.0 {
        return 1.0..10.0;
    }
    least / 1.25..greatest * 1.25
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::column;

    fn frame_rates() -> Table {
        let columns = [
            column("painter", "drawn by"),
            column("triangles", "triangles"),
            column("envelope_fps", "envelope"),
            column("inner_fps", "inner"),
        ];
        let mut table = Table::new("figure_5", "Figure 5", &columns);
        let row = |name: &str, triangles: Option<usize>, fps: f64| {
            [
                name.into(),
                triangles.into(),
                fps.into(),
                (2.0 * fps).into(),
            ]
        };
        table.push(row("mesh", Some(200), 90.0));
        table.push(row("mesh", Some(8000), 60.0));
        table.push(row("splat", None, 100.0));
        table
    }

    #[test]
    fn a_backend_without_a_mesh_is_a_level_beside_the_mesh_sizes() {
        let plot = figure_5(&frame_rates(), "inner_fps", "b", |row| row.inner_fps);
        assert_eq!(plot.series[0].points, [(200.0, 180.0), (8000.0, 120.0)]);
        assert_eq!(plot.series[1].points, [(200.0, 200.0), (8000.0, 200.0)]);
        assert!(!plot.series[2].is_line && plot.series[2].points.len() == 6);
    }

    #[test]
    fn a_plot_names_its_lines_and_its_axes() {
        let found = plots(&frame_rates());
        assert_eq!(found.len(), 2);
        for (_, svg) in found {
            assert!(svg.starts_with("<svg") && svg.contains("triangles"));
            for name in [
                "mesh",
                "splat",
                "paper, machines C to I, 2006",
                "frames a second",
            ] {
                assert!(svg.contains(name), "{name}");
            }
        }
    }

    #[test]
    fn a_table_without_a_plot_has_none_and_one_without_numbers_an_empty_one() {
        assert!(plots(&Table::new("setup", "Setup", &[])).is_empty());
        let plot = Plot {
            title: "nothing".to_owned(),
            x: TRIANGLES,
            y: "nothing",
            is_log: true,
            series: Vec::new(),
        };
        assert!(plot.svg().ends_with("</svg>\n"));
    }
}
