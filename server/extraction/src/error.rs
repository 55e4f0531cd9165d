//! Errors of the extraction.

/// Why an extraction, or loading its weights, failed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ExtractionError {
    /// The bytes are not the published weights.
    #[error("this is not the wheel of deepbet 1.0.2 with the network's weights: {what}")]
    Weights {
        /// What is wrong with them.
        what: String,
    },
    /// Nothing in the volume looks like a brain.
    #[error("no brain was found in the volume: {what}")]
    NoBrain {
        /// What was found instead.
        what: &'static str,
    },
    /// The caller stopped it.
    #[error("the extraction was cancelled")]
    Cancelled,
    /// A grid or a mask is invalid.
    #[error(transparent)]
    Geometry(#[from] geometry::GeometryError),
}
