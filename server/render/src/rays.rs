//! Lines of sight through a grid.

use geometry::Grid;
use glam::{DAffine3, DVec3};

use crate::Projection;

/// Maps positions in the frame to voxel coordinates of a grid: each pixel has a line of sight.
///
/// *Heights* count towards the viewer from the plane through the target's centre, in units of `unit_mm`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rays {
    corner: [f32; 3],
    per_column: [f32; 3],
    per_row: [f32; 3],
    per_height: [f32; 3],
}

/// A line of sight, in voxel coordinates.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ray {
    foot: [f32; 3],
    per_height: [f32; 3],
}

impl Rays {
    /// The lines of sight of a projection through `grid`.
    pub(crate) fn new(projection: &Projection, grid: &Grid, unit_mm: f64) -> Self {
        Self::through_voxels(projection, grid.voxel_from_patient(), unit_mm)
    }

    /// The lines of sight of a projection through voxels with this transform.
    pub(crate) fn through_voxels(
        projection: &Projection,
        voxel_from_patient: DAffine3,
        unit_mm: f64,
    ) -> Self {
        let voxel_from_frame = voxel_from_patient
            * projection.patient_from_frame()
            * DAffine3::from_scale(DVec3::new(1.0, 1.0, unit_mm));
        let axes = voxel_from_frame.matrix3;
        Self {
            corner: single(voxel_from_frame.translation),
            per_column: single(axes.x_axis),
            per_row: single(axes.y_axis),
            per_height: single(axes.z_axis),
        }
    }

    /// The line of sight through a place of the picture, in pixels from its top left corner.
    #[inline(always)]
    pub(crate) fn through(&self, x: f32, y: f32) -> Ray {
        Ray {
            foot: [
                self.corner[0] + x * self.per_column[0] + y * self.per_row[0],
                self.corner[1] + x * self.per_column[1] + y * self.per_row[1],
                self.corner[2] + x * self.per_column[2] + y * self.per_row[2],
            ],
            per_height: self.per_height,
        }
    }

    /// Voxel coordinates of a unit of height: the direction to the viewer.
    #[inline(always)]
    pub(crate) fn towards_viewer(&self) -> [f32; 3] {
        self.per_height
    }

    /// Voxel coordinates of a step of one pixel to the right.
    pub(crate) fn per_pixel_right(&self) -> [f32; 3] {
        self.per_column
    }

    /// Voxel coordinates of a step of one pixel down.
    pub(crate) fn per_pixel_down(&self) -> [f32; 3] {
        self.per_row
    }
}

impl Ray {
    /// Voxel coordinates at height 0.
    #[inline(always)]
    pub(crate) fn foot(&self) -> [f32; 3] {
        self.foot
    }

    /// Voxel coordinates of a unit of height: the direction to the viewer.
    #[inline]
    pub(crate) fn towards_viewer(&self) -> [f32; 3] {
        self.per_height
    }

    /// Voxel coordinates at a height.
    #[inline(always)]
    pub(crate) fn at(&self, height: f32) -> [f32; 3] {
        [
            self.foot[0] + height * self.per_height[0],
            self.foot[1] + height * self.per_height[1],
            self.foot[2] + height * self.per_height[2],
        ]
    }
}

/// A vector in the single precision of the pixels.
pub(crate) fn single(vector: DVec3) -> [f32; 3] {
    vector.to_array().map(|coordinate| coordinate as f32)
}
