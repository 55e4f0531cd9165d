//! Errors in requests for pictures.

use crate::gpu::GpuError;

/// The reason why a picture was not drawn.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RenderError {
    /// A parameter is outside its range or not a number.
    #[error("{name} is {value}; it must be {range}")]
    Parameter {
        /// The parameter's name as in the interfaces.
        name: &'static str,
        /// The given value.
        value: f64,
        /// A description of the accepted range.
        range: &'static str,
    },
    /// A name is unknown.
    #[error("{name} is unknown; it must be one of {known}")]
    UnknownName {
        /// The parameter's name as in the interfaces.
        name: &'static str,
        /// The known names.
        known: &'static str,
    },
    /// More depths than one picture can show.
    #[error("{count} depths were requested; a picture can show at most {limit}")]
    TooManyContours {
        /// The requested number.
        count: usize,
        /// The greatest number.
        limit: usize,
    },
    /// The backend draws a mesh, and the job has none.
    #[error("this renderer needs a mesh")]
    MeshMissing,
    /// The backend does not draw maps.
    #[error("this renderer draws no map; choose trace")]
    NoMap,
    /// The number of values of a layer differs from its number of voxels.
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
    /// The keyword of a PNG text is invalid.
    #[error("a PNG text needs a keyword of 1 to 79 Latin letters")]
    PngKeyword,
    /// The PNG could not be written.
    #[error("the picture could not be encoded as PNG")]
    PngEncoding,
    /// The JPEG could not be written.
    #[error("the picture could not be encoded as JPEG")]
    JpegEncoding,
}

/// Returns `value` if it is in `accepted`; NaN never is.
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
