//! The names of objects.

use std::fmt;

use case::ObjectKind;

/// The address of an object: its kind and the BLAKE3 digest of its payload.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct ObjectName {
    pub kind: ObjectKind,
    /// Digest of the payload as it is stored.
    pub digest: blake3::Hash,
}

impl ObjectName {
    /// Parses the name of a kind and 64 hexadecimal digits.
    pub fn parse(kind: &str, digest: &str) -> Option<Self> {
        Some(Self {
            kind: ObjectKind::from_name(kind)?,
            digest: blake3::Hash::from_hex(digest).ok()?,
        })
    }

    /// Its path below the root of the object store.
    pub fn path(&self) -> object_store::path::Path {
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
    fn the_same_bytes_as_volume_and_as_mask_are_two_objects() {
        let digest = blake3::hash(b"same");
        let of = |kind| ObjectName { kind, digest }.path();
        assert_ne!(of(ObjectKind::SourceVolume), of(ObjectKind::SourceMask));
    }

    #[test]
    fn names_come_back_from_their_texts_and_others_do_not() {
        let digest = blake3::hash(b"payload");
        for &kind in ObjectKind::ALL {
            let name = ObjectName { kind, digest };
            let text = name.to_string();
            let (kind, digits) = text.split_once('/').unwrap();
            assert_eq!(ObjectName::parse(kind, digits), Some(name));
            let path = format!("{kind}/{}/{digits}", &digits[..2]);
            assert_eq!(name.path().as_ref(), path);
        }
        let digits = digest.to_string();
        for (kind, digits) in [
            ("hologram", &digits[..]),
            ("Mask", &digits),
            ("", &digits),
            ("mask", &digits[..63]),
            ("mask", ""),
            ("mask", &digits.replacen(&digits[..1], "x", 1)),
        ] {
            assert_eq!(ObjectName::parse(kind, digits), None, "{kind}/{digits}");
        }
    }
}
