//! Errors of a measurement.

use std::path::{Path, PathBuf};

use analysis::MapsUndefined;
use extraction::ExtractionError;
use geometry::GeometryError;
use imaging::ImagingError;
use render::RenderError;

/// Why a measurement failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BenchError {
    /// An invalid command line.
    #[error("{0}")]
    Usage(String),
    /// A file cannot be read.
    #[error("{} cannot be read: {reason}", path.display())]
    Unreadable {
        /// Its path.
        path: PathBuf,
        /// The message of the system.
        reason: std::io::Error,
    },
    /// A file or directory cannot be written.
    #[error("{} cannot be written: {reason}", path.display())]
    Unwritable {
        /// Its path.
        path: PathBuf,
        /// The message of the system or the encoder.
        reason: String,
    },
    /// The volume or the mask cannot be read.
    #[error(transparent)]
    Imaging(#[from] ImagingError),
    /// The head cannot be prepared.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
    /// A brain cannot be extracted.
    #[error("{0}; give a mask: NAME=VOLUME,MASK")]
    Extraction(#[from] ExtractionError),
    /// An extracted mask is not that of a brain.
    #[error(
        "the mask that was extracted from {head} is rated failed ({reasons}); give a mask: {head}=VOLUME,MASK"
    )]
    FailedMask {
        /// The name of the head.
        head: String,
        /// The reasons for the rating.
        reasons: String,
    },
    /// The head has no maps.
    #[error(transparent)]
    Maps(#[from] MapsUndefined),
    /// A picture cannot be drawn.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// Mask and volume do not overlap.
    #[error("nothing of the mask lies inside the volume")]
    MaskOutsideVolume,
    /// The worker threads cannot be started.
    #[error("the worker threads cannot be started: {0}")]
    Threads(String),
}

impl BenchError {
    /// A file or a directory that cannot be written.
    pub fn unwritable(path: &Path, reason: &dyn std::fmt::Display) -> Self {
        Self::Unwritable {
            path: path.to_owned(),
            reason: reason.to_string(),
        }
    }

    /// The exit status: 2 for an invalid command line, otherwise as in `sysexits.h` of BSD.
    pub fn exit_status(&self) -> u8 {
        match self {
            Self::Usage(_) => 2,
            Self::Imaging(_)
            | Self::Geometry(_)
            | Self::Extraction(_)
            | Self::FailedMask { .. }
            | Self::Maps(_)
            | Self::MaskOutsideVolume => 65,
            Self::Unreadable { .. } => 66,
            Self::Render(RenderError::Gpu(_)) | Self::Threads(_) => 69,
            Self::Render(_) => 70,
            Self::Unwritable { .. } => 73,
        }
    }
}
