//! The agreement of meshes with the exact pictures, for people to read.

use std::fmt::Write as _;

use super::Agreement;

/// A line of a figure: a depth, and what each size of mesh agrees by there.
#[derive(Debug, Clone)]
pub struct DepthLine {
    /// The depth, in mm.
    pub depth_mm: f64,
    /// Triangles of a mesh and its agreement, the coarsest mesh first.
    pub meshes: Vec<(usize, Agreement)>,
}

/// A table in Markdown: a row for each size of mesh, a column for each depth; mean and 95th percentile in levels of 255.
///
/// # Panics
/// When the lines have not the same meshes.
pub fn markdown_table(lines: &[DepthLine]) -> String {
    let mut table = String::from("| triangles |");
    for line in lines {
        write!(table, " {} mm |", line.depth_mm).expect("text");
    }
    table.push_str("\n|---|");
    table.push_str(&"---|".repeat(lines.len()));
    table.push('\n');
    let sizes = lines.first().map_or(&[][..], |line| &line.meshes);
    for (row, (triangles, _)) in sizes.iter().enumerate() {
        write!(table, "| {triangles} |").expect("text");
        for line in lines {
            let (same, agreement) = &line.meshes[row];
            assert_eq!(same, triangles, "every depth has the same meshes");
            let [mean, high] = [
                agreement.mean_difference(),
                f64::from(agreement.percentile(0.95)),
            ];
            write!(table, " {mean:.1} ({high:.0}) |").expect("text");
        }
        table.push('\n');
    }
    table
}

/// Width and height of the plot, and its margins at the left and right, top and bottom.
const SIZE: [f64; 2] = [560.0, 340.0];
const MARGINS_X: [f64; 2] = [56.0, 64.0];
const MARGINS_Y: [f64; 2] = [16.0, 48.0];
/// One for each line, told apart by the colour-blind as well (M. Okabe and K. Ito).
const COLORS: [&str; 6] = [
    "#000000", "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00",
];

/// Parts that the axis of triangles is divided into.
const PARTS: u32 = 4;

/// Marks of the axis of levels, about.
const MARKS: f64 = 6.0;

/// Pixels between the names of two lines, at least.
const NAME_HEIGHT: f64 = 13.0;

/// A plot in SVG: the mean difference over the number of triangles, a line for each depth.
pub fn svg_plot(lines: &[DepthLine]) -> String {
    let axes = Axes::around(lines);
    let colored = || lines.iter().zip(COLORS.iter().cycle());
    let curves: String = colored()
        .map(|(line, color)| curve(&axes, line, color))
        .collect();
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {}\" font-family=\"sans-serif\" font-size=\"12\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n\
         {}{}{curves}{}</svg>\n",
        SIZE[0],
        SIZE[1],
        axes.triangles(),
        axes.levels(),
        names(&axes, colored()),
    )
}

/// Where numbers of triangles and levels are in the plot.
struct Axes {
    most_triangles: f64,
    most_levels: f64,
}

impl Axes {
    const LEFT: f64 = MARGINS_X[0];
    const RIGHT: f64 = SIZE[0] - MARGINS_X[1];
    const TOP: f64 = MARGINS_Y[0];
    const BOTTOM: f64 = SIZE[1] - MARGINS_Y[1];

    /// Axes with room for all lines.
    fn around(lines: &[DepthLine]) -> Self {
        let all = || lines.iter().flat_map(|line| &line.meshes);
        let most_triangles = all().map(|(triangles, _)| *triangles).max();
        let levels = all().map(|(_, agreement)| agreement.mean_difference());
        Self {
            most_triangles: most_triangles.unwrap_or(1) as f64,
            most_levels: levels.fold(1.0, f64::max).ceil(),
        }
    }

    fn x(&self, triangles: f64) -> f64 {
        Self::LEFT + (Self::RIGHT - Self::LEFT) * triangles / self.most_triangles
    }

    fn y(&self, levels: f64) -> f64 {
        Self::BOTTOM - (Self::BOTTOM - Self::TOP) * levels / self.most_levels
    }

    /// Numbers and name of the axis of triangles.
    fn triangles(&self) -> String {
        let number = |part: u32| {
            let triangles = self.most_triangles * f64::from(part) / f64::from(PARTS);
            let place = [self.x(triangles), Self::BOTTOM + 18.0];
            text(place, "middle", &format!("{triangles:.0}"))
        };
        let middle = [(Self::LEFT + Self::RIGHT) / 2.0, SIZE[1] - 10.0];
        let name = text(middle, "middle", "triangles of the mesh");
        (0..=PARTS).map(number).chain([name]).collect()
    }

    /// Numbers, lines across and name of the axis of levels.
    fn levels(&self) -> String {
        let spacing = (self.most_levels / MARKS).ceil();
        let marks = (0..).map(|mark| f64::from(mark) * spacing);
        let mark = |levels: f64| {
            let height = self.y(levels);
            let [left, right] = [Self::LEFT, Self::RIGHT];
            let number = [left - 8.0, height + 4.0];
            let number = text(number, "end", &format!("{levels:.0}"));
            format!("<path d=\"M{left} {height:.1}H{right}\" stroke=\"#ddd\"/>\n{number}")
        };
        let place = [Self::RIGHT, Self::TOP + 8.0];
        let name = text(place, "end", "mean difference, levels of 255");
        let marks = marks.take_while(|&levels| levels <= self.most_levels);
        marks.map(mark).chain([name]).collect()
    }
}

fn text([x, y]: [f64; 2], anchor: &str, text: &str) -> String {
    format!("<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{text}</text>\n")
}

/// The line of a depth.
fn curve(axes: &Axes, line: &DepthLine, color: &str) -> String {
    let point = |(triangles, agreement): &(usize, Agreement)| {
        let [x, y] = [
            axes.x(*triangles as f64),
            axes.y(agreement.mean_difference()),
        ];
        format!("{x:.1},{y:.1}")
    };
    let points: Vec<String> = line.meshes.iter().map(point).collect();
    format!(
        "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"1.5\"/>\n",
        points.join(" ")
    )
}

/// The depths beside the ends of their lines, apart where the lines are not.
fn names<'a>(axes: &Axes, lines: impl Iterator<Item = (&'a DepthLine, &'a &'a str)>) -> String {
    let end = |(line, color): (&DepthLine, &&'a str)| {
        let (_, agreement) = line.meshes.last()?;
        Some((axes.y(agreement.mean_difference()), line.depth_mm, *color))
    };
    let mut ends: Vec<(f64, f64, &str)> = lines.filter_map(end).collect();
    ends.sort_by(|a, b| a.0.total_cmp(&b.0));
    let x = Axes::RIGHT + 6.0;
    let mut free = f64::NEG_INFINITY;
    let mut svg = String::new();
    for (height, depth_mm, color) in ends {
        let height = height.max(free);
        free = height + NAME_HEIGHT;
        let y = height + 4.0;
        writeln!(
            svg,
            "<text x=\"{x:.1}\" y=\"{y:.1}\" fill=\"{color}\">{depth_mm} mm</text>"
        )
        .expect("text");
    }
    svg
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(depth_mm: f64) -> DepthLine {
        DepthLine {
            depth_mm,
            meshes: vec![(200, Agreement::default()), (8000, Agreement::default())],
        }
    }

    #[test]
    fn a_table_has_a_row_for_each_mesh_and_a_column_for_each_depth() {
        let table = markdown_table(&[line(0.0), line(5.0)]);
        assert_eq!(
            table,
            "| triangles | 0 mm | 5 mm |\n|---|---|---|\n| 200 | 0.0 (0) | 0.0 (0) |\n| 8000 | 0.0 (0) | 0.0 (0) |\n"
        );
    }

    #[test]
    fn a_plot_has_a_line_for_each_depth() {
        let plot = svg_plot(&[line(0.0), line(5.0), line(10.0)]);
        assert_eq!(plot.matches("<polyline").count(), 3);
        assert!(plot.contains(">10 mm<") && plot.ends_with("</svg>\n"));
        assert!(!svg_plot(&[]).contains("NaN"));
    }
}
