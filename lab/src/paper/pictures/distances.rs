//! The distance map and the paths of the forest: Figure 3.

use glam::DVec3;
use render::{Frame, Projection, SliceParameters, SlicePlane, SliceRequest};

use super::sheet::Cells;
use super::wireframe::{Drawing, LINE};
use super::{Picture, square};
use crate::{BenchError, PreparedHead};

const CELL: u32 = 240;
/// The distance between the starts of two paths, in pixels.
const APART: u32 = 7;
/// The level of the greatest depth below the paths.
const DIMMED: f32 = 110.0;
const LEVEL: u8 = 5;

/// The distance map on two slices through its maximum, and the paths that start in them, projected onto them.
pub(super) fn figure_3(head: &PreparedHead) -> Result<Picture, BenchError> {
    let grid = head.distance.grid();
    let deepest = grid.voxel(head.distance.deepest());
    let deepest = DVec3::from_array(deepest.map(|place| place as f64));
    let deepest = grid.patient_from_voxel().transform_point3(deepest);
    let mut cells = Vec::new();
    for plane in [SlicePlane::Coronal, SlicePlane::Axial] {
        let request = SliceRequest::new(SliceParameters {
            zoom: 1.0,
            size: square(CELL)?,
            ..SliceParameters::new(plane, deepest[plane.axis()], head.window)
        })?;
        let projection = request.projection(&head.scene().bounds);
        let map = depths(head, projection, 255.0).frame();
        cells.push((format!("a: {}", plane.name()), map));
        cells.push((format!("b: {}", plane.name()), paths(head, projection)));
    }
    Cells::row(cells).picture("figure_3_distances_and_paths", LEVEL)
}

/// The depth at each pixel: black outside, `brightest` at the greatest depth.
fn depths(head: &PreparedHead, projection: Projection, brightest: f32) -> Drawing {
    let field = head.model().field();
    let voxel_from_patient = field.grid().voxel_from_patient();
    let greatest_mm = head.distance.max_depth_mm();
    Drawing::over(projection, |position| {
        let voxel = voxel_from_patient.transform_point3(position);
        if !field.grid().contains(voxel) {
            return 0;
        }
        let depth_mm = field.depth_mm(voxel.as_vec3());
        // The darkest level inside differs from the background.
        let least = 0.15 * f32::from(u8::from(depth_mm >= 0.0));
        (brightest * least.max(depth_mm / greatest_mm)) as u8
    })
}

/// The paths from a lattice of pixels.
fn paths(head: &PreparedHead, projection: Projection) -> Frame {
    let mut drawing = depths(head, projection, DIMMED);
    let grid = head.distance.grid();
    let patient_from_frame = projection.patient_from_frame();
    let place = |index: usize| {
        let voxel = DVec3::from_array(grid.voxel(index).map(|place| place as f64));
        grid.patient_from_voxel().transform_point3(voxel)
    };
    for y in (0..CELL).step_by(APART as usize) {
        for x in (0..CELL).step_by(APART as usize) {
            let start = DVec3::new(f64::from(x), f64::from(y), 0.0);
            let start = patient_from_frame.transform_point3(start);
            let voxel = grid.voxel_from_patient().transform_point3(start).round();
            if !grid.contains(voxel) {
                continue;
            }
            let index = grid.index(voxel.to_array().map(|place| place as usize));
            if !head.distance.inside()[index] {
                continue;
            }
            let way: Vec<DVec3> = head.forest.path(index).map(place).collect();
            for step in way.windows(2) {
                drawing.line_between([step[0], step[1]], LINE);
            }
        }
    }
    drawing.frame()
}
