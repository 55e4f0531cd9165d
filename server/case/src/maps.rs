//! The maps of a case: what they are called, and the places that stand out in them.

use serde::{Deserialize, Serialize};

/// A map of the junction of grey and white matter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "kebab-case")]
pub enum MapName {
    /// How much less sharp the junction is than around it and on the other side, as a robust z.
    Blur,
    /// Sharpness of the junction, per mm.
    Sharpness,
    /// Sharpness against the other side, as a robust z: negative if the own side is less sharp.
    Asymmetry,
    /// Intensity against the other side, as a robust z.
    IntensityAsymmetry,
    /// Density of voxels between grey and white matter, 0 to 1.
    Junction,
}

impl MapName {
    /// Every map, those for the eye first.
    pub const ALL: [Self; 5] = [
        Self::Blur,
        Self::Sharpness,
        Self::Asymmetry,
        Self::IntensityAsymmetry,
        Self::Junction,
    ];

    /// The name in addresses and JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Blur => "blur",
            Self::Sharpness => "sharpness",
            Self::Asymmetry => "asymmetry",
            Self::IntensityAsymmetry => "intensity-asymmetry",
            Self::Junction => "junction",
        }
    }

    /// The map of a name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|map| map.name() == name)
    }
}

/// A side of the patient.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum PatientSide {
    /// The patient's left.
    Left,
    /// The patient's right.
    Right,
    /// Within 5 mm of the plane between the hemispheres.
    Middle,
}

impl PatientSide {
    /// The name in JSON and CSV.
    pub fn name(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
            Self::Middle => "middle",
        }
    }
}

/// A place at which the junction is less sharp than around it and on the other side. Most such places are normal.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = Candidate))]
pub struct CandidateFacts {
    /// LPS mm.
    pub position_in_patient: [f64; 3],
    /// Below the envelope.
    pub depth_mm: f32,
    /// On which side of the plane between the hemispheres.
    pub side: PatientSide,
    /// The smoothed `blur` there, as a robust z of this head's junction.
    pub score: f32,
    /// Diameter of a ball with the volume of the connected part of the junction above half of the score.
    pub size_mm: f32,
}

/// How slantwise the isosurfaces between two depths meet the junction of grey and white matter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = JunctionBand))]
pub struct JunctionBandFacts {
    /// The shallower border of the band.
    pub from_mm: f32,
    /// The deeper border of the band.
    pub to_mm: f32,
    /// Number of places of the junction that were looked at.
    pub places: u32,
    /// The share of them that the isosurface meets at less than 30°, 0 to 1. There, a sharp junction looks blurred.
    pub slanted_share: f32,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_of_the_json() {
        for map in MapName::ALL {
            let json = serde_json::to_value(map).unwrap();
            assert_eq!(json, map.name());
            assert_eq!(MapName::from_name(map.name()), Some(map));
        }
        assert_eq!(MapName::from_name("Blur"), None);
    }
}
