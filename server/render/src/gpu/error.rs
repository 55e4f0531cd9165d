//! Errors of graphics devices.

/// The reason why a graphics device did not draw.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum GpuError {
    /// There is no driver, or none that can draw.
    #[error("no graphics adapter was found: {reason}")]
    NoAdapter {
        /// The message of the driver loader.
        reason: String,
    },
    /// There is an adapter, but it cannot be used.
    #[error("the graphics device could not be opened: {reason}")]
    NoDevice {
        /// The message of the driver.
        reason: String,
    },
    /// The device was lost while it drew, and again during the second attempt.
    #[error("the graphics device was lost: {reason}")]
    Lost {
        /// The message of the driver.
        reason: String,
    },
    /// The device's memory is too small for the case or the picture.
    #[error("the graphics device has too little memory for this picture")]
    OutOfMemory,
    /// The depth fields of a case do not fit into the memory for textures.
    #[error("the textures of the case need {needed} bytes; the limit is {limit}")]
    CaseTooLarge {
        /// Bytes of its smallest form.
        needed: u64,
        /// The limit in bytes.
        limit: u64,
    },
    /// A side of a layer is longer than a texture of the device can be.
    #[error("a layer is {longest} voxels long; a texture of the device has at most {limit}")]
    LayerTooLarge {
        /// Voxels along its longest side.
        longest: usize,
        /// The limit in voxels.
        limit: u32,
    },
    /// The driver rejected a request, or its thread failed.
    #[error("the graphics device failed: {reason}")]
    Failed {
        /// The message of the driver.
        reason: String,
    },
    /// The number of vertices does not match the size of the mesh.
    #[error("the mesh has {found} vertices; its size requires {expected}")]
    Mesh {
        /// The number of vertices.
        found: usize,
        /// The required number.
        expected: usize,
    },
    /// The queue of the device is full.
    #[error("too many pictures wait for the graphics device")]
    Busy,
    /// The device's threads have ended.
    #[error("the graphics device is closed")]
    Closed,
}
