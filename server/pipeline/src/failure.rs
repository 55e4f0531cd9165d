//! Converts errors to failures for clients.

use geometry::GeometryError;
use imaging::ImagingError;

use case::{Failure, FailureKind};

pub(super) fn from_imaging(error: ImagingError) -> Failure {
    if let ImagingError::Geometry(error) = error {
        return from_geometry(error);
    }
    let kind = match &error {
        ImagingError::NotNifti { .. } => FailureKind::NotRecognised,
        ImagingError::OutOfMemory { .. } => FailureKind::OutOfMemory,
        error if error.is_too_large() => FailureKind::TooLarge,
        _ => FailureKind::Unusable,
    };
    Failure::new(kind, error.kind(), error.to_string())
}

pub(super) fn from_geometry(error: GeometryError) -> Failure {
    let (name, kind) = match &error {
        GeometryError::EmptyGrid { .. } => ("grid-empty", FailureKind::Unusable),
        GeometryError::TooManyVoxels { .. } => ("too-many-voxels", FailureKind::TooLarge),
        GeometryError::BadAffine { .. } => ("affine-bad", FailureKind::Unusable),
        GeometryError::EmptyMask => ("mask-empty", FailureKind::Unusable),
        GeometryError::MaskOutsideVolume { .. } => ("mask-outside-volume", FailureKind::Unusable),
        GeometryError::Parameter {
            name: "closing_radius_mm",
            ..
        } => ("closing-radius-out-of-range", FailureKind::Unusable),
        GeometryError::Parameter {
            name: "offset_mm", ..
        } => ("offset-out-of-range", FailureKind::Unusable),
        GeometryError::Parameter { .. } => ("parameter-out-of-range", FailureKind::Unusable),
        GeometryError::TooSmall { .. } => ("envelope-too-small", FailureKind::Unusable),
        _ => ("geometry", FailureKind::Unusable),
    };
    Failure::new(kind, name, error.to_string())
}

/// The preparation was cancelled, because the case was deleted or the process stops.
pub(super) fn cancelled() -> Failure {
    Failure::new(
        FailureKind::Cancelled,
        "cancelled",
        "the preparation was cancelled",
    )
}
