//! A picture that can be drawn, and the drawing of it.

use render::choice::Renderer;
use render::{RenderBackend, RenderError, RenderJob, RenderedFrame, Wanted};

use super::graphics::Graphics;
use crate::error::Error;

/// The backend for a renderer on this machine. Splatting does not wait for the graphics device.
pub async fn backend_for(asked: Renderer, graphics: &Graphics) -> RenderBackend {
    let device = match asked {
        Renderer::Splat => None,
        _ => graphics.pool().await,
    };
    RenderBackend::choose(asked, device)
}

/// A picture that can be drawn, and who draws it. Cheap to clone but for its mesh.
#[derive(Debug, Clone)]
pub struct PictureJob {
    /// The picture.
    pub job: RenderJob,
    /// The renderer that was asked for.
    pub asked: Renderer,
    /// Who draws.
    pub backend: RenderBackend,
}

/// A picture that was drawn.
#[derive(Debug)]
pub struct DrawnPicture {
    /// The picture.
    pub rendered: RenderedFrame,
    /// Who drew it, after all.
    pub backend: RenderBackend,
}

impl PictureJob {
    /// Draws. If a graphics device fails, the CPU draws: with the renderer that was asked for.
    ///
    /// # Errors
    /// [`Error::Unavailable`] soon after the picture is no longer wanted.
    pub fn draw(self, is_wanted: &Wanted<'_>) -> Result<DrawnPicture, Error> {
        let drawn = match self.backend.draw_while(&self.job, is_wanted) {
            Err(RenderError::Gpu(error)) => {
                tracing::warn!(%error, "the graphics device did not draw: the processor does");
                return self.on_cpu().draw(is_wanted);
            }
            drawn => drawn?,
        };
        Ok(DrawnPicture {
            rendered: drawn.ok_or(Error::Unavailable)?,
            backend: self.backend,
        })
    }

    fn on_cpu(self) -> Self {
        Self {
            backend: RenderBackend::choose(self.asked, None),
            ..self
        }
    }
}
