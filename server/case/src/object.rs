//! The objects that are stored for a case and its layers.

use strum::{IntoStaticStr, VariantArray};

/// The kind of a stored object.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
pub enum ObjectKind {
    SourceVolume,
    SourceMask,
    /// The identifying DICOM attributes, if the volume comes from DICOM.
    SourceDicom,
    /// The brain mask on the working grid.
    Mask,
    /// Intensities cropped to the envelope.
    Volume,
    /// All intensities as acquired, for slices; the same object for all versions of a case.
    WholeVolume,
    /// The envelope on the working grid.
    Envelope,
    Forest,
    /// The table of paths of the default mesh.
    Paths,
    /// The maps of the junction of grey and white matter, or why there are none; made once the case is ready.
    Maps,
    /// The closed parts of the brain, or why there are none; made with the maps, or else when one is first shown.
    Surfaces,
    /// A DICOM file that is part of no case yet.
    Instance,
    /// A DICOM object made from the case, which is sent to others.
    Result,
    /// The uploaded volume of a layer; if it came as DICOM, the volume made from it.
    SourceLayer,
    /// The voxels of a layer around the envelope, on the grid of their acquisition.
    Layer,
    /// What is needed to submit the upload of the case or the layer again.
    Manifest,
}

impl ObjectKind {
    pub const ALL: &'static [Self] = Self::VARIANTS;

    /// The kinds that a preparation computes from the uploaded files.
    pub const DERIVED: [Self; 6] = [
        Self::Mask,
        Self::Volume,
        Self::WholeVolume,
        Self::Envelope,
        Self::Forest,
        Self::Paths,
    ];

    /// Its name in rows and addresses.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// The kind with a name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|kind| kind.name() == name)
    }

    /// Its number in the header of an object.
    pub fn code(self) -> u16 {
        match self {
            Self::SourceVolume => 1,
            Self::SourceMask => 2,
            Self::Volume => 3,
            Self::Envelope => 4,
            Self::Forest => 5,
            Self::Paths => 6,
            Self::Mask => 7,
            Self::SourceDicom => 8,
            Self::Maps => 9,
            Self::Instance => 20,
            Self::Result => 21,
            Self::WholeVolume => 12,
            Self::SourceLayer => 10,
            Self::Layer => 11,
            Self::Surfaces => 13,
            Self::Manifest => 14,
        }
    }

    /// Whether it was uploaded, and so cannot be computed again.
    pub fn is_source(self) -> bool {
        matches!(
            self,
            Self::SourceVolume | Self::SourceMask | Self::SourceDicom | Self::SourceLayer
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_codes_of_kinds_are_read_back_and_differ() {
        let mut codes = Vec::new();
        for &kind in ObjectKind::ALL {
            assert_eq!(ObjectKind::from_name(kind.name()), Some(kind));
            assert!(!codes.contains(&kind.code()));
            codes.push(kind.code());
        }
        assert_eq!(ObjectKind::from_name("../source-volume"), None);
    }
}
