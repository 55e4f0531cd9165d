//! The known part of an isosurface: beside a face of the volume that cuts the head, it is unknown.

use geometry::{Cut, DepthField};

use crate::points::PointRow;
use crate::rays::{Rays, single};

/// The greatest number of faces that cut a head.
pub(crate) const MOST_CUTS: usize = 6;

/// A plane in voxel coordinates of the depth field: positions with a negative value are unknown.
pub(crate) type CutPlane = [f32; 4];

/// The planes behind which the isosurface at a depth is unknown, in mm.
pub(crate) fn cut_planes(field: &DepthField, depth_mm: f64) -> Vec<CutPlane> {
    let voxel_mm = f64::from(field.spacing_mm());
    let origin = field.grid().patient_from_voxel().translation;
    let least_mm = Cut::least_distance_mm(depth_mm, voxel_mm);
    let plane = |cut: &Cut| {
        let [x, y, z] = single(cut.inward * voxel_mm);
        [x, y, z, (cut.distance_mm(origin) - least_mm) as f32]
    };
    field.cuts().iter().map(plane).collect()
}

/// Removes the unknown points from a row of pixels.
pub(crate) fn leave_bare(planes: &[CutPlane], rays: &Rays, row: usize, points: &mut PointRow) {
    if planes.is_empty() {
        return;
    }
    for (column, height) in points.heights.iter_mut().enumerate() {
        let place = rays
            .through(column as f32 + 0.5, row as f32 + 0.5)
            .at(*height);
        if height.is_finite() && deepest_known_mm(planes, place) < 0.0 {
            *height = f32::NEG_INFINITY;
        }
    }
}

/// How much deeper than the depth of the [`cut_planes`] the isosurface is known at a place in voxel coordinates of the
/// depth field, in mm. Negative: at that depth it is unknown.
pub(crate) fn deepest_known_mm(planes: &[CutPlane], [x, y, z]: [f32; 3]) -> f32 {
    let distances = planes.iter().map(|[along_x, along_y, along_z, offset]| {
        along_x * x + along_y * y + along_z * z + offset
    });
    distances.fold(f32::INFINITY, f32::min)
}
