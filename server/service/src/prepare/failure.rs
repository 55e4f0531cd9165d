//! What is wrong with an input, for clients.

use geometry::GeometryError;
use imaging::ImagingError;

use crate::case::Failure;

pub(super) fn from_imaging(error: ImagingError) -> Failure {
    if let ImagingError::Geometry(error) = error {
        return from_geometry(error);
    }
    let status = match &error {
        ImagingError::NotNifti => 415,
        ImagingError::OutOfMemory { .. } => 503,
        error if error.is_too_large() => 413,
        _ => 422,
    };
    Failure {
        kind: error.kind().to_owned(),
        detail: error.to_string(),
        status,
    }
}

pub(super) fn from_geometry(error: GeometryError) -> Failure {
    let (kind, status) = match &error {
        GeometryError::EmptyGrid { .. } => ("grid-empty", 422),
        GeometryError::TooManyVoxels { .. } => ("too-many-voxels", 413),
        GeometryError::BadAffine { .. } => ("affine-bad", 422),
        GeometryError::EmptyMask => ("mask-empty", 422),
        GeometryError::MaskOutsideVolume { .. } => ("mask-outside-volume", 422),
        GeometryError::Parameter {
            name: "closing_radius_mm",
            ..
        } => ("closing-radius-out-of-range", 422),
        GeometryError::Parameter {
            name: "offset_mm", ..
        } => ("offset-out-of-range", 422),
        GeometryError::Parameter { .. } => ("parameter-out-of-range", 422),
        GeometryError::TooSmall { .. } => ("envelope-too-small", 422),
        _ => ("geometry", 422),
    };
    Failure {
        kind: kind.to_owned(),
        detail: error.to_string(),
        status,
    }
}

/// The preparation was stopped: the case was deleted, or the process ends.
pub(super) fn cancelled() -> Failure {
    Failure {
        kind: "cancelled".to_owned(),
        detail: "the preparation was cancelled".to_owned(),
        status: 409,
    }
}
