//! How a header starts: its length, which is that of its version, in its byte order; of MGH, its version.

/// Bytes of a NIfTI-2 header, the longest.
pub(crate) const LONGEST_HEADER: usize = 540;

/// Bytes of a NIfTI-1 header, and of an Analyze header.
pub(super) const NIFTI_1_HEADER: usize = 348;

/// Bytes of an MGH header, before the first voxel.
pub(super) const MGH_HEADER: usize = 284;

/// Which byte of a number comes first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ByteOrder {
    Little,
    Big,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Version {
    One,
    Two,
}

/// The version of all MGH files.
const MGH_VERSION: [u8; 4] = 1u32.to_be_bytes();

/// The length of the header that starts with `bytes`; four bytes are enough.
pub(crate) fn header_length(bytes: &[u8]) -> Option<usize> {
    if bytes.starts_with(&MGH_VERSION) {
        return Some(MGH_HEADER);
    }
    Some(match kind(bytes)? {
        (Version::One, _) => NIFTI_1_HEADER,
        (Version::Two, _) => LONGEST_HEADER,
    })
}

/// Whether bytes start like a header of NIfTI, Analyze or MGH, which may be damaged.
pub(crate) fn looks_like_header(bytes: &[u8]) -> bool {
    header_length(bytes).is_some()
}

/// Version and byte order, from `sizeof_hdr`.
pub(super) fn kind(bytes: &[u8]) -> Option<(Version, ByteOrder)> {
    let size: [u8; 4] = bytes.get(..4)?.try_into().ok()?;
    match (u32::from_le_bytes(size), u32::from_be_bytes(size)) {
        (348, _) => Some((Version::One, ByteOrder::Little)),
        (540, _) => Some((Version::Two, ByteOrder::Little)),
        (_, 348) => Some((Version::One, ByteOrder::Big)),
        (_, 540) => Some((Version::Two, ByteOrder::Big)),
        _ => None,
    }
}
