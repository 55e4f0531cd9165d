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

/// A plot in SVG: the mean difference over the number of triangles, a line for each depth.
pub fn svg_plot(lines: &[DepthLine]) -> String {
    let all = || lines.iter().flat_map(|line| &line.meshes);
    let most_triangles = all().map(|(triangles, _)| *triangles).max().unwrap_or(1) as f64;
    let most = all()
        .map(|(_, agreement)| agreement.mean_difference())
        .fold(1.0, f64::max)
        .ceil();
    let [left, top] = [MARGINS_X[0], MARGINS_Y[0]];
    let [right, bottom] = [SIZE[0] - MARGINS_X[1], SIZE[1] - MARGINS_Y[1]];
    let x = |triangles: f64| left + (right - left) * triangles / most_triangles;
    let y = |levels: f64| bottom - (bottom - top) * levels / most;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {}\" font-family=\"sans-serif\" font-size=\"12\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n",
        SIZE[0], SIZE[1]
    );
    let mut text = |x: f64, y: f64, anchor: &str, text: &str| {
        writeln!(
            svg,
            "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{text}</text>"
        )
        .expect("text");
    };
    for step in 0..=4 {
        let triangles = most_triangles * f64::from(step) / 4.0;
        text(
            x(triangles),
            bottom + 18.0,
            "middle",
            &format!("{triangles:.0}"),
        );
    }
    let spacing = (most / 6.0).ceil();
    let ticks = (0..)
        .map(|tick| f64::from(tick) * spacing)
        .take_while(|&levels| levels <= most);
    for levels in ticks.clone() {
        text(left - 8.0, y(levels) + 4.0, "end", &format!("{levels:.0}"));
    }
    text(
        (left + right) / 2.0,
        SIZE[1] - 10.0,
        "middle",
        "triangles of the mesh",
    );
    text(
        left + 4.0,
        top + 8.0,
        "start",
        "mean difference, levels of 255",
    );
    for levels in ticks {
        let height = y(levels);
        writeln!(
            svg,
            "<path d=\"M{left} {height:.1}H{right}\" stroke=\"#ddd\"/>"
        )
        .expect("text");
    }
    for (line, color) in lines.iter().zip(COLORS.iter().cycle()) {
        let points: Vec<String> = line
            .meshes
            .iter()
            .map(|(triangles, agreement)| {
                format!(
                    "{:.1},{:.1}",
                    x(*triangles as f64),
                    y(agreement.mean_difference())
                )
            })
            .collect();
        writeln!(
            svg,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"1.5\"/>",
            points.join(" ")
        )
        .expect("text");
    }
    // The depths' names beside the ends of their lines, apart where the lines are not.
    let mut ends: Vec<(f64, f64, &str)> = lines
        .iter()
        .zip(COLORS.iter().cycle())
        .filter_map(|(line, color)| {
            let (_, agreement) = line.meshes.last()?;
            Some((y(agreement.mean_difference()), line.depth_mm, *color))
        })
        .collect();
    ends.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut free = f64::NEG_INFINITY;
    for (height, depth_mm, color) in ends {
        let height = height.max(free);
        free = height + 13.0;
        writeln!(
            svg,
            "<text x=\"{:.1}\" y=\"{:.1}\" fill=\"{color}\">{depth_mm} mm</text>",
            right + 6.0,
            height + 4.0
        )
        .expect("text");
    }
    svg.push_str("</svg>\n");
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
