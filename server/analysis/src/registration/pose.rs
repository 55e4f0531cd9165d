//! A rigid motion about a fixed centre, and small steps of it.

use glam::{DAffine3, DMat3, DQuat, DVec3};

/// A rigid motion from positions in the case to positions in the layer, both LPS mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pose {
    rotation: DQuat,
    /// The image of the centre, relative to the centre.
    shift: DVec3,
    centre: DVec3,
}

/// A small rigid motion: a rotation vector in radians and a shift in mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Motion {
    pub(super) turn: DVec3,
    pub(super) shift: DVec3,
}

impl Pose {
    pub(super) fn identity(centre: DVec3) -> Self {
        Self {
            rotation: DQuat::IDENTITY,
            shift: DVec3::ZERO,
            centre,
        }
    }

    /// The composition: the motion first, then this pose.
    pub(super) fn after(self, motion: Motion) -> Self {
        Self {
            rotation: (self.rotation * quaternion(motion.turn)).normalize(),
            shift: self.shift + self.rotation * motion.shift,
            centre: self.centre,
        }
    }

    /// Linear part and image of the centre: `layer = linear * (case - centre) + target`.
    pub(super) fn parts(self) -> (DMat3, DVec3) {
        (DMat3::from_quat(self.rotation), self.centre + self.shift)
    }

    pub(super) fn layer_from_case(self) -> DAffine3 {
        let (linear, target) = self.parts();
        DAffine3 {
            matrix3: linear,
            translation: target - linear * self.centre,
        }
    }

    pub(super) fn case_from_layer(self) -> DAffine3 {
        self.layer_from_case().inverse()
    }

    /// The mean distance between the images of the points of a sphere of `radius_mm` around the centre, under two
    /// poses.
    pub(super) fn distance_mm(self, other: Self, radius_mm: f64) -> f64 {
        let apart = (self.rotation.inverse() * other.rotation).normalize();
        let half_sine = apart.xyz().length();
        let shift = self.shift.distance(other.shift);
        // A turn by an angle moves a point of the sphere by 2 sin(angle/2) times its distance from the axis: √(2/3) of
        // the radius.
        shift.hypot(2.0 * half_sine * radius_mm * (2.0f64 / 3.0).sqrt())
    }
}

/// The rotation of a rotation vector, to third order: Cayley's map, which needs only a square root.
fn quaternion(turn: DVec3) -> DQuat {
    let half = turn / 2.0;
    DQuat::from_xyzw(half.x, half.y, half.z, 1.0).normalize()
}
