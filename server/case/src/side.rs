//! The sides of the patient.

use serde::{Deserialize, Serialize};
use strum::IntoStaticStr;

/// A side of the patient.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum PatientSide {
    /// The patient's left.
    Left,
    /// The patient's right.
    Right,
    /// Within 5 mm of the plane between the hemispheres.
    Middle,
    /// That plane is in doubt: in half a brain, it lies within that half.
    Unknown,
}

/// How near to the plane between the hemispheres a position is on neither side, in mm: too near to be told by a flat plane.
const MIDDLE_MM: f64 = 5.0;

impl PatientSide {
    /// The side of a position that is so far from the plane between the hemispheres, to the patient's left.
    pub fn at(left_mm: f64) -> Self {
        if left_mm.abs() <= MIDDLE_MM {
            Self::Middle
        } else if left_mm > 0.0 {
            Self::Left
        } else {
            Self::Right
        }
    }

    /// The name in JSON and CSV.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

#[cfg(test)]
mod tests {
    use super::PatientSide::{self, Left, Middle, Right};

    #[test]
    fn a_place_within_5_mm_of_the_plane_is_on_neither_side() {
        let sides = [5.01, 5.0, 0.0, -5.0, -5.01].map(PatientSide::at);
        assert_eq!(sides, [Left, Middle, Middle, Middle, Right]);
    }
}
