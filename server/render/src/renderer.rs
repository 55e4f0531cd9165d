//! What every renderer can do.

use crate::splat::{draw_splat, splat_hits};
use crate::trace::{draw_trace, trace_hits};
use crate::{Frame, Hits, RenderError, RenderRequest, Scene};

/// One way to draw the isosurface {depth = D}. All of them draw the same picture, within limits that
/// one suite of checks holds them to (`conformance`, behind the feature of that name).
pub trait Renderer: Send + Sync {
    /// The name in the interfaces.
    fn name(&self) -> &'static str;

    /// Draws a picture.
    ///
    /// # Errors
    /// When this renderer cannot draw on this machine; the CPU renderers always can.
    fn draw(&self, scene: &Scene<'_>, request: &RenderRequest) -> Result<Frame, RenderError>;

    /// Finds what each pixel of the picture shows.
    ///
    /// # Errors
    /// As for [`Renderer::draw`].
    fn hits(&self, scene: &Scene<'_>, request: &RenderRequest) -> Result<Hits, RenderError>;
}

/// The voxel-splat renderer: see [`draw_splat`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Splat;

/// The exact renderer on the CPU: see [`draw_trace`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Trace;

impl Renderer for Splat {
    fn name(&self) -> &'static str {
        "splat"
    }

    fn draw(&self, scene: &Scene<'_>, request: &RenderRequest) -> Result<Frame, RenderError> {
        Ok(draw_splat(scene, request))
    }

    fn hits(&self, scene: &Scene<'_>, request: &RenderRequest) -> Result<Hits, RenderError> {
        Ok(splat_hits(scene, request))
    }
}

impl Renderer for Trace {
    fn name(&self) -> &'static str {
        "trace"
    }

    fn draw(&self, scene: &Scene<'_>, request: &RenderRequest) -> Result<Frame, RenderError> {
        Ok(draw_trace(scene, request))
    }

    fn hits(&self, scene: &Scene<'_>, request: &RenderRequest) -> Result<Hits, RenderError> {
        Ok(trace_hits(scene, request))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conformance::{Limits, check};

    #[test]
    fn splat_does_what_a_renderer_must() {
        let limits = Limits {
            depth_voxels: 0.5,
            mean_difference: 3.0,
            has_soft_edges: false,
        };
        check(&Splat, limits);
    }

    #[test]
    fn trace_does_what_a_renderer_must() {
        // 0.02 mm of 1.25.
        let limits = Limits {
            depth_voxels: 0.016,
            mean_difference: 0.0,
            has_soft_edges: false,
        };
        check(&Trace, limits);
    }
}
