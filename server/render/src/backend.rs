//! The backends that draw pictures.

use std::fmt;
use std::sync::Arc;

use geometry::{MeshSize, ShrunkMesh};

use crate::choice::Renderer;
use crate::gpu::{AdapterSummary, GpuJob, GpuPool, GpuSurface, GpuTicket, KeyedModel};
use crate::mesh::{draw_mesh, mesh_hits};
use crate::splat::{draw_splat, splat_hits};
use crate::trace::{draw_trace, trace_hits};
use crate::{Facets, Hits, KeyedLayers, RenderError, RenderRequest, RenderedFrame, Scene, Wanted};

/// One way to draw the isosurface {depth = D}.
///
/// All backends draw the same picture within limits that one suite of checks enforces (`conformance`, behind the
/// feature of that name). The CPU gives the same bytes on every machine; graphics devices do not.
#[derive(Debug, Clone)]
pub enum RenderBackend {
    /// Splatting, on the CPU: see [`crate::draw_splat`].
    Splat,
    /// The facets of a mesh, on the CPU: see [`crate::draw_mesh`].
    Mesh,
    /// Sphere tracing, on the CPU: see [`crate::draw_trace`].
    Trace,
    /// The facets of a mesh, on a graphics device.
    GpuMesh(Arc<GpuPool>),
    /// Sphere tracing, on a graphics device.
    GpuTrace(Arc<GpuPool>),
}

/// The renderer and its device: `splat on cpu`.
impl fmt::Display for RenderBackend {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{} on {}", self.name(), self.device())
    }
}

/// A picture to draw, with all its data. Cheap to clone, except for its mesh.
#[derive(Debug, Clone)]
pub struct RenderJob {
    /// The model to draw.
    pub case: KeyedModel,
    /// How to draw it.
    pub request: RenderRequest,
    /// The mesh, for a backend that needs one.
    pub mesh: Option<SizedMesh>,
    /// Layers to show in addition to the intensities of the case, or instead of them.
    pub layers: KeyedLayers,
}

/// A mesh at a depth, and its size.
#[derive(Debug, Clone, PartialEq)]
pub struct SizedMesh {
    /// Its contours and points.
    pub size: MeshSize,
    /// Its vertices.
    pub mesh: ShrunkMesh,
}

impl RenderBackend {
    /// The backend for a renderer. `auto` is `trace`; `mesh` and `trace` take the graphics device if there is one.
    pub fn choose(renderer: Renderer, device: Option<Arc<GpuPool>>) -> Self {
        match (renderer, device) {
            (Renderer::Mesh, Some(pool)) => Self::GpuMesh(pool),
            (Renderer::Auto | Renderer::Trace, Some(pool)) => Self::GpuTrace(pool),
            (Renderer::Mesh, None) => Self::Mesh,
            (Renderer::Auto | Renderer::Trace, None) => Self::Trace,
            (Renderer::Splat, _) => Self::Splat,
        }
    }

    /// Its name in the interfaces: `splat`, `mesh` or `trace`.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Splat => "splat",
            Self::Mesh | Self::GpuMesh(_) => "mesh",
            Self::Trace | Self::GpuTrace(_) => "trace",
        }
    }

    /// The graphics device; `None` for the CPU.
    pub fn adapter(&self) -> Option<&AdapterSummary> {
        match self {
            Self::Splat | Self::Mesh | Self::Trace => None,
            Self::GpuMesh(pool) | Self::GpuTrace(pool) => Some(pool.adapter()),
        }
    }

    /// The device that draws: `cpu`, or the graphics adapter in one line.
    pub fn device(&self) -> String {
        self.adapter()
            .map_or_else(|| "cpu".to_owned(), AdapterSummary::line)
    }

    /// Whether it draws [`RenderJob::mesh`].
    pub fn needs_mesh(&self) -> bool {
        matches!(self, Self::Mesh | Self::GpuMesh(_))
    }

    /// Draws a picture.
    ///
    /// # Errors
    /// [`RenderError::MeshMissing`] for a job without a mesh that needs one, [`RenderError::NoMap`] for a map unless tracing
    /// draws, [`RenderError::Gpu`] if the graphics device fails.
    pub fn draw(&self, job: &RenderJob) -> Result<RenderedFrame, RenderError> {
        let drawn = self.draw_while(job, &|| true)?;
        Ok(drawn.expect("a picture that stays wanted is drawn"))
    }

    /// Queues a picture for the graphics device; `None` if this backend draws on the CPU.
    ///
    /// # Errors
    /// As [`RenderBackend::draw`].
    pub fn begin_on_device(
        &self,
        job: &RenderJob,
    ) -> Result<Option<GpuTicket<RenderedFrame>>, RenderError> {
        match self {
            Self::Splat | Self::Mesh | Self::Trace => Ok(None),
            Self::GpuMesh(pool) | Self::GpuTrace(pool) => {
                Ok(Some(pool.begin_draw(self.gpu_job(job)?)?))
            }
        }
    }

    /// Draws a picture; `None` soon after it is no longer wanted. A graphics device finishes the pictures it has begun.
    ///
    /// # Errors
    /// As [`RenderBackend::draw`].
    pub fn draw_while(
        &self,
        job: &RenderJob,
        is_wanted: &Wanted<'_>,
    ) -> Result<Option<RenderedFrame>, RenderError> {
        self.check(job)?;
        let (scene, request) = (job.scene(), &job.request);
        let frame = match self {
            Self::Splat => draw_splat(&scene, request, is_wanted),
            Self::Mesh => draw_mesh(&scene, request, job.facets()?, is_wanted),
            Self::Trace => draw_trace(&scene, request, is_wanted),
            Self::GpuMesh(pool) | Self::GpuTrace(pool) => {
                return Ok(Some(pool.draw(self.gpu_job(job)?)?));
            }
        };
        Ok(frame.map(|frame| RenderedFrame {
            frame,
            reduction: None,
        }))
    }

    /// Finds what the centre of each pixel shows, without drawing it.
    ///
    /// # Errors
    /// As [`RenderBackend::draw`].
    pub fn hits(&self, job: &RenderJob) -> Result<Hits, RenderError> {
        self.check(job)?;
        let (scene, request) = (job.case.scene(), &job.request);
        Ok(match self {
            Self::Splat => splat_hits(&scene, request),
            Self::Mesh => mesh_hits(&scene, request, job.facets()?),
            Self::Trace => trace_hits(&scene, request),
            Self::GpuMesh(pool) | Self::GpuTrace(pool) => pool.hits(self.gpu_job(job)?)?,
        })
    }

    /// Maps are for tracing alone.
    fn check(&self, job: &RenderJob) -> Result<(), RenderError> {
        let is_map = job.request.parameters().map.is_some();
        match is_map && !self.draws_maps() {
            true => Err(RenderError::NoMap),
            false => Ok(()),
        }
    }

    /// Whether it draws the discs of maps.
    pub fn draws_maps(&self) -> bool {
        matches!(self, Self::Trace | Self::GpuTrace(_))
    }

    fn gpu_job(&self, job: &RenderJob) -> Result<GpuJob, RenderError> {
        self.check(job)?;
        let surface = if self.needs_mesh() {
            let SizedMesh { size, mesh } = job.mesh.clone().ok_or(RenderError::MeshMissing)?;
            GpuSurface::Mesh { size, mesh }
        } else {
            GpuSurface::Trace
        };
        Ok(GpuJob {
            case: job.case.clone(),
            request: job.request,
            layers: job.layers.clone(),
            surface,
        })
    }
}

impl RenderJob {
    /// The scene to draw, with its layers.
    pub fn scene(&self) -> Scene<'_> {
        self.case.scene().with_layers(self.layers.layers())
    }

    fn facets(&self) -> Result<Facets<'_>, RenderError> {
        let SizedMesh { size, mesh } = self.mesh.as_ref().ok_or(RenderError::MeshMissing)?;
        Ok(Facets::new(*size, mesh))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;
    use crate::conformance::{Limits, check, job};

    const CPU: [RenderBackend; 3] = [
        RenderBackend::Splat,
        RenderBackend::Mesh,
        RenderBackend::Trace,
    ];

    #[test]
    fn splat_does_what_a_renderer_must() {
        let limits = Limits {
            depth_voxels: 0.5,
            mean_difference: 3.0,
        };
        check(RenderBackend::Splat, limits);
    }

    #[test]
    fn trace_does_what_a_renderer_must() {
        // 0.02 mm of 1.25.
        let limits = Limits {
            depth_voxels: 0.016,
            mean_difference: 0.0,
        };
        check(RenderBackend::Trace, limits);
    }

    #[test]
    fn the_mesh_on_the_cpu_does_what_a_renderer_must() {
        let limits = Limits {
            depth_voxels: 0.5,
            mean_difference: 3.0,
        };
        check(RenderBackend::Mesh, limits);
    }

    #[test]
    fn a_picture_that_is_not_wanted_any_more_is_given_up() {
        let job = job();
        for backend in CPU {
            let asked = AtomicUsize::new(0);
            let few_times = || asked.fetch_add(1, Ordering::Relaxed) < 3;
            assert_eq!(backend.draw_while(&job, &few_times), Ok(None));
            assert!(asked.load(Ordering::Relaxed) > 3);
            let wanted = backend.draw_while(&job, &|| true).unwrap();
            assert_eq!(wanted, Some(backend.draw(&job).unwrap()));
        }
    }

    #[test]
    fn without_a_device_each_renderer_draws_on_the_cpu_and_auto_traces() {
        let chosen = |renderer| RenderBackend::choose(renderer, None).to_string();
        assert_eq!(chosen(Renderer::Auto), "trace on cpu");
        assert_eq!(chosen(Renderer::Splat), "splat on cpu");
        assert_eq!(chosen(Renderer::Mesh), "mesh on cpu");
        assert_eq!(chosen(Renderer::Trace), "trace on cpu");
    }

    #[test]
    fn a_mesh_is_asked_for_only_where_it_is_drawn() {
        let job = RenderJob {
            mesh: None,
            ..job()
        };
        for backend in CPU {
            let missing = backend.needs_mesh().then_some(RenderError::MeshMissing);
            assert_eq!(backend.draw(&job).err(), missing);
            assert_eq!(backend.hits(&job).err(), missing);
        }
    }
}
