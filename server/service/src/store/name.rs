//! What objects are called.

use std::fmt;

/// What an object holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum ObjectKind {
    /// The volume as it was uploaded.
    SourceVolume,
    /// The mask as it was uploaded.
    SourceMask,
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
}

impl ObjectKind {
    /// Every kind.
    pub const ALL: [Self; 7] = [
        Self::SourceVolume,
        Self::SourceMask,
        Self::Mask,
        Self::Volume,
        Self::Envelope,
        Self::Forest,
        Self::Paths,
    ];

    /// The kinds that are computed from the source.
    pub const DERIVED: [Self; 5] = [
        Self::Mask,
        Self::Volume,
        Self::Envelope,
        Self::Forest,
        Self::Paths,
    ];

    /// The name in rows and addresses.
    pub fn name(self) -> &'static str {
        match self {
            Self::SourceVolume => "source-volume",
            Self::SourceMask => "source-mask",
            Self::Mask => "mask",
            Self::Volume => "volume",
            Self::Envelope => "envelope",
            Self::Forest => "forest",
            Self::Paths => "paths",
        }
    }

    /// The kind of a name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// The number in an object's header.
    pub(super) fn code(self) -> u16 {
        match self {
            Self::SourceVolume => 1,
            Self::SourceMask => 2,
            Self::Volume => 3,
            Self::Envelope => 4,
            Self::Forest => 5,
            Self::Paths => 6,
            Self::Mask => 7,
        }
    }

    /// Whether it is what a user uploaded, which nothing can replace.
    pub fn is_source(self) -> bool {
        matches!(self, Self::SourceVolume | Self::SourceMask)
    }
}

/// The address of an object: its kind and the BLAKE3 digest of its payload.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct ObjectName {
    /// What it holds.
    pub kind: ObjectKind,
    /// Digest of the payload as it is stored.
    pub digest: blake3::Hash,
}

impl ObjectName {
    /// Reads a kind's name and 64 hexadecimal digits.
    pub fn parse(kind: &str, digest: &str) -> Option<Self> {
        Some(Self {
            kind: ObjectKind::from_name(kind)?,
            digest: blake3::Hash::from_hex(digest).ok()?,
        })
    }

    /// Where it is below the root of the object store.
    pub(super) fn path(&self) -> object_store::path::Path {
        let digest = self.digest.to_hex();
        object_store::path::Path::from_iter([self.kind.name(), &digest[..2], digest.as_str()])
    }
}

impl fmt::Display for ObjectName {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}/{}", self.kind.name(), self.digest)
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

    #[test]
    fn the_same_bytes_as_volume_and_as_mask_are_two_objects() {
        let digest = blake3::hash(b"same");
        let of = |kind| ObjectName { kind, digest }.path();
        assert_ne!(of(ObjectKind::SourceVolume), of(ObjectKind::SourceMask));
    }
}
