//! How much a file may ask for.

/// What a file may ask for; one that asks for more is refused before anything of the kind is allocated.
///
/// A reader never holds more than `max_bytes` of unpacked voxels and, beside them, two bytes for each voxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// The largest number of voxels of an image.
    pub max_voxels: usize,
    /// The largest size of an image's voxels in bytes, unpacked and in the data type of the file.
    pub max_bytes: u64,
}

impl Default for Limits {
    /// As many voxels as a grid may have, in 1 GiB: 512³ of the widest data type.
    fn default() -> Self {
        Self {
            max_voxels: geometry::MAX_VOXELS,
            max_bytes: 1 << 30,
        }
    }
}
