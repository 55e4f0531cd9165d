//! Slices through a point in any direction.

use glam::{DMat3, DQuat, DVec3};

use super::SliceConvention;
use crate::RenderError;
use crate::error::checked;

/// The least part of the superior direction that must lie in a plane for it to be up: 30° from axial, and more.
const UPRIGHT: f64 = 0.5;

/// The standard planes across the patient axes L, P and S, as they are named in a picture.
const PLANES: [&str; 3] = ["sag", "cor", "ax"];

/// The least angle that is named, in degrees: it would be written as 1.
const LEAST_DEGREES: f64 = 0.5;

/// A plane through a point of the patient, in any direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Oblique {
    centre_in_patient: DVec3,
    normal: DVec3,
}

impl Oblique {
    /// The plane across `normal`, of any length, through a point (LPS mm).
    ///
    /// # Errors
    /// If the coordinates are not within ±10,000, or the normal has no direction.
    pub fn new(centre_in_patient: [f64; 3], normal: [f64; 3]) -> Result<Self, RenderError> {
        for mm in centre_in_patient {
            checked("position", mm, -1e4..=1e4, "within -10000 to 10000")?;
        }
        let normal = DVec3::from_array(normal);
        let length = normal.length();
        checked("normal", length, 1e-3..=1e6, "a direction x,y,z (LPS)")?;
        Ok(Self {
            centre_in_patient: DVec3::from_array(centre_in_patient),
            normal: normal / length,
        })
    }

    /// The point (LPS mm), which is in the middle of a picture without `pan`.
    pub fn centre_in_patient(&self) -> DVec3 {
        self.centre_in_patient
    }

    /// The unit normal (LPS); its sign does not matter.
    pub fn normal(&self) -> DVec3 {
        self.normal
    }

    /// The rotation from patient to view space. A standard plane is shown as the slice of that name is.
    ///
    /// Superior is up, or anterior within 30° of an axial plane. Of the two sides it is seen from the one that shows the patient's
    /// left on the side of the convention, or if the picture rather shows anterior and posterior, anterior at the left.
    pub fn orientation(&self, convention: SliceConvention) -> DQuat {
        let is_upright = self.normal.z.powi(2) <= 1.0 - UPRIGHT * UPRIGHT;
        let up = if is_upright { DVec3::Z } else { DVec3::NEG_Y };
        let up = up.reject_from_normalized(self.normal).normalize();
        let right = up.cross(self.normal);
        let is_left_at_right = match right.x.abs() >= right.y.abs() {
            true => (right.x > 0.0) == (convention == SliceConvention::Radiological),
            false => right.y > 0.0,
        };
        let towards_viewer = if is_left_at_right {
            self.normal
        } else {
            -self.normal
        };
        let patient_from_view = DMat3::from_cols(up.cross(towards_viewer), up, towards_viewer);
        DQuat::from_mat3(&patient_from_view.transpose())
    }

    /// The nearest standard plane and by how many degrees it is turned towards the second and the third one, such as
    /// `cor > sag 32° > ax -10°`. Planes with equal angles are the same.
    pub fn angles(&self) -> String {
        let mut axes = [0, 1, 2];
        axes.sort_by(|&a, &b| self.normal[b].abs().total_cmp(&self.normal[a].abs()));
        let [first, second, third] = axes;
        let normal = self.normal * self.normal[first].signum();
        let turns = [
            (second, normal[second].atan2(normal[first])),
            (third, normal[third].clamp(-1.0, 1.0).asin()),
        ];
        let mut text = PLANES[first].to_owned();
        for (axis, angle) in turns {
            let degrees = angle.to_degrees();
            if degrees.abs() >= LEAST_DEGREES {
                text += &format!(" > {} {degrees:.0}°", PLANES[axis]);
            }
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{SlicePlane, edge_letters};

    fn oblique(normal: [f64; 3]) -> Oblique {
        Oblique::new([1.0, 2.0, 3.0], normal).unwrap()
    }

    #[test]
    fn a_standard_plane_is_shown_as_its_slice_from_both_normals() {
        for convention in [SliceConvention::Radiological, SliceConvention::Neurological] {
            for plane in SlicePlane::ALL {
                for sign in [1.0, -1.0] {
                    let mut normal = [0.0; 3];
                    normal[plane.axis()] = 2.5 * sign;
                    let shown = oblique(normal).orientation(convention);
                    let expected = plane.view(convention).orientation();
                    assert_eq!(edge_letters(shown), edge_letters(expected), "{plane:?}");
                    assert!(shown.dot(expected).abs() > 1.0 - 1e-12, "{plane:?}");
                }
            }
        }
    }

    #[test]
    fn angles_name_the_nearest_plane_and_its_turns() {
        let turned = |degrees: f64| degrees.to_radians().sin_cos();
        let (sin, cos) = turned(32.0);
        assert_eq!(oblique([0.0, 1.0, 0.0]).angles(), "cor");
        assert_eq!(oblique([sin, cos, 0.0]).angles(), "cor > sag 32°");
        assert_eq!(oblique([-sin, -cos, 0.0]).angles(), "cor > sag 32°");
        assert_eq!(oblique([-sin, cos, 0.0]).angles(), "cor > sag -32°");
        let (up, flat) = turned(10.0);
        let both = oblique([sin * flat, cos * flat, up]);
        assert_eq!(both.angles(), "cor > sag 32° > ax 10°");
    }

    #[test]
    fn what_is_no_plane_is_refused() {
        for (centre, normal) in [
            ([f64::NAN, 0.0, 0.0], [1.0, 0.0, 0.0]),
            ([2e4, 0.0, 0.0], [1.0, 0.0, 0.0]),
            ([0.0; 3], [0.0; 3]),
            ([0.0; 3], [f64::INFINITY, 0.0, 0.0]),
            ([0.0; 3], [f64::NAN, 1.0, 0.0]),
        ] {
            assert!(Oblique::new(centre, normal).is_err());
        }
    }
}
