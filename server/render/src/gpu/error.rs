//! What can go wrong with a graphics device.

/// Why a graphics device did not draw.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum GpuError {
    /// No driver, or none that can draw.
    #[error("no graphics adapter was found: {reason}")]
    NoAdapter {
        /// What the driver's loader says.
        reason: String,
    },
    /// There is an adapter, but it cannot be used.
    #[error("the graphics device could not be opened: {reason}")]
    NoDevice {
        /// What the driver says.
        reason: String,
    },
    /// The device was lost while it drew, and again when the picture was drawn anew.
    #[error("the graphics device was lost: {reason}")]
    Lost {
        /// What the driver says.
        reason: String,
    },
    /// The device's memory is too small for the case or the picture.
    #[error("the graphics device has too little memory for this picture")]
    OutOfMemory,
    /// The depth of a case does not fit where the textures of cases are kept.
    #[error("the case needs {needed} bytes of textures, and {limit} are there")]
    CaseTooLarge {
        /// Bytes of its smallest form.
        needed: u64,
        /// Bytes that may be used.
        limit: u64,
    },
    /// A side of a layer is longer than the device's textures.
    #[error("a layer is {longest} voxels long; the textures of the device are at most {limit}")]
    LayerTooLarge {
        /// Voxels along its longest side.
        longest: usize,
        /// Voxels that are possible.
        limit: u32,
    },
    /// The driver refuses what it was asked, or its thread failed.
    #[error("the graphics device failed: {reason}")]
    Failed {
        /// What the driver says.
        reason: String,
    },
    /// The mesh has other vertices than its size says.
    #[error("the mesh has {found} vertices; its size says {expected}")]
    Mesh {
        /// How many there are.
        found: usize,
        /// How many there should be.
        expected: usize,
    },
    /// So many pictures wait for the device that no more are taken.
    #[error("too many pictures wait for the graphics device")]
    Busy,
    /// The device's threads have ended.
    #[error("the graphics device is closed")]
    Closed,
}
