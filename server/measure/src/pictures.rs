//! The plots of the tables that have one.

use crate::paper::published::{FIGURE_6_MACHINE, TABLE_2, TABLE_2_TRIANGLES};
use crate::{Axis, Cell, Plot, Series, Table};

/// The plots of a table, each with the name of its file without ending.
pub fn pictures(table: &Table) -> Vec<(String, Plot)> {
    match table.name {
        "figure_5" => vec![
            figure_5(table, "envelope", "a: the envelope"),
            figure_5(table, "inner", "b: an inner isosurface"),
        ],
        "figure_6" => vec![figure_6(table)],
        "figure_7" => vec![figure_7(table)],
        "growth_volume" => vec![growth(table, ("voxels", "voxels of the volume"), "CPU, ms")],
        "growth_triangles" => vec![growth(table, ("triangles", "triangles"), "ms")],
        "growth_pixels" => vec![growth_pixels(table)],
        "growth_cases" => vec![growth(table, ("cases", "cases in the store"), "ms")],
        "load" => vec![
            load(table, "requests_per_s", "requests/s"),
            load(table, "p50_ms", "median answer, ms"),
            load(table, "p99_ms", "99 % of the answers within, ms"),
        ],
        _ => Vec::new(),
    }
}

fn number_in(table: &Table, row: &[Cell], key: &str) -> Option<f64> {
    let place = table.columns.iter().position(|column| column.key == key)?;
    row[place].number()
}

/// The pairs of two columns for each name in the first column, in the order of the rows.
fn by_name(table: &Table, x: &str, y: &str) -> Vec<(String, Vec<(f64, f64)>)> {
    let mut found: Vec<(String, Vec<(f64, f64)>)> = Vec::new();
    for row in &table.rows {
        let Cell::Text(name) = &row[0] else { continue };
        let pair = number_in(table, row, x).zip(number_in(table, row, y));
        match found.iter_mut().find(|(other, _)| other == name) {
            Some((_, pairs)) => pairs.extend(pair),
            None => found.push((name.clone(), pair.into_iter().collect())),
        }
    }
    found
}

fn figure_5(table: &Table, which: &'static str, what: &str) -> (String, Plot) {
    let y = format!("{which}_fps");
    let mut series: Vec<Series> = Vec::new();
    for (name, points) in by_name(table, "triangles", &y) {
        if !points.is_empty() {
            series.push(Series::line(name, points));
            continue;
        }
        // Without a mesh there is one rate, whatever the triangles.
        let level = table
            .rows
            .iter()
            .find(|row| row[0] == Cell::Text(name.clone()));
        let level = level.and_then(|row| number_in(table, row, &y));
        if let Some(level) = level {
            series.push(Series::line(name, vec![(200.0, level), (8000.0, level)]));
        }
    }
    let figure = |row: &crate::paper::published::MeshRow| match which {
        "envelope" => row.envelope_fps,
        _ => row.inner_fps,
    };
    let paper = TABLE_2.iter();
    let paper = paper.map(|row| (TABLE_2_TRIANGLES as f64, figure(row)));
    series.push(Series::marks(
        "paper, machines C to I, 2006",
        paper.collect(),
    ));
    let plot = Plot {
        title: format!("Rotation frame rate by mesh size, {what}"),
        x: Axis::linear("triangles"),
        y: Axis::log("frames a second"),
        series,
    };
    (format!("figure_5_{which}"), plot)
}

fn figure_6(table: &Table) -> (String, Plot) {
    let line = |name: &str, key| Series::line(name, table.pairs("triangles", key));
    let paper = TABLE_2.iter().find(|row| row.machine == FIGURE_6_MACHINE);
    let paper = paper.map(|row| (TABLE_2_TRIANGLES as f64, row.derivation_s));
    let plot = Plot {
        title: "Mesh derivation time by mesh size".to_owned(),
        x: Axis::linear("triangles"),
        y: Axis::log("seconds"),
        series: vec![
            line("a new depth, out of the table", "derivation_s"),
            line("a new depth along the paths", "walked_s"),
            line("the table of all depths, once", "table_s"),
            Series::marks("paper, machine F, 2006", paper.into_iter().collect()),
        ],
    };
    ("figure_6".to_owned(), plot)
}

fn figure_7(table: &Table) -> (String, Plot) {
    let line = |name: &str, key| Series::line(name, table.pairs("triangles", key));
    let plot = Plot {
        title: table.title.clone(),
        x: Axis::log("triangles"),
        y: Axis::log("mm"),
        series: vec![
            line("depth of the facets, mean", "facet_depth_mean_mm"),
            line("depth of the facets, 95 %", "facet_depth_p95_mm"),
            line("isosurface to mesh, mean", "isosurface_mean_mm"),
            line("isosurface to mesh, 95 %", "isosurface_p95_mm"),
        ],
    };
    ("figure_7".to_owned(), plot)
}

/// Every column in milliseconds by the size.
fn growth(table: &Table, (size, what): (&'static str, &str), unit: &str) -> (String, Plot) {
    let times = table
        .columns
        .iter()
        .filter(|column| column.key.ends_with("_ms"));
    let series = times.map(|column| Series::line(column.head, table.pairs(size, column.key)));
    let plot = Plot {
        title: table.title.clone(),
        x: Axis::log(what),
        y: Axis::log(unit),
        series: series.filter(|series| !series.points.is_empty()).collect(),
    };
    (table.name.to_owned(), plot)
}

fn growth_pixels(table: &Table) -> (String, Plot) {
    let series = by_name(table, "pixels", "frame_ms").into_iter();
    let plot = Plot {
        title: table.title.clone(),
        x: Axis::log("pixels"),
        y: Axis::log("a frame, wall ms"),
        series: series
            .map(|(name, points)| Series::line(name, points))
            .collect(),
    };
    (table.name.to_owned(), plot)
}

fn load(table: &Table, key: &'static str, label: &str) -> (String, Plot) {
    let series = by_name(table, "connections", key).into_iter();
    let plot = Plot {
        title: table.title.clone(),
        x: Axis::log("connections"),
        y: Axis::log(label),
        series: series
            .map(|(name, points)| Series::line(name, points))
            .collect(),
    };
    (format!("load_{key}"), plot)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::column;

    #[test]
    fn a_painter_without_a_mesh_is_a_level_beside_the_mesh_sizes() {
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
        let plots = pictures(&table);
        assert_eq!(plots.len(), 2);
        let (name, inner) = &plots[1];
        assert_eq!(name, "figure_5_inner");
        assert_eq!(inner.series[0].points, [(200.0, 180.0), (8000.0, 120.0)]);
        assert_eq!(inner.series[1].points, [(200.0, 200.0), (8000.0, 200.0)]);
        assert!(inner.series[2].is_marks && inner.series[2].points.len() == 6);
    }

    #[test]
    fn a_table_without_a_plot_has_none() {
        assert!(pictures(&Table::new("setup", "Setup", &[])).is_empty());
    }
}
