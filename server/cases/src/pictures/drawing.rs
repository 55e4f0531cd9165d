//! A picture that can be drawn, and the drawing of it.

use render::choice::Renderer;
use render::{RenderBackend, RenderError, RenderJob, RenderedFrame, Wanted};

use super::graphics::Graphics;
use crate::error::Error;
use crate::limit::Turn;

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
    /// Draws in a turn. If a graphics device fails, the CPU draws with the same renderer.
    ///
    /// # Errors
    /// [`Error::Parameter`] for what cannot be drawn, and as [`Turn::run`].
    pub async fn draw(self, turn: &Turn) -> Result<DrawnPicture, Error> {
        match self.draw_on_device().await {
            Ok(Some(rendered)) => Ok(DrawnPicture {
                rendered,
                backend: self.backend,
            }),
            Ok(None) => self.draw_on_cpu(turn).await,
            Err(RenderError::Gpu(error)) => {
                tracing::warn!(%error, "the graphics device did not draw: the processor does");
                let backend = RenderBackend::choose(self.asked, None);
                Self { backend, ..self }.draw_on_cpu(turn).await
            }
            Err(other) => Err(other.into()),
        }
    }

    /// `None` if the CPU draws. If the future is dropped before the device begins, it never does.
    async fn draw_on_device(&self) -> Result<Option<RenderedFrame>, RenderError> {
        match self.backend.begin_on_device(&self.job)? {
            Some(ticket) => Ok(Some(ticket.await?)),
            None => Ok(None),
        }
    }

    async fn draw_on_cpu(self, turn: &Turn) -> Result<DrawnPicture, Error> {
        let Self { job, backend, .. } = self;
        let draw = move |is_wanted: &Wanted<'_>| {
            let rendered = backend.draw_while(&job, is_wanted)?;
            Ok(DrawnPicture {
                rendered: rendered.ok_or(Error::Unavailable)?,
                backend,
            })
        };
        turn.run_while(draw).await?
    }
}
