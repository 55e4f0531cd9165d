//! The sides of the patient.

use serde::{Deserialize, Serialize};

/// A side of the patient.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
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

impl PatientSide {
    /// The name in JSON and CSV.
    pub fn name(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
            Self::Middle => "middle",
            Self::Unknown => "unknown",
        }
    }
}
