//! What can be wrong with a request for a picture.

use crate::gpu::GpuError;

/// Why a picture was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RenderError {
    /// A parameter is out of its range or not a number.
    #[error("{name} is {value}; it must be {range}")]
    Parameter {
        /// The parameter's name as in the interfaces.
        name: &'static str,
        /// What was given.
        value: f64,
        /// What is accepted, in words.
        range: &'static str,
    },
    /// A word is none of those that are known.
    #[error("{name} is unknown; it must be one of {known}")]
    UnknownName {
        /// The parameter's name as in the interfaces.
        name: &'static str,
        /// The words that are known.
        known: &'static str,
    },
    /// More depths than can be told apart in one picture.
    #[error("{count} depths were asked for; at most {limit} fit into a picture")]
    TooManyContours {
        /// How many were asked for.
        count: usize,
        /// How many are accepted.
        limit: usize,
    },
    /// A backend that draws a mesh was given none.
    #[error("this renderer draws a mesh, and none was given")]
    MeshMissing,
    /// A layer has not one value for each voxel.
    #[error("the layer has {found} values for {expected} voxels")]
    LayerSize {
        /// Values.
        found: usize,
        /// Voxels.
        expected: usize,
    },
    /// The graphics device did not draw.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// A text to be kept in a PNG cannot be: its keyword is not one.
    #[error("a PNG text needs a keyword of 1 to 79 Latin letters")]
    PngKeyword,
    /// The PNG could not be written.
    #[error("the picture could not be encoded as PNG")]
    PngEncoding,
}

/// Passes `value` on when it lies in `accepted`; what is not a number never does.
pub(crate) fn checked(
    name: &'static str,
    value: f64,
    accepted: std::ops::RangeInclusive<f64>,
    range: &'static str,
) -> Result<f64, RenderError> {
    if accepted.contains(&value) {
        Ok(value)
    } else {
        Err(RenderError::Parameter { name, value, range })
    }
}
