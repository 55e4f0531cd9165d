//! The maps of a case: what they are called, and the places that stand out in them.

use serde::{Deserialize, Serialize};
use strum::{EnumString, IntoStaticStr};

use crate::{Gyrus, PatientSide, QualityState, StandardPosition};

/// A map of the junction of grey and white matter.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, EnumString, IntoStaticStr,
)]
#[strum(serialize_all = "kebab-case")]
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
    /// How much thicker the cortex is than on the other side, as a robust z.
    Thickness,
    /// How much brighter the newest FLAIR among the layers is at and below the junction than around and than on the other side, as
    /// a robust z.
    Flair,
}

impl MapName {
    /// Every map, those for the eye first.
    pub const ALL: [Self; 7] = [
        Self::Blur,
        Self::Thickness,
        Self::Flair,
        Self::Sharpness,
        Self::Asymmetry,
        Self::IntensityAsymmetry,
        Self::Junction,
    ];

    /// Those that are computed from the case alone, and so do not belong to a layer.
    pub const OF_CASE: [Self; 6] = [
        Self::Blur,
        Self::Thickness,
        Self::Sharpness,
        Self::Asymmetry,
        Self::IntensityAsymmetry,
        Self::Junction,
    ];

    /// The name in addresses and JSON.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// The map of a name.
    pub fn from_name(name: &str) -> Option<Self> {
        name.parse().ok()
    }
}

/// A region of the brain.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "kebab-case")]
pub enum BrainRegion {
    /// The cerebrum; everything, if the regions are in doubt.
    Cerebrum,
    /// The cerebellum.
    Cerebellum,
    /// The brain stem below the midbrain.
    BrainStem,
    /// What is no cortex within the cerebrum.
    Deep,
}

impl BrainRegion {
    /// The name in JSON and CSV.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// Whether a score is higher than those of heads without a lesion. The limits belong to the format of the maps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum Unusual {
    /// Above the upper limit.
    Yes,
    /// From the lower limit on.
    Borderline,
    /// Below the lower limit.
    No,
}

impl Unusual {
    /// The name in JSON and CSV.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// The regions of a brain, and whether they are believed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = Regions))]
pub struct RegionFacts {
    /// `ok`; or `review`, if something is unusual: then nothing is taken off, and everything is cerebrum.
    pub state: QualityState,
    /// Why they are not believed, in sentences; empty if the state is `ok`.
    pub reasons: Vec<String>,
    /// The stable codes of the reasons, in the same order.
    pub reason_codes: Vec<String>,
    /// The measurements, also if they are not believed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub numbers: Option<RegionNumbers>,
}

/// The measurements of the regions of a brain.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct RegionNumbers {
    /// The volume of the cerebrum inside the envelope.
    pub cerebrum_ml: f64,
    /// The volume of the cerebellum.
    pub cerebellum_ml: f64,
    /// The volume of the brain stem below its narrowest place.
    pub brain_stem_ml: f64,
    /// The smaller half of the cerebellum over the larger one, by volume.
    pub cerebellum_symmetry: f64,
    /// The smaller half of the cerebrum over the larger one, by volume.
    pub cerebrum_symmetry: f64,
    /// The volume of what is no cortex within the cerebrum: nuclei, the midbrain, edges of ventricles.
    pub deep_ml: f64,
    /// The smaller half of that over the larger one.
    pub deep_symmetry: f64,
    /// The cross-section of the brain stem where it is narrowest.
    pub neck_cm2: f64,
    /// The cross-section of the pons.
    pub pons_cm2: f64,
    /// The share of the border between cerebrum and cerebellum that is as bright as white matter.
    pub bright_share: f64,
    /// The share of the sheet between the hemispheres that lies in a fissure.
    pub fissure_share: f64,
}

/// A place at which the junction is less sharp than around it and on the other side, or the cortex thicker than on the other
/// side. Most such places are normal.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = Candidate))]
pub struct CandidateFacts {
    /// LPS mm.
    pub position_in_patient: [f64; 3],
    /// Below the envelope; null where a face of the volume that cuts the brain is nearer than the dura may be.
    pub depth_mm: Option<f32>,
    /// On which side of the plane between the hemispheres.
    pub side: PatientSide,
    /// The smoothed map there, as a robust z of this head's junction.
    pub score: f32,
    /// Diameter of a ball with the volume of the connected part of the junction above half of the score.
    pub size_mm: f32,
    /// In which region of the brain.
    pub region: BrainRegion,
    /// Whether the score is higher than those of heads without a lesion; absent if no limit is known for the map.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unusual: Option<Unusual>,
    /// About which gyrus it is in, from an atlas; absent if there is no atlas, or the head does not surely fit it. It is not
    /// stored with the maps.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(value_type = Option<String>))]
    pub gyrus: Option<Gyrus>,
    /// About where it is in other heads; absent where nothing is known. It is not stored with the maps.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub standard: Option<StandardPosition>,
}

impl CandidateFacts {
    /// Whether its score is unusual. A borderline place does not stand out: most heads without a lesion have one.
    pub fn stands_out(&self) -> bool {
        self.unusual == Some(Unusual::Yes)
    }
}

/// How slantwise the isosurfaces between two depths meet the junction of grey and white matter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = JunctionBand))]
pub struct JunctionBandFacts {
    /// The shallower border of the band.
    pub from_mm: f32,
    /// The deeper border of the band; absent for the deepest one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub to_mm: Option<f32>,
    /// Number of places of the junction of the cerebrum that were looked at.
    pub places: u32,
    /// The share of them that the isosurface meets at less than 30°, 0 to 1. There, a sharp junction looks blurred.
    pub slanted_share: f32,
}

impl JunctionBandFacts {
    /// The share of the junction that the isosurfaces of some bands meet at less than 30°, or that lies in the deepest band.
    /// `None` if there are no places.
    pub fn poorly_met_share(bands: &[Self]) -> Option<f32> {
        let places: u32 = bands.iter().map(|band| band.places).sum();
        let poorly_met = bands.iter().map(|band| match band.to_mm {
            Some(_) => band.slanted_share * band.places as f32,
            None => band.places as f32,
        });
        (places > 0).then(|| poorly_met.sum::<f32>() / places as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slanted_places_and_all_deep_ones_are_poorly_met() {
        let band = |to_mm, places, slanted_share| JunctionBandFacts {
            from_mm: 3.0,
            to_mm,
            places,
            slanted_share,
        };
        let bands = [band(Some(30.0), 600, 0.2), band(None, 200, 0.1)];
        assert_eq!(JunctionBandFacts::poorly_met_share(&bands), Some(0.4));
        assert_eq!(JunctionBandFacts::poorly_met_share(&[]), None);
        assert_eq!(
            JunctionBandFacts::poorly_met_share(&[band(None, 0, 0.0)]),
            None
        );
    }

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
