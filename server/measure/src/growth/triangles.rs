//! Growth with the triangles.

use std::sync::Arc;

use geometry::{MeshSize, PathTable, Paths, shrink_once};

use super::{Growth, note_exponents};
use crate::{Cell, Costs, MeasureError, Spin, Table, column, timed};

/// Contours and points of the meshes: 200 to 500,000 triangles.
const SIZES: [[usize; 2]; 7] = [
    [10, 10],
    [20, 20],
    [30, 30],
    [80, 50],
    [160, 100],
    [320, 250],
    [500, 500],
];

/// Depths that are looked up together, so that a clock sees them.
const LOOK_UPS: usize = 2000;

/// CPU times of all that is done with a mesh by its triangles.
pub(super) fn table(growth: &Growth<'_>) -> Result<Table, MeasureError> {
    let columns = [
        column("triangles", "triangles"),
        column("mesh_ms", "mesh, ms"),
        column("table_ms", "table, ms"),
        column("new_depth_ms", "new depth, ms"),
        column("walked_ms", "along the paths, ms"),
        column("table_mib", "table, MiB"),
        column("frame_ms", "frame by mesh, wall ms"),
    ];
    let title = format!(
        "Growth with the triangles: CPU, least of {}",
        growth.extent.repeat
    );
    let mut table = Table::new("growth_triangles", title, &columns);
    for [contours, points] in SIZES {
        let size = MeshSize::new(contours, points)?;
        if size.triangle_count() <= growth.extent.triangles {
            table.push(row(growth, size)?);
        }
    }
    let keys = [
        "mesh_ms",
        "table_ms",
        "new_depth_ms",
        "walked_ms",
        "table_mib",
        "frame_ms",
    ];
    note_exponents(&mut table, "triangles", &keys);
    Ok(table)
}

fn row(growth: &Growth<'_>, size: MeshSize) -> Result<Vec<Cell>, MeasureError> {
    let triangles = size.triangle_count();
    growth
        .tell
        .tell(&format!("growth with the triangles: {triangles}"));
    let (case, repeat) = (growth.case, growth.extent.repeat);
    let (mesh, paths) = case.table(size)?;
    let ms = |costs: Costs| Cell::from(costs.least_s() * 1e3);
    let walk = || {
        let forest = Paths::Forest(&case.forest);
        shrink_once(&mesh, &case.distance, &case.field, forest, growth.depth_mm)
    };
    Ok(vec![
        triangles.into(),
        ms(Costs::of(repeat, || {
            geometry::envelope_mesh(&case.field, size)
        })),
        ms(Costs::of(repeat, || case.table_of(&mesh))),
        look_up_ms(&paths, case.distance.max_depth_mm()).into(),
        ms(Costs::of(repeat, walk)),
        mebibytes(&paths).into(),
        frame_ms(growth, size, &paths)?.into(),
    ])
}

/// Time of a depth out of a table, in ms.
pub(super) fn look_up_ms(table: &PathTable, max_depth_mm: f32) -> f64 {
    let rounds = (LOOK_UPS * MeshSize::STANDARD.vertex_count() / table.size.vertex_count()).max(20);
    let look_up = || {
        for round in 0..rounds {
            let depth_mm = max_depth_mm * 0.9 * round as f32 / rounds as f32;
            std::hint::black_box(table.shrink(depth_mm));
        }
    };
    Costs::of(3, look_up).least_s() * 1e3 / rounds as f64
}

fn mebibytes(table: &PathTable) -> f64 {
    let bytes = size_of_val(&table.rows[..])
        + size_of_val(&table.pieces[..])
        + size_of_val(&table.first_piece[..]);
    bytes as f64 / f64::from(1 << 20)
}

/// The median time of a frame by the painter of meshes, if there is one.
fn frame_ms(
    growth: &Growth<'_>,
    size: MeshSize,
    table: &PathTable,
) -> Result<Option<f64>, MeasureError> {
    let Some(painter) = growth.painters.iter().find(|painter| painter.draws_mesh()) else {
        return Ok(None);
    };
    let spin = Spin {
        frames: 30,
        seconds: 1.0,
        size: growth.frame(512)?,
        depth_mm: growth.depth_mm,
    };
    let mesh = (size, table.shrink(growth.depth_mm));
    let (rate, _) = timed(|| spin.rate(&Arc::clone(growth.case), painter, Some(&mesh)));
    Ok(Some(rate?.wall_s.median * 1e3))
}
