//! Errors of the geometry.

/// Why a step of the geometry failed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GeometryError {
    /// A side of the grid is zero.
    #[error("the grid is empty: its size is {}×{}×{}", .size[0], .size[1], .size[2])]
    EmptyGrid {
        /// Voxels along each axis.
        size: [usize; 3],
    },
    /// The grid has too many voxels.
    #[error("the grid has {}×{}×{} voxels, more than the limit of {limit}", .size[0], .size[1], .size[2])]
    TooManyVoxels {
        /// Voxels along each axis.
        size: [usize; 3],
        /// The limit.
        limit: usize,
    },
    /// The affine is not finite or not invertible.
    #[error("the affine from voxels to the patient is {what}")]
    BadAffine {
        /// What is wrong with it.
        what: &'static str,
    },
    /// The number of values differs from the number of voxels.
    #[error("there are {values} values for a grid of {voxels} voxels")]
    ValueCount {
        /// Number of values.
        values: usize,
        /// Number of voxels.
        voxels: usize,
    },
    /// The mask is empty.
    #[error("the mask is empty: no voxel belongs to the brain")]
    EmptyMask,
    /// Most of the mask lies outside the volume.
    #[error(
        "only {percent:.0} % of the mask lies inside the volume; is it the mask of another head?"
    )]
    MaskOutsideVolume {
        /// The percentage of its voxels inside the volume.
        percent: f64,
    },
    /// A stored envelope touches a face of its grid.
    #[error("the envelope is cut by a face of its grid")]
    CutEnvelope,
    /// A parameter is out of its range.
    #[error("{name} is {value}; it must be {range}")]
    Parameter {
        /// The name of the parameter in the interfaces.
        name: &'static str,
        /// The given value.
        value: f64,
        /// The accepted range, in words.
        range: &'static str,
    },
    /// The envelope is too small for contours.
    #[error("the envelope is too small for a mesh: {what}")]
    TooSmall {
        /// What is too small.
        what: &'static str,
    },
}
