//! What voxels of a case have values of.

use serde::{Deserialize, Serialize};
use strum::IntoStaticStr;

use crate::MapName;

/// What the voxels of a case have values of, for programs that read volumes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "kebab-case")]
pub enum VoxelValues {
    /// The brain before closing: 1 inside, otherwise 0.
    Brain,
    /// The depth below the envelope in mm; NaN outside, and where it is unknown.
    Depth,
    /// The side of the plane between the hemispheres, within the envelope: 1 left, 2 right, 3 within 5 mm of the plane, 4 unknown.
    Sides,
    /// The regions: 1 left and 2 right cerebrum, 3 cerebellum, 4 brain stem, 5 left and 6 right deep (no cortex). If they are in doubt,
    /// everything is cerebrum.
    Regions,
    /// The map `blur`.
    Blur,
    /// The map `thickness`.
    Thickness,
    /// The map of the newest FLAIR among the layers.
    Flair,
    /// The map `sharpness`.
    Sharpness,
    /// The map `asymmetry`.
    Asymmetry,
    /// The map `intensity-asymmetry`.
    IntensityAsymmetry,
    /// The map `junction`.
    Junction,
    /// The rank of the place there in the list of blurred places of the cerebrum: a ball of its size.
    BlurPlaces,
    /// The same of thick places.
    ThicknessPlaces,
    /// The same of places that are bright in the newest FLAIR.
    FlairPlaces,
}

impl VoxelValues {
    /// All of them.
    pub const ALL: [Self; 14] = [
        Self::Brain,
        Self::Depth,
        Self::Sides,
        Self::Regions,
        Self::Blur,
        Self::Thickness,
        Self::Flair,
        Self::Sharpness,
        Self::Asymmetry,
        Self::IntensityAsymmetry,
        Self::Junction,
        Self::BlurPlaces,
        Self::ThicknessPlaces,
        Self::FlairPlaces,
    ];

    /// The name in addresses and of files.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// The map that they are the values or the places of.
    pub fn map(self) -> Option<MapName> {
        match self {
            Self::Brain | Self::Depth | Self::Sides | Self::Regions => None,
            Self::Blur | Self::BlurPlaces => Some(MapName::Blur),
            Self::Thickness | Self::ThicknessPlaces => Some(MapName::Thickness),
            Self::Flair | Self::FlairPlaces => Some(MapName::Flair),
            Self::Sharpness => Some(MapName::Sharpness),
            Self::Asymmetry => Some(MapName::Asymmetry),
            Self::IntensityAsymmetry => Some(MapName::IntensityAsymmetry),
            Self::Junction => Some(MapName::Junction),
        }
    }

    /// Whether they are ranks of places.
    pub fn are_places(self) -> bool {
        matches!(
            self,
            Self::BlurPlaces | Self::ThicknessPlaces | Self::FlairPlaces
        )
    }

    /// Whether they are numbers with names.
    pub fn are_labels(self) -> bool {
        self.are_places() || matches!(self, Self::Sides | Self::Regions)
    }
}

impl From<MapName> for VoxelValues {
    fn from(name: MapName) -> Self {
        let of_map = |values: &Self| values.map() == Some(name) && !values.are_places();
        let found = Self::ALL.into_iter().find(of_map);
        found.expect("voxels have values of every map")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_map_is_among_them_by_its_name() {
        for name in MapName::ALL {
            let values = VoxelValues::from(name);
            assert_eq!(values.name(), name.name());
            assert_eq!(values.map(), Some(name));
        }
    }
}
