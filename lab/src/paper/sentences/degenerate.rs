//! "Some triangles will degenerate to lines as the mesh shrinks" (section 3.2).

use geometry::{MeshSize, Paths, ShrunkMesh};
use glam::Vec3;

use super::{COARSE_AND_FINE, DEPTHS_MM};
use crate::{BenchError, Cell, PreparedHead, Table, column};

/// A triangle of a smaller height counts as a line, in mm.
const LINE_MM: f32 = 0.01;

/// The share of degenerate triangles by depth, along the forest and along the gradient.
pub(super) fn table(head: &PreparedHead) -> Result<Table, BenchError> {
    let columns = [
        column("triangles", "triangles"),
        column("depth_mm", "depth, mm"),
        column("forest", "degenerate, forest"),
        column("forest_share", "share"),
        column("flow", "degenerate, gradient"),
        column("flow_share", "share"),
    ];
    let title = "Figure 4: triangles that degenerate to lines or points";
    let mut table = Table::new("figure_4", title, &columns);
    for [contours, points] in COARSE_AND_FINE {
        let size = MeshSize::new(contours, points)?;
        let [forest, flow] = [Paths::Forest(&head.forest), Paths::Flow]
            .map(|paths| head.model().path_table(size, &head.distance, paths));
        let [forest, flow] = [forest?, flow?];
        for depth_mm in DEPTHS_MM {
            let counts =
                [&forest, &flow].map(|paths| degenerate_count(size, &paths.shrink(depth_mm)));
            let shares = counts.map(|count| count as f64 / size.triangle_count() as f64);
            let [forest, flow] = [0, 1].map(|way| [Cell::from(counts[way]), shares[way].into()]);
            let first = [size.triangle_count().into(), f64::from(depth_mm).into()];
            table.push([first, forest, flow].into_iter().flatten());
        }
    }
    table.note(format!(
        "Degenerate: a height below {LINE_MM} mm. Depths are limited to the greatest one."
    ));
    Ok(table)
}

/// The number of triangles without an area.
pub(in crate::paper) fn degenerate_count(size: MeshSize, mesh: &ShrunkMesh) -> usize {
    let is_line = |facet: &[u32; 3]| {
        let [a, b, c] =
            facet.map(|corner| Vec3::from_array(mesh.positions_in_patient[corner as usize]));
        let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
        (b - a).cross(c - a).length() <= LINE_MM * longest
    };
    size.triangles()
        .iter()
        .filter(|facet| is_line(facet))
        .count()
}
