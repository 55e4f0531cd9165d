//! An orthographic camera around the centre of the envelope.

use geometry::BoundingSphere;
use glam::{DAffine3, DMat3, DQuat, DVec3};
use strum::IntoStaticStr;

use crate::error::checked;
use crate::{FrameSize, RenderError};

/// A standard direction from which the head is seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[cfg_attr(feature = "openapi", schema(as = View))]
pub enum NamedView {
    /// The patient's left side: anterior at the left of the picture, superior up.
    Left,
    /// The patient's right side: anterior at the right of the picture, superior up.
    Right,
    /// Facing the patient, whose left is at the right of the picture; superior up.
    Anterior,
    /// From behind: the patient's left is at the left of the picture; superior up.
    Posterior,
    /// From above: the patient's left is at the left of the picture; anterior up.
    Superior,
    /// From below: the patient's left is at the right of the picture; anterior up.
    Inferior,
    /// The inner side of the left hemisphere, as seen from the right: for the surface `left` alone.
    MesialLeft,
    /// The inner side of the right hemisphere, as seen from the left: for the surface `right` alone.
    MesialRight,
}

impl NamedView {
    /// Those of every surface.
    pub const ALL: [Self; 6] = [
        Self::Left,
        Self::Right,
        Self::Anterior,
        Self::Posterior,
        Self::Superior,
        Self::Inferior,
    ];

    /// The inner sides of the hemispheres, which only their own surfaces have.
    pub const MESIAL: [Self; 2] = [Self::MesialLeft, Self::MesialRight];

    /// The name in the interfaces: `left`, `right`, `anterior`, `posterior`, `superior`, `inferior`, `mesial-left`,
    /// `mesial-right`.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// The rotation from patient to view space.
    pub fn orientation(self) -> DQuat {
        let (up, towards_viewer) = match self {
            Self::Left | Self::MesialRight => (DVec3::Z, DVec3::X),
            Self::Right | Self::MesialLeft => (DVec3::Z, DVec3::NEG_X),
            Self::Anterior => (DVec3::Z, DVec3::NEG_Y),
            Self::Posterior => (DVec3::Z, DVec3::Y),
            Self::Superior => (DVec3::NEG_Y, DVec3::Z),
            Self::Inferior => (DVec3::NEG_Y, DVec3::NEG_Z),
        };
        let patient_from_view = DMat3::from_cols(up.cross(towards_viewer), up, towards_viewer);
        DQuat::from_mat3(&patient_from_view.transpose())
    }
}

/// An orthographic camera that looks at the centre of the envelope.
///
/// Invariants: `orientation` is a unit quaternion, `zoom` in 0.01..=100, each `pan_mm` within ±10,000.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    orientation: DQuat,
    zoom: f64,
    pan_mm: [f64; 2],
}

impl Camera {
    /// A camera that rotates patient space into view space by the quaternion `[x, y, z, w]`, which is normalised.
    ///
    /// `zoom` 1 fits the envelope's bounding sphere into the smaller side of the picture. `pan_mm` moves the head to
    /// the right of the picture and up.
    ///
    /// # Errors
    /// If a number is not finite or out of its range: the quaternion's length must be in 0.001..=1000.
    pub fn new(orientation: [f64; 4], zoom: f64, pan_mm: [f64; 2]) -> Result<Self, RenderError> {
        let orientation = DQuat::from_array(orientation);
        let length = orientation.length();
        checked(
            "orientation",
            length,
            1e-3..=1e3,
            "a quaternion x,y,z,w of length 1",
        )?;
        Self {
            orientation: orientation / length,
            zoom: 1.0,
            pan_mm: [0.0; 2],
        }
        .with_zoom(zoom)?
        .with_pan_mm(pan_mm)
    }

    /// The camera of a standard direction: zoom 1, centred.
    pub fn named(view: NamedView) -> Self {
        Self {
            orientation: view.orientation(),
            zoom: 1.0,
            pan_mm: [0.0; 2],
        }
    }

    /// The same camera at another zoom.
    ///
    /// # Errors
    /// If `zoom` is not in 0.01..=100.
    pub fn with_zoom(self, zoom: f64) -> Result<Self, RenderError> {
        let zoom = checked("zoom", zoom, 0.01..=100.0, "within 0.01 to 100")?;
        Ok(Self { zoom, ..self })
    }

    /// The same camera with the head moved to the right of the picture and up.
    ///
    /// # Errors
    /// If one of `pan_mm` is not within ±10,000.
    pub fn with_pan_mm(self, pan_mm: [f64; 2]) -> Result<Self, RenderError> {
        for pan in pan_mm {
            checked("pan", pan, -1e4..=1e4, "within -10000 to 10000")?;
        }
        Ok(Self { pan_mm, ..self })
    }

    /// The same from a named direction.
    #[must_use]
    pub fn turned_to(self, view: NamedView) -> Self {
        Self {
            orientation: view.orientation(),
            ..self
        }
    }

    /// The same with a unit quaternion from patient to view space.
    pub(crate) fn oriented(self, orientation: DQuat) -> Self {
        Self {
            orientation,
            ..self
        }
    }

    /// The unit quaternion from patient to view space.
    pub fn orientation(&self) -> DQuat {
        self.orientation
    }

    /// The magnification relative to a fit into the picture.
    pub fn zoom(&self) -> f64 {
        self.zoom
    }

    /// How far the head is moved to the right of the picture and up, in mm.
    pub fn pan_mm(&self) -> [f64; 2] {
        self.pan_mm
    }

    /// The projection of the sphere `target` into a picture.
    pub fn projection(&self, target: &BoundingSphere, size: FrameSize) -> Projection {
        let smaller_side = f64::from(size.width().min(size.height()));
        Projection {
            size,
            mm_per_pixel: 2.0 * target.radius_mm / (self.zoom * smaller_side),
            patient_from_view: DMat3::from_quat(self.orientation).transpose(),
            centre_in_patient: target.centre_in_patient,
            pan_mm: self.pan_mm,
        }
    }
}

/// An orthographic projection between the patient and the pixels of a picture.
///
/// *Frame space* has x in pixels to the right and y in pixels down, both from the picture's top left corner, so that
/// the centre of pixel (0, 0) is at (0.5, 0.5), and z in mm towards the viewer from the plane through the target's
/// centre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Projection {
    size: FrameSize,
    mm_per_pixel: f64,
    patient_from_view: DMat3,
    centre_in_patient: DVec3,
    pan_mm: [f64; 2],
}

impl Projection {
    /// The picture's size.
    pub fn size(&self) -> FrameSize {
        self.size
    }

    /// Edge length of a pixel in mm.
    pub fn mm_per_pixel(&self) -> f64 {
        self.mm_per_pixel
    }

    /// The unit vector towards the viewer, in patient space.
    pub fn towards_viewer_in_patient(&self) -> DVec3 {
        self.patient_from_view.z_axis
    }

    /// The affine from frame space to LPS mm.
    pub fn patient_from_frame(&self) -> DAffine3 {
        let [right, up, towards_viewer] = [
            self.patient_from_view.x_axis,
            self.patient_from_view.y_axis,
            self.patient_from_view.z_axis,
        ];
        let half_width_mm = 0.5 * f64::from(self.size.width()) * self.mm_per_pixel;
        let half_height_mm = 0.5 * f64::from(self.size.height()) * self.mm_per_pixel;
        let top_left = self.centre_in_patient - right * (half_width_mm + self.pan_mm[0])
            + up * (half_height_mm - self.pan_mm[1]);
        DAffine3 {
            matrix3: DMat3::from_cols(
                right * self.mm_per_pixel,
                -up * self.mm_per_pixel,
                towards_viewer,
            ),
            translation: top_left,
        }
    }

    /// The affine from LPS mm to frame space.
    pub fn frame_from_patient(&self) -> DAffine3 {
        self.patient_from_frame().inverse()
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    /// A sphere of radius 100 mm about (10, 20, 30): a picture of 200 × 100 pixels has 2 mm pixels.
    fn project(camera: Camera, position_in_patient: [f64; 3]) -> [f64; 3] {
        let target = BoundingSphere {
            centre_in_patient: DVec3::new(10.0, 20.0, 30.0),
            radius_mm: 100.0,
        };
        let projection = camera.projection(&target, FrameSize::new(200, 100).unwrap());
        projection
            .frame_from_patient()
            .transform_point3(DVec3::from(position_in_patient))
            .to_array()
            .map(|coordinate| (coordinate * 1e9).round() / 1e9)
    }

    #[test]
    fn the_target_is_at_the_centre_of_the_picture() {
        for view in NamedView::ALL {
            assert_eq!(
                project(Camera::named(view), [10.0, 20.0, 30.0]),
                [100.0, 50.0, 0.0]
            );
        }
    }

    #[test]
    fn a_point_lands_where_the_view_puts_it() {
        // 40 mm to the patient's left, 10 mm to posterior, 20 mm to superior of the target.
        let point = [50.0, 30.0, 50.0];
        let expected = [
            (NamedView::Left, [105.0, 40.0, 40.0]),
            (NamedView::Right, [95.0, 40.0, -40.0]),
            (NamedView::Anterior, [120.0, 40.0, -10.0]),
            (NamedView::Posterior, [80.0, 40.0, 10.0]),
            (NamedView::Superior, [80.0, 55.0, 20.0]),
            (NamedView::Inferior, [120.0, 55.0, -20.0]),
            // The inner side of a hemisphere is seen from the other one.
            (NamedView::MesialLeft, [95.0, 40.0, -40.0]),
            (NamedView::MesialRight, [105.0, 40.0, 40.0]),
        ];
        for (view, frame) in expected {
            assert_eq!(project(Camera::named(view), point), frame, "{view:?}");
        }
    }

    #[test]
    fn zoom_enlarges_about_the_centre_and_pan_moves_right_and_up() {
        let camera = Camera::named(NamedView::Anterior).with_zoom(4.0).unwrap();
        assert_eq!(
            project(camera, [50.0, 20.0, 50.0]),
            [180.0, 10.0, 0.0],
            "0.5 mm pixels"
        );
        let camera = camera.with_pan_mm([5.0, 10.0]).unwrap();
        assert_eq!(project(camera, [10.0, 20.0, 30.0]), [110.0, 30.0, 0.0]);
    }

    #[test]
    fn the_identity_looks_from_the_head_down_with_posterior_up() {
        let camera = Camera::new([0.0, 0.0, 0.0, 1.0], 1.0, [0.0; 2]).unwrap();
        assert_eq!(project(camera, [14.0, 26.0, 31.0]), [102.0, 47.0, 1.0]);
    }

    #[test]
    fn a_quaternion_need_not_have_unit_length() {
        let half_turn = Camera::new([0.0, 0.0, 3.0, 0.0], 1.0, [0.0; 2]).unwrap();
        assert_eq!(
            half_turn.orientation(),
            DQuat::from_xyzw(0.0, 0.0, 1.0, 0.0)
        );
    }

    #[test]
    fn the_top_left_pixel_has_its_centre_half_a_pixel_from_the_corner() {
        let target = BoundingSphere {
            centre_in_patient: DVec3::ZERO,
            radius_mm: 2.0,
        };
        let projection =
            Camera::named(NamedView::Anterior).projection(&target, FrameSize::new(4, 4).unwrap());
        let position = projection
            .patient_from_frame()
            .transform_point3(DVec3::new(0.5, 0.5, 1.0));
        assert!((position - DVec3::new(-1.5, -1.0, 1.5)).length() < 1e-12);
    }

    #[test]
    fn what_is_no_camera_is_refused() {
        let nan = f64::NAN;
        for orientation in [
            [0.0; 4],
            [nan, 0.0, 0.0, 1.0],
            [f64::INFINITY, 0.0, 0.0, 0.0],
        ] {
            assert!(Camera::new(orientation, 1.0, [0.0; 2]).is_err());
        }
        let identity = [0.0, 0.0, 0.0, 1.0];
        for zoom in [0.0, -1.0, nan, f64::INFINITY] {
            assert!(Camera::new(identity, zoom, [0.0; 2]).is_err());
        }
        for pan in [[nan, 0.0], [0.0, 1e9]] {
            assert!(Camera::new(identity, 1.0, pan).is_err());
        }
    }

    #[test]
    fn views_have_different_names() {
        let all = NamedView::ALL.into_iter().chain(NamedView::MESIAL);
        let names: HashSet<&str> = all.map(NamedView::name).collect();
        assert_eq!(names.len(), 8);
    }
}
