//! A rigid motion about a fixed centre, or an affine transform that began as one, and small steps of it.

use glam::{DAffine3, DMat3, DQuat, DVec3};

/// A transform from positions in the case to positions in the layer, both LPS mm: a rigid motion until a step stretches it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pose {
    rotation: DQuat,
    /// What comes before the rotation: the identity of a rigid motion.
    shape: DMat3,
    /// The image of the centre, relative to the centre.
    shift: DVec3,
    centre: DVec3,
}

/// A small step: a rotation vector in radians, a shift in mm, and a strain, which is zero for a rigid motion.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Motion {
    pub(super) turn: DVec3,
    pub(super) shift: DVec3,
    /// How much longer lengths along the axes become, as fractions.
    pub(super) stretch: DVec3,
    /// The strains between the axes y and z, z and x, x and y.
    pub(super) shear: DVec3,
}

impl Motion {
    fn is_rigid(self) -> bool {
        self.stretch == DVec3::ZERO && self.shear == DVec3::ZERO
    }

    fn strained(self) -> DMat3 {
        let (along, across) = (1.0 + self.stretch, self.shear);
        DMat3::from_cols(
            DVec3::new(along.x, across.z, across.y),
            DVec3::new(across.z, along.y, across.x),
            DVec3::new(across.y, across.x, along.z),
        )
    }
}

impl Pose {
    pub(super) fn identity(centre: DVec3) -> Self {
        Self::new(centre, DQuat::IDENTITY, centre)
    }

    /// The rigid motion that turns about `centre` and carries it to `target`.
    pub(super) fn new(centre: DVec3, rotation: DQuat, target: DVec3) -> Self {
        Self {
            rotation,
            shape: DMat3::IDENTITY,
            shift: target - centre,
            centre,
        }
    }

    /// The composition: the motion first, then this pose.
    pub(super) fn after(self, motion: Motion) -> Self {
        let turn = quaternion(motion.turn);
        let (rotation, shape) = if self.shape == DMat3::IDENTITY && motion.is_rigid() {
            ((self.rotation * turn).normalize(), self.shape)
        } else {
            let shape = self.shape * DMat3::from_quat(turn) * motion.strained();
            (self.rotation, shape)
        };
        Self {
            rotation,
            shape,
            shift: self.shift + self.rotation * (self.shape * motion.shift),
            centre: self.centre,
        }
    }

    /// Linear part and image of the centre: `layer = linear * (case - centre) + target`.
    pub(super) fn parts(self) -> (DMat3, DVec3) {
        let linear = DMat3::from_quat(self.rotation) * self.shape;
        (linear, self.centre + self.shift)
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

    /// The cosine of half the angle of its rotation, 0 to 1.
    pub(super) fn cosine_of_half_turn(self) -> f64 {
        self.rotation.w.abs()
    }

    /// The mean distance between the images of the points of a sphere of `radius_mm` around the centre, under two
    /// rigid poses.
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
