//! A table of ten meshes at five depths, and a picture of all backends side by side.

use std::fmt::Write as _;

use geometry::{MeshSize, PathTable, Paths};
use render::{
    Camera, Frame, FrameSize, NamedView, PixelFormat, RenderBackend, RenderParameters,
    RenderRequest, SheetPlan, SizedMesh,
};

use super::{MESH_SIZES, exact_pictures, mesh_against_exact};
use crate::rotation::backend_label;
use crate::{BenchError, Column, PreparedHead, Table, column};

/// The depths of the table, in mm, and the keys of their means and 95th percentiles.
const DEPTHS_MM: [f64; 5] = [0.0, 5.0, 10.0, 20.0, 30.0];
const COLUMNS: [[Column; 2]; 5] = [
    [column("mean_0mm", "0 mm"), column("p95_0mm", "95 %")],
    [column("mean_5mm", "5 mm"), column("p95_5mm", "95 %")],
    [column("mean_10mm", "10 mm"), column("p95_10mm", "95 %")],
    [column("mean_20mm", "20 mm"), column("p95_20mm", "95 %")],
    [column("mean_30mm", "30 mm"), column("p95_30mm", "95 %")],
];

/// The depths of the pictures side by side, in mm, and the pixels of their sides.
const SIDE_BY_SIDE_MM: [f64; 2] = [0.0, 8.0];
const CELL: u32 = 224;
/// Contours and points of the mesh in them, fine enough to hide facets.
const FINE_MESH: [usize; 2] = [200, 200];

/// The columns of mean differences, each with its depth in mm.
pub(crate) fn means() -> impl Iterator<Item = (f64, &'static str)> {
    let keys = COLUMNS.iter().map(|[mean, _]| mean.key);
    DEPTHS_MM.into_iter().zip(keys)
}

/// The difference between pictures of the ten meshes and exact ones: mean and 95th percentile in levels of 255, from
/// six sides.
///
/// # Errors
/// If a mesh cannot be made or drawn.
pub fn ten_meshes(head: &PreparedHead, size: FrameSize) -> Result<Table, BenchError> {
    let mut columns = vec![column("triangles", "triangles")];
    columns.extend(COLUMNS.as_flattened());
    let title =
        "Pictures of meshes compared with exact ones: mean difference and 95 % in levels of 255";
    let mut table = Table::new("agreement", title, &columns);
    let exact = DEPTHS_MM.map(|depth_mm| exact_pictures(head, depth_mm, size));
    let exact = exact.into_iter().collect::<Result<Vec<_>, _>>()?;
    for [contours, points] in MESH_SIZES {
        let paths = flow_table(head, [contours, points])?;
        let mut row = vec![paths.size.triangle_count().into()];
        for exact in &exact {
            let agreement = mesh_against_exact(head, &paths, exact)?;
            row.push(agreement.mean_difference().into());
            row.push(u64::from(agreement.percentile(0.95)).into());
        }
        table.push(row);
    }
    table.note(
        "Meshes along the gradient; over the pixels that both pictures cover, from all six sides.",
    );
    Ok(table)
}

/// All depths of a mesh along the gradient, which are the meshes nearest to the isosurface.
fn flow_table(head: &PreparedHead, size: [usize; 2]) -> Result<PathTable, BenchError> {
    let [contours, points] = size;
    let size = MeshSize::new(contours, points)?;
    let table = head.model().path_table(size, &head.distance, Paths::Flow);
    Ok(table?)
}

/// The table of [`ten_meshes`] in Markdown: the mean, and the 95th percentile in brackets.
pub fn markdown(table: &Table) -> String {
    let mut text = String::from("| triangles |");
    for depth_mm in DEPTHS_MM {
        write!(text, " {depth_mm} mm |").expect("text");
    }
    text.push_str("\n|---|");
    text.push_str(&"---|".repeat(DEPTHS_MM.len()));
    text.push('\n');
    for row in &table.rows {
        let number = |place: usize| row[place].number().unwrap_or_default();
        write!(text, "| {} |", number(0)).expect("text");
        for depth in 0..DEPTHS_MM.len() {
            let [mean, high] = [number(1 + 2 * depth), number(2 + 2 * depth)];
            write!(text, " {mean:.1} ({high:.0}) |").expect("text");
        }
        text.push('\n');
    }
    text
}

/// The left side at 0 and 8 mm, drawn by each backend, on one sheet.
///
/// # Errors
/// If a picture cannot be drawn.
pub fn side_by_side(head: &PreparedHead, backends: &[RenderBackend]) -> Result<Frame, BenchError> {
    let table = flow_table(head, FINE_MESH)?;
    let cell = FrameSize::new(CELL, CELL)?;
    let rows = SIDE_BY_SIDE_MM.map(|depth_mm| format!("{depth_mm} mm"));
    let columns = backends
        .iter()
        .map(|backend| backend_label(backend).to_owned());
    let plan = SheetPlan::new(cell, rows.to_vec(), columns.collect())?;
    let mut sheet = plan.begin(PixelFormat::Grey8);
    for (row, depth_mm) in SIDE_BY_SIDE_MM.into_iter().enumerate() {
        let request = RenderRequest::new(RenderParameters {
            depth_mm,
            camera: Camera::named(NamedView::Left),
            size: cell,
            ..RenderParameters::new(head.window)
        })?;
        let mesh = SizedMesh {
            size: table.size,
            mesh: table.shrink(depth_mm as f32),
        };
        let job = head.job(request, Some(mesh));
        for (column, backend) in backends.iter().enumerate() {
            sheet.put(&backend.draw(&job)?.frame, row, column);
        }
    }
    Ok(sheet.finish())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Head;

    #[test]
    fn finer_meshes_agree_better_and_the_table_has_every_depth() {
        let head = Head::phantom(4.0).unwrap();
        let (head, _) = PreparedHead::prepare(&head, 10.0).unwrap();
        let table = ten_meshes(&head, FrameSize::new(64, 64).unwrap()).unwrap();
        assert_eq!(table.rows.len(), 10);
        let means = table.pairs("triangles", "mean_5mm");
        let [first, last] = [means[0].1, means[9].1];
        assert!(last < 0.6 * first, "{first} {last}");
        let text = markdown(&table);
        assert!(text.starts_with("| triangles | 0 mm | 5 mm | 10 mm | 20 mm | 30 mm |\n|---|---|"));
        assert_eq!(text.lines().count(), 12);
    }

    #[test]
    fn every_backend_has_its_column() {
        let head = Head::phantom(4.0).unwrap();
        let (head, _) = PreparedHead::prepare(&head, 10.0).unwrap();
        let backends = [
            RenderBackend::Splat,
            RenderBackend::Mesh,
            RenderBackend::Trace,
        ];
        let sheet = side_by_side(&head, &backends).unwrap();
        assert!(sheet.size().width() > 3 * CELL && sheet.size().height() > 2 * CELL);
    }
}
