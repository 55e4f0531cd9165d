//! Compares pictures of meshes with exact ones.

mod figure;

use geometry::PathTable;
use render::conformance::Agreement;
use render::{
    Background, Camera, Frame, FrameSize, NamedView, RenderBackend, RenderParameters,
    RenderRequest, SizedMesh,
};

use crate::{BenchError, PreparedHead};

pub(crate) use figure::means;
pub use figure::{markdown, side_by_side, ten_meshes};

/// Contours and points of the ten meshes of the paper, with 200, 400, 600, 800, 1,800, 2,400, 3,200, 4,000, 6,000 and
/// 8,000 triangles (Figure 7). The paper states only 30 × 30; the other pairs are our choice.
pub const MESH_SIZES: [[usize; 2]; 10] = [
    [10, 10],
    [20, 10],
    [20, 15],
    [20, 20],
    [30, 30],
    [40, 30],
    [40, 40],
    [50, 40],
    [60, 50],
    [80, 50],
];

/// The exact pictures of a depth from all six sides, on a transparent background, as a reference for other pictures.
///
/// # Errors
/// If the depth is out of range.
pub fn exact_pictures(
    head: &PreparedHead,
    depth_mm: f64,
    size: FrameSize,
) -> Result<Vec<(RenderRequest, Frame)>, BenchError> {
    let picture = |view| {
        let request = RenderRequest::new(RenderParameters {
            depth_mm,
            camera: Camera::named(view),
            size,
            look: Background::Transparent.into(),
            ..RenderParameters::new(head.window)
        })?;
        let exact = RenderBackend::Trace.draw(&head.job(request, None))?;
        Ok((request, exact.frame))
    };
    NamedView::ALL.into_iter().map(picture).collect()
}

/// Compares a mesh from a table, drawn on the CPU, with exact pictures of the same requests; all pixels have the same
/// weight.
///
/// # Errors
/// None is known: the CPU can always draw.
///
/// # Panics
/// If a picture has no alpha.
pub fn mesh_against_exact(
    head: &PreparedHead,
    table: &PathTable,
    exact: &[(RenderRequest, Frame)],
) -> Result<Agreement, BenchError> {
    let mut sum = Agreement::default();
    for (request, exact) in exact {
        let mesh = SizedMesh {
            size: table.size,
            mesh: table.shrink(request.parameters().depth_mm as f32),
        };
        let found = RenderBackend::Mesh.draw(&head.job(*request, Some(mesh)))?;
        sum += &Agreement::of(&found.frame, exact);
    }
    Ok(sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ten_meshes_are_those_of_the_paper() {
        let triangles = MESH_SIZES.map(|[contours, points]| 2 * contours * points);
        let paper = [200, 400, 600, 800, 1800, 2400, 3200, 4000, 6000, 8000];
        assert_eq!(triangles, paper);
    }
}
