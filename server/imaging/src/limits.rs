//! Limits on the size of an image.

/// Limits on the size of an image. A file beyond them is rejected before memory is allocated for it.
///
/// A reader never holds more than `max_bytes` of unpacked voxels plus two bytes per voxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// The largest number of voxels.
    pub max_voxels: usize,
    /// The largest size of all voxels in bytes, unpacked and in the data type of the file.
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
