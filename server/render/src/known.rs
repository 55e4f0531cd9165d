//! The known part of an isosurface: beside a face of the volume that cuts the head, and beside a fence, it is unknown.

use geometry::{Cut, DepthField, Fenced};

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

/// The known part of the isosurface at a depth.
#[derive(Debug)]
pub(crate) struct Known<'a> {
    planes: Vec<CutPlane>,
    fenced: Option<&'a Fenced>,
}

impl<'a> Known<'a> {
    pub(crate) fn new(field: &'a DepthField, depth_mm: f64) -> Self {
        Self {
            planes: cut_planes(field, depth_mm),
            fenced: field.fenced(),
        }
    }

    /// Removes the unknown points from a row of pixels.
    pub(crate) fn leave_bare(&self, rays: &Rays, row: usize, points: &mut PointRow) {
        if self.planes.is_empty() && self.fenced.is_none() {
            return;
        }
        let is_unknown = |place: [f32; 3]| {
            deepest_known_mm(&self.planes, place) < 0.0
                || self.fenced.is_some_and(|fenced| fenced.covers(place))
        };
        for (column, height) in points.heights.iter_mut().enumerate() {
            let place = rays
                .through(column as f32 + 0.5, row as f32 + 0.5)
                .at(*height);
            if height.is_finite() && is_unknown(place) {
                *height = f32::NEG_INFINITY;
            }
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
