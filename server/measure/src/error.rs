//! Why something cannot be measured.

use geometry::GeometryError;
use imaging::ImagingError;
use render::RenderError;
use render::gpu::GpuError;

/// Why something cannot be measured.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MeasureError {
    /// The volume or the mask cannot be read.
    #[error(transparent)]
    Imaging(#[from] ImagingError),
    /// The head cannot be prepared.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
    /// A picture cannot be drawn as asked.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// The graphics device failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// Mask and volume do not overlap.
    #[error("nothing of the mask lies inside the volume")]
    MaskOutsideVolume,
}
