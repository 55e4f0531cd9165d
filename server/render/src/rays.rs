//! Lines of sight through a grid.

use geometry::Grid;
use glam::{DAffine3, DVec3};

use crate::{FrameSize, MapProjection, Projection};

/// How a picture sees a head.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum View {
    /// All lines of sight are parallel.
    Parallel(Projection),
    /// All lines of sight of a disc end at the centre of a hemisphere.
    Map(MapProjection),
}

impl From<&Projection> for View {
    fn from(projection: &Projection) -> Self {
        Self::Parallel(*projection)
    }
}

impl From<&MapProjection> for View {
    fn from(projection: &MapProjection) -> Self {
        Self::Map(*projection)
    }
}

impl View {
    pub(crate) fn size(&self) -> FrameSize {
        match self {
            Self::Parallel(projection) => projection.size(),
            Self::Map(projection) => projection.size(),
        }
    }
}

/// Maps positions in the frame to voxel coordinates of a grid: each pixel has a line of sight.
///
/// *Heights* count towards the viewer from the plane through the target's centre, in units of `unit_mm`; on a map, from the
/// centre of the hemisphere.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rays {
    corner: [f32; 3],
    per_column: [f32; 3],
    per_row: [f32; 3],
    per_height: [f32; 3],
    /// What the corner, and so each foot, has too much: see [`LATTICE`]; 0 but on a map.
    lattice: f32,
    disc: Option<Disc>,
}

/// Added to a coordinate of up to 1024 voxels and taken away again, it rounds it to a multiple of 2⁻¹².
///
/// Positions on a map are on this lattice. On it the mirrored position is exact, and so is what is interpolated there, so that a
/// mirrored head has the mirrored map to the byte. Elsewhere coordinates are rounded more finely near 0 than far from it.
const LATTICE: f32 = 3072.0;

/// The directions of the lines of sight of a map, which all have their foot at the corner.
#[derive(Debug, Clone, Copy)]
struct Disc {
    centre: [f32; 2],
    units_per_pixel: f32,
    /// Voxel coordinates of a unit of height to the right, up and towards the viewer.
    axes: [[f32; 3]; 3],
}

/// A line of sight, in voxel coordinates.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ray {
    foot: [f32; 3],
    per_height: [f32; 3],
    lattice: f32,
}

impl Rays {
    /// The lines of sight of a picture through `grid`.
    pub(crate) fn new(view: impl Into<View>, grid: &Grid, unit_mm: f64) -> Self {
        Self::through_voxels(view, grid.voxel_from_patient(), unit_mm)
    }

    /// The lines of sight of a picture through voxels with this transform.
    pub(crate) fn through_voxels(
        view: impl Into<View>,
        voxel_from_patient: DAffine3,
        unit_mm: f64,
    ) -> Self {
        match view.into() {
            View::Parallel(projection) => Self::parallel(&projection, voxel_from_patient, unit_mm),
            View::Map(projection) => Self::of_disc(&projection, voxel_from_patient, unit_mm),
        }
    }

    fn of_disc(projection: &MapProjection, voxel_from_patient: DAffine3, unit_mm: f64) -> Self {
        let axes = voxel_from_patient.matrix3 * projection.axes() * unit_mm;
        let [x, y] = projection.centre().map(|place| place as f32);
        let corner = voxel_from_patient.transform_point3(projection.centre_in_patient());
        Self {
            corner: single(corner + f64::from(LATTICE)),
            per_column: [0.0; 3],
            per_row: [0.0; 3],
            per_height: [0.0; 3],
            lattice: LATTICE,
            disc: Some(Disc {
                centre: [x, y],
                units_per_pixel: projection.units_per_pixel() as f32,
                axes: [axes.x_axis, axes.y_axis, axes.z_axis].map(single),
            }),
        }
    }

    fn parallel(projection: &Projection, voxel_from_patient: DAffine3, unit_mm: f64) -> Self {
        let voxel_from_frame = voxel_from_patient
            * projection.patient_from_frame()
            * DAffine3::from_scale(DVec3::new(1.0, 1.0, unit_mm));
        let axes = voxel_from_frame.matrix3;
        Self {
            corner: single(voxel_from_frame.translation),
            per_column: single(axes.x_axis),
            per_row: single(axes.y_axis),
            per_height: single(axes.z_axis),
            lattice: 0.0,
            disc: None,
        }
    }

    /// The line of sight through a place of the picture, in pixels from its top left corner.
    #[inline(always)]
    pub(crate) fn through(&self, x: f32, y: f32) -> Ray {
        if let Some(disc) = &self.disc {
            return Ray {
                foot: self.corner,
                per_height: disc.direction(x, y),
                lattice: self.lattice,
            };
        }
        Ray {
            foot: self.place_on_slice(x, y),
            per_height: self.per_height,
            lattice: self.lattice,
        }
    }

    /// Voxel coordinates of a place of a slice, in pixels from the top left corner of the picture.
    #[inline(always)]
    pub(crate) fn place_on_slice(&self, x: f32, y: f32) -> [f32; 3] {
        debug_assert!(self.disc.is_none(), "a map is no slice");
        std::array::from_fn(|axis| {
            self.corner[axis] + x * self.per_column[axis] + y * self.per_row[axis]
        })
    }

    /// What each foot has too much.
    pub(crate) fn lattice(&self) -> f32 {
        self.lattice
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

impl Disc {
    /// Voxel coordinates of a unit of height at a place of the picture.
    #[inline(always)]
    fn direction(&self, x: f32, y: f32) -> [f32; 3] {
        let right = (x - self.centre[0]) * self.units_per_pixel;
        let up = (self.centre[1] - y) * self.units_per_pixel;
        let squared = right * right + up * up;
        let rest = 1.0 - 0.25 * squared;
        let stretch = (if rest > 0.0 { rest } else { 0.0 }).sqrt();
        let [right, up, towards] = [right * stretch, up * stretch, 1.0 - 0.5 * squared];
        let [along_x, along_y, along_z] = self.axes;
        std::array::from_fn(|axis| {
            right * along_x[axis] + up * along_y[axis] + towards * along_z[axis]
        })
    }
}

impl Ray {
    /// Voxel coordinates at height 0, each with [`Rays::lattice`] too much.
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
            self.foot[0] + height * self.per_height[0] - self.lattice,
            self.foot[1] + height * self.per_height[1] - self.lattice,
            self.foot[2] + height * self.per_height[2] - self.lattice,
        ]
    }
}

/// A vector in the single precision of the pixels.
pub(crate) fn single(vector: DVec3) -> [f32; 3] {
    vector.to_array().map(|coordinate| coordinate as f32)
}
