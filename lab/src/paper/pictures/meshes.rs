//! Meshes as wireframes: Figures 2 and 4.

use geometry::{MeshSize, Paths};
use glam::DVec3;
use render::Frame;

use super::sheet::Cells;
use super::wireframe::{Drawing, Edges};
use super::{Picture, oblique, plain, square};
use crate::paper::sentences::{COARSE_AND_FINE, DEPTHS_MM};
use crate::{BenchError, PreparedHead};

/// Pixels of a cell, and the zoom.
const CELL: u32 = 220;
const ZOOM: f64 = 1.0;
/// The distance of two levels of grey.
const LEVEL: u8 = 17;

/// Sampled contours, their facets, and two sizes of mesh.
pub(super) fn figure_2(head: &PreparedHead) -> Result<Picture, BenchError> {
    let cell = |label: &str, [contours, points]: [usize; 2], edges| {
        let size = MeshSize::new(contours, points)?;
        Ok::<_, BenchError>((label.to_owned(), wires(head, size, 0.0, edges)?))
    };
    let cells = vec![
        cell("a: 8 contours of 30 points", [8, 30], Edges::Contours)?,
        cell("b: their facets", [8, 30], Edges::All)?,
        cell("c: 8 × 8", [8, 8], Edges::All)?,
        cell("d: 80 × 40", [80, 40], Edges::All)?,
    ];
    Cells::row(cells).picture("figure_2_meshes", LEVEL)
}

/// A coarse and a fine mesh at several depths, along the forest.
pub(super) fn figure_4(head: &PreparedHead) -> Result<Picture, BenchError> {
    let mut frames = Vec::new();
    let mut rows = Vec::new();
    for [contours, points] in COARSE_AND_FINE {
        let size = MeshSize::new(contours, points)?;
        rows.push(size.triangle_count().to_string());
        for depth_mm in DEPTHS_MM {
            frames.push(wires(head, size, depth_mm, Edges::All)?);
        }
    }
    let columns = DEPTHS_MM.map(|depth_mm| format!("{depth_mm} mm")).to_vec();
    let cells = Cells {
        rows,
        columns,
        frames,
    };
    cells.picture("figure_4_shrunk_meshes", LEVEL)
}

/// A mesh at a depth, along the paths of the forest.
fn wires(
    head: &PreparedHead,
    size: MeshSize,
    depth_mm: f32,
    edges: Edges,
) -> Result<Frame, BenchError> {
    let table = head
        .model()
        .path_table(size, &head.distance, Paths::Forest(&head.forest))?;
    let positions = table.shrink(depth_mm).positions_in_patient;
    let positions: Vec<DVec3> = positions
        .into_iter()
        .map(|position| glam::Vec3::from_array(position).as_dvec3())
        .collect();
    let request = plain(head, oblique(ZOOM)?, square(CELL)?, 0.0)?;
    let mut drawing = Drawing::new(request.projection(&head.scene()));
    drawing.mesh(size, &positions, edges);
    Ok(drawing.frame())
}
