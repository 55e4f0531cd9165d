//! Pictures of the envelope and of the surface below it: Figures 1 and 8, and the poles.

use geometry::MeshSize;
use glam::{DQuat, DVec3};
use render::{
    Camera, Frame, NamedView, RenderBackend, RenderParameters, RenderRequest, SizedMesh,
    SliceParameters, SlicePlane, SliceRequest, draw_slice,
};

use super::sheet::Cells;
use super::{Picture, drawn, looking_at, oblique, plain, square};
use crate::paper::sentences::busiest_slice;
use crate::{BenchError, PreparedHead};

const CELL: u32 = 190;
const LEVEL: u8 = 8;
/// The meshes of Figure 8, with 400, 2,400 and 8,000 triangles.
const FIGURE_8: [[usize; 2]; 3] = [[20, 10], [40, 30], [80, 50]];
/// The depth of the poles, in mm.
const POLES_MM: f64 = 10.0;
const POLE_CELL: u32 = 256;

/// The envelope from two sides, and the coronal and the axial slice with the most contours.
pub(super) fn figure_1(head: &PreparedHead) -> Result<Picture, BenchError> {
    let from_below = DQuat::from_rotation_x(-0.5) * NamedView::Anterior.orientation();
    let from_below = Camera::new(from_below.to_array(), 1.0, [0.0; 2])?;
    let surface = |camera| {
        let request = plain(head, camera, square(CELL)?, 0.0)?;
        drawn(head, &RenderBackend::Trace, request, None)
    };
    let cells = vec![
        ("a: from the left".to_owned(), surface(oblique(1.0)?)?),
        ("b: from below".to_owned(), surface(from_below)?),
        (
            "c: coronal".to_owned(),
            contours(head, SlicePlane::Coronal)?,
        ),
        ("d: axial".to_owned(), contours(head, SlicePlane::Axial)?),
    ];
    Cells::row(cells).picture("figure_1_envelope", LEVEL)
}

/// The slice with the most contours of the envelope.
fn contours(head: &PreparedHead, plane: SlicePlane) -> Result<Frame, BenchError> {
    let request = SliceRequest::new(SliceParameters {
        depths_mm: vec![0.0],
        zoom: 1.0,
        size: square(CELL)?,
        ..SliceParameters::new(plane, busiest_slice(head, plane), head.window)
    })?;
    Ok(draw_slice(&head.scene(), &request))
}

/// The lowest part of the envelope, by voxels and by three meshes.
pub(super) fn figure_8(head: &PreparedHead) -> Result<Picture, BenchError> {
    let grid = head.distance.grid();
    let place = |voxel: &geometry::ShellVoxel| {
        let voxel = DVec3::from_array(voxel.position().map(f64::from));
        grid.patient_from_voxel().transform_point3(voxel)
    };
    let places = head.model().shell().voxels().iter().map(place);
    let lowest = places.min_by(|a, b| a.z.total_cmp(&b.z));
    let lowest = lowest.unwrap_or_default() + DVec3::Z * 20.0;
    let bounds = head.scene().bounds;
    let camera = Camera::named(NamedView::Left).with_zoom(3.0)?;
    let request = plain(
        head,
        looking_at(camera, &bounds, lowest)?,
        square(CELL)?,
        0.0,
    )?;
    let splat = drawn(head, &RenderBackend::Splat, request, None)?;
    let mut cells = vec![("a: voxels".to_owned(), splat)];
    for (letter, [contours, points]) in ["b", "c", "d"].into_iter().zip(FIGURE_8) {
        let size = MeshSize::new(contours, points)?;
        let (_, table) = head.table(size)?;
        let mesh = SizedMesh {
            size,
            mesh: table.shrink(0.0),
        };
        let label = format!("{letter}: {} triangles", size.triangle_count());
        let frame = drawn(head, &RenderBackend::Mesh, request, Some(mesh))?;
        cells.push((label, frame));
    }
    Cells::row(cells).picture("figure_8_lowest_part", LEVEL)
}

/// The frontal and the occipital pole below the dura.
pub(super) fn poles(head: &PreparedHead) -> Result<Picture, BenchError> {
    let depth_mm = POLES_MM.min(0.5 * f64::from(head.distance.max_depth_mm()));
    let cell = |label: &str, view| {
        let request = RenderRequest::new(RenderParameters {
            depth_mm,
            camera: Camera::named(view).with_zoom(1.3)?,
            size: square(POLE_CELL)?,
            ..RenderParameters::new(head.window)
        })?;
        let frame = drawn(head, &RenderBackend::Trace, request, None)?;
        Ok::<_, BenchError>((label.to_owned(), frame))
    };
    let cells = vec![
        cell("frontal pole", NamedView::Anterior)?,
        cell("occipital pole", NamedView::Posterior)?,
    ];
    Cells::row(cells).picture("poles", LEVEL)
}
