//! What can be wrong with the input of the geometry.

/// Why a geometric step was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GeometryError {
    /// A side of the grid is zero.
    #[error("the grid is empty: its size is {}×{}×{}", .size[0], .size[1], .size[2])]
    EmptyGrid {
        /// Voxels along each axis.
        size: [usize; 3],
    },
    /// The grid has more voxels than are accepted.
    #[error("the grid has {}×{}×{} voxels, more than the limit of {limit}", .size[0], .size[1], .size[2])]
    TooManyVoxels {
        /// Voxels along each axis.
        size: [usize; 3],
        /// The largest accepted number of voxels.
        limit: usize,
    },
    /// The affine has an entry that is not a number, or cannot be inverted.
    #[error("the affine from voxels to the patient is {what}")]
    BadAffine {
        /// What is wrong with it.
        what: &'static str,
    },
    /// The number of values is not that of the grid's voxels.
    #[error("{values} values were given for a grid of {voxels} voxels")]
    ValueCount {
        /// How many values there are.
        values: usize,
        /// How many there should be.
        voxels: usize,
    },
    /// The mask marks no voxel.
    #[error("the mask is empty: no voxel belongs to the brain")]
    EmptyMask,
    /// The mask lies largely outside of the volume.
    #[error(
        "only {percent:.0} % of the mask lies inside the volume; is it the mask of another head?"
    )]
    MaskOutsideVolume {
        /// How much of the mask's voxels lie inside the volume.
        percent: f64,
    },
    /// A stored envelope reaches a face of its grid.
    #[error("the envelope is cut by a face of its grid")]
    CutEnvelope,
    /// A parameter is out of its range.
    #[error("{name} is {value}; it must be {range}")]
    Parameter {
        /// The parameter's name as in the interfaces.
        name: &'static str,
        /// What was given.
        value: f64,
        /// What is accepted, in words.
        range: &'static str,
    },
    /// Too small to be cut into contours.
    #[error("the envelope is too small for a mesh: {what}")]
    TooSmall {
        /// What is too small.
        what: &'static str,
    },
}
