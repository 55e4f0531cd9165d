use render::choice::Renderer;
use render::{
    Hits, MapDisc, RenderBackend, RenderError, RenderJob, RenderedFrame, SizedMesh, Wanted,
};
use storage::StoreError;

use super::PictureLayers;
use super::depth::ShownDepth;
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
    pub job: RenderJob,
    pub asked: Renderer,
    pub backend: RenderBackend,
}

/// The pictures that make up a picture of a loaded case: itself, or each disc of a map. `models` are those of its surfaces. Call it
/// in a turn, because the vertices of a mesh may have to walk first.
///
/// # Errors
/// If the mesh cannot be made, or a hemisphere has no centre.
pub async fn warm_jobs(
    models: &[WarmModel],
    picture: &CheckedPicture,
    layers: &PictureLayers,
    backend: &RenderBackend,
) -> Result<Vec<PictureJob>, Error> {
    let Some(map) = picture.asked.map() else {
        let job = warm_job(&models[0], picture, layers.clone(), backend.clone()).await?;
        return Ok(vec![job]);
    };
    let depth = shown_depth(models, picture);
    let job = |(disc, warm): (MapDisc, WarmModel)| PictureJob {
        job: RenderJob {
            case: warm.keyed(),
            request: picture.of_disc(disc, depth, warm.facts(), layers),
            mesh: None,
            layers: layers.keyed.clone(),
        },
        asked: picture.asked.renderer,
        backend: backend.clone(),
    };
    // The centres of the hemispheres are computed once.
    let models = models.to_vec();
    let find = tokio::task::spawn_blocking(move || map.discs(&models));
    let discs = find.await.map_err(StoreError::from)??;
    Ok(discs.into_iter().map(job).collect())
}

/// The depth that a picture shows in all its models.
pub fn shown_depth(models: &[WarmModel], picture: &CheckedPicture) -> ShownDepth {
    let depths = models
        .iter()
        .map(|model| picture.depth.shown_in(model.facts()));
    let shallowest = depths.min_by(|a, b| a.mm.total_cmp(&b.mm));
    shallowest.expect("a picture shows a surface")
}

async fn warm_job(
    warm: &WarmModel,
    picture: &CheckedPicture,
    layers: PictureLayers,
    backend: RenderBackend,
) -> Result<PictureJob, Error> {
    let mesh = match backend.needs_mesh() {
        true => {
            let depth_mm = picture.depth.shown_in(warm.facts()).mm;
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
            request: picture.of_case(warm.facts(), &layers),
            mesh,
            layers: layers.keyed,
        },
        asked: picture.asked.renderer,
        backend,
    })
}

#[derive(Debug)]
pub struct DrawnPicture {
    pub rendered: RenderedFrame,
    /// The backend that drew it.
    pub backend: RenderBackend,
}

/// Draws the parts of a picture in a turn, and joins them.
///
/// # Errors
/// As [`PictureJob::draw`].
///
/// # Panics
/// If there are none.
pub(super) async fn draw_all(jobs: Vec<PictureJob>, turn: &Turn) -> Result<DrawnPicture, Error> {
    let mut drawn: Option<DrawnPicture> = None;
    for job in jobs {
        let part = job.draw(turn).await?;
        drawn = Some(match drawn {
            None => part,
            Some(mut before) => {
                before.rendered.frame = before.rendered.frame.joined(&part.rendered.frame);
                before
            }
        });
    }
    Ok(drawn.expect("a picture has a part"))
}

/// Finds in a turn the position in LPS mm of what each pixel of a picture shows, row by row, NaN if that is nothing, and with
/// which backend.
///
/// # Errors
/// As [`PictureJob::draw`].
///
/// # Panics
/// If there are no jobs.
pub async fn positions(
    jobs: Vec<PictureJob>,
    turn: &Turn,
) -> Result<(Vec<[f32; 3]>, RenderBackend), Error> {
    let mut found: Option<(Vec<[f32; 3]>, RenderBackend)> = None;
    for job in jobs {
        let (hits, backend) = job.hits(turn).await?;
        let add = move || match found {
            None => (hits.positions_in_patient(), backend),
            Some((mut positions, backend)) => {
                hits.fill(&mut positions);
                (positions, backend)
            }
        };
        found = Some(turn.run(add).await?);
    }
    Ok(found.expect("a picture has a part"))
}

impl PictureJob {
    /// Draws in a turn. If a graphics device fails, the CPU draws with the same renderer.
    ///
    /// # Errors
    /// [`Error::Parameter`] if the picture cannot be drawn, and as [`Turn::run`].
    async fn draw(self, turn: &Turn) -> Result<DrawnPicture, Error> {
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
    async fn hits(self, turn: &Turn) -> Result<(Hits, RenderBackend), Error> {
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
