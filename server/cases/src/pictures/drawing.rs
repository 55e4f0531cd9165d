//! Drawing of pictures.

use render::choice::Renderer;
use render::{Hits, RenderBackend, RenderError, RenderJob, RenderedFrame, SizedMesh, Wanted};

use super::PictureLayers;
use super::graphics::Graphics;
use super::request::{CheckedPicture, PictureRequest};
use crate::error::Error;
use crate::limit::Turn;
use crate::models::WarmModel;

/// The backend for a picture on this machine. Splatting does not wait for the graphics device.
pub async fn backend_for(picture: &PictureRequest, graphics: &Graphics) -> RenderBackend {
    let device = match picture.renderer {
        Renderer::Splat => None,
        _ => graphics.pool().await,
    };
    RenderBackend::choose(picture.renderer, device)
}

/// A picture to draw, and its backend. Cheap to clone, except for its mesh.
#[derive(Debug, Clone)]
pub struct PictureJob {
    /// The picture.
    pub job: RenderJob,
    /// The requested renderer.
    pub asked: Renderer,
    /// The backend.
    pub backend: RenderBackend,
}

/// The job of drawing a picture of a loaded case. Call it in a turn, because the vertices of a mesh may have to walk
/// first.
///
/// # Errors
/// If the mesh cannot be made.
pub async fn warm_job(
    warm: &WarmModel,
    picture: &CheckedPicture,
    layers: PictureLayers,
    backend: RenderBackend,
) -> Result<PictureJob, Error> {
    let mesh = match backend.needs_mesh() {
        true => {
            let depth_mm = picture.depth.shown_in(&warm.facts).mm;
            let mesh = warm.shrink(picture.mesh, picture.asked.paths, depth_mm);
            Some(SizedMesh {
                size: picture.mesh,
                mesh: mesh.await?,
            })
        }
        false => None,
    };
    Ok(PictureJob {
        job: RenderJob {
            case: warm.keyed(),
            request: picture.of_case(&warm.facts, &layers),
            mesh,
            layers: layers.keyed,
        },
        asked: picture.asked.renderer,
        backend,
    })
}

/// A finished picture.
#[derive(Debug)]
pub struct DrawnPicture {
    /// The picture.
    pub rendered: RenderedFrame,
    /// The backend that drew it.
    pub backend: RenderBackend,
}

impl PictureJob {
    /// Draws in a turn. If a graphics device fails, the CPU draws with the same renderer.
    ///
    /// # Errors
    /// [`Error::Parameter`] if the picture cannot be drawn, and as [`Turn::run`].
    pub async fn draw(self, turn: &Turn) -> Result<DrawnPicture, Error> {
        match self.draw_on_device().await {
            Ok(Some(rendered)) => Ok(DrawnPicture {
                rendered,
                backend: self.backend,
            }),
            Ok(None) => self.draw_on_cpu(turn).await,
            Err(RenderError::Gpu(error)) => {
                tracing::warn!(%error, "the graphics device failed; the CPU draws this picture");
                let backend = RenderBackend::choose(self.asked, None);
                Self { backend, ..self }.draw_on_cpu(turn).await
            }
            Err(other) => Err(other.into()),
        }
    }

    /// Finds what each pixel shows in a turn, and with which backend. If a graphics device fails, the CPU does it with the
    /// same renderer.
    ///
    /// # Errors
    /// As [`PictureJob::draw`].
    pub async fn hits(self, turn: &Turn) -> Result<(Hits, RenderBackend), Error> {
        let find = move || match self.backend.hits(&self.job) {
            Err(RenderError::Gpu(error)) => {
                tracing::warn!(%error, "the graphics device failed; the CPU finds these positions");
                let backend = RenderBackend::choose(self.asked, None);
                Ok((backend.hits(&self.job)?, backend))
            }
            found => Ok((found?, self.backend)),
        };
        turn.run(find).await?
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
