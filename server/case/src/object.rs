//! The objects that are stored for a case.

/// The kind of a stored object.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum ObjectKind {
    /// The uploaded volume.
    SourceVolume,
    /// The uploaded mask.
    SourceMask,
    /// The identifying DICOM attributes, if the volume comes from DICOM.
    SourceDicom,
    /// The brain mask on the working grid.
    Mask,
    /// Intensities cropped to the envelope.
    Volume,
    /// The envelope on the working grid.
    Envelope,
    /// The optimal-path forest.
    Forest,
    /// The table of paths of the default mesh.
    Paths,
    /// The maps of the junction of grey and white matter, or why there are none; made once the case is ready.
    Maps,
}

impl ObjectKind {
    /// Every kind.
    pub const ALL: [Self; 9] = [
        Self::SourceVolume,
        Self::SourceMask,
        Self::SourceDicom,
        Self::Mask,
        Self::Volume,
        Self::Envelope,
        Self::Forest,
        Self::Paths,
        Self::Maps,
    ];

    /// The kinds that a preparation computes from the uploaded files.
    pub const DERIVED: [Self; 5] = [
        Self::Mask,
        Self::Volume,
        Self::Envelope,
        Self::Forest,
        Self::Paths,
    ];

    /// Its name in rows and addresses.
    pub fn name(self) -> &'static str {
        match self {
            Self::SourceVolume => "source-volume",
            Self::SourceMask => "source-mask",
            Self::SourceDicom => "source-dicom",
            Self::Mask => "mask",
            Self::Volume => "volume",
            Self::Envelope => "envelope",
            Self::Forest => "forest",
            Self::Paths => "paths",
            Self::Maps => "maps",
        }
    }

    /// The kind with a name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
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
        }
    }

    /// Whether it was uploaded, and so cannot be computed again.
    pub fn is_source(self) -> bool {
        matches!(
            self,
            Self::SourceVolume | Self::SourceMask | Self::SourceDicom
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_codes_of_kinds_are_read_back_and_differ() {
        let mut codes = Vec::new();
        for kind in ObjectKind::ALL {
            assert_eq!(ObjectKind::from_name(kind.name()), Some(kind));
            assert!(!codes.contains(&kind.code()));
            codes.push(kind.code());
        }
        assert_eq!(ObjectKind::from_name("../source-volume"), None);
    }
}
