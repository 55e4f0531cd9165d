//! Who draws a picture, and the drawing of it.

use std::sync::Arc;

use geometry::{MeshSize, ShrunkMesh};
use render::gpu::{AdapterSummary, GpuCase, GpuJob, GpuPool, GpuSurface};
use render::{Facets, Frame, RenderRequest, Wanted};

use super::graphics::Graphics;
use crate::error::Error;
use render::choice::Renderer;

/// Who draws a picture on this machine.
#[derive(Debug, Clone)]
pub enum Drawer {
    /// Splatting, on the processor.
    Splat,
    /// The mesh, on the processor.
    Mesh,
    /// Sphere tracing, on the processor.
    Trace,
    /// The mesh, on a graphics device.
    GpuMesh(Arc<GpuPool>),
    /// Sphere tracing, on a graphics device.
    GpuTrace(Arc<GpuPool>),
}

impl Drawer {
    /// Who draws what was asked for: with `auto`, `mesh` and `trace` the graphics device where there is one that may be used.
    pub async fn choose(asked: Renderer, graphics: &Graphics) -> Self {
        if asked == Renderer::Splat {
            return Self::Splat;
        }
        let Some(pool) = graphics.pool().await else {
            return Self::on_processor(asked);
        };
        match asked {
            Renderer::Mesh => Self::GpuMesh(pool),
            _ => Self::GpuTrace(pool),
        }
    }

    /// Who draws what was asked for where no graphics device does.
    fn on_processor(asked: Renderer) -> Self {
        match asked {
            // As near to the exact picture as any, and the fastest that is.
            Renderer::Auto | Renderer::Splat => Self::Splat,
            Renderer::Mesh => Self::Mesh,
            Renderer::Trace => Self::Trace,
        }
    }

    /// Its name in the interface.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Splat => "splat",
            Self::Trace | Self::GpuTrace(_) => "trace",
            Self::Mesh | Self::GpuMesh(_) => "mesh",
        }
    }

    /// The device that draws: `cpu`, or the name of the graphics adapter and its driver.
    ///
    /// Pictures of the processor are the same bytes everywhere; those of graphics devices are not.
    pub fn device(&self) -> String {
        match self {
            Self::Splat | Self::Mesh | Self::Trace => "cpu".to_owned(),
            Self::GpuMesh(pool) | Self::GpuTrace(pool) => device_name(pool.adapter()),
        }
    }

    /// Renderer and device, for entity tags.
    pub fn tag(&self) -> String {
        format!("{} on {}", self.name(), self.device())
    }

    /// Whether it wants a mesh.
    pub fn wants_mesh(&self) -> bool {
        matches!(self, Self::Mesh | Self::GpuMesh(_))
    }
}

/// An adapter in one line of printable ASCII, as headers want it.
pub fn device_name(adapter: &AdapterSummary) -> String {
    let text = format!(
        "{} ({}, {})",
        adapter.name, adapter.interface, adapter.driver
    );
    let printable = |letter: char| {
        if matches!(letter, ' '..='~') {
            letter
        } else {
            '?'
        }
    };
    text.chars().take(200).map(printable).collect()
}

/// A picture that can be drawn: everything that it needs is at hand. Cheap to clone but for its mesh.
#[derive(Clone)]
pub struct Drawing {
    /// What is drawn.
    pub case: Arc<dyn GpuCase>,
    /// How.
    pub request: RenderRequest,
    /// What was asked for.
    pub asked: Renderer,
    /// By whom.
    pub drawer: Drawer,
    /// The mesh, where the drawer wants one.
    pub mesh: Option<(MeshSize, ShrunkMesh)>,
}

/// A picture that was drawn.
#[derive(Debug)]
pub struct Drawn {
    /// The picture.
    pub frame: Frame,
    /// Who drew it, after all.
    pub drawer: Drawer,
    /// How many native voxels along x, y and z became one, where the volume is too large for the device.
    pub reduction: Option<[usize; 3]>,
}

impl Drawing {
    /// Draws. Where a graphics device fails the processor draws: the same as was asked for, splats with `auto`.
    ///
    /// # Errors
    /// [`Error::Unavailable`] soon after the picture is no longer wanted.
    pub fn draw(mut self, is_wanted: &Wanted<'_>) -> Result<Drawn, Error> {
        let (pool, surface) = match &self.drawer {
            Drawer::Splat | Drawer::Mesh | Drawer::Trace => {
                return self.draw_in_software(is_wanted);
            }
            Drawer::GpuTrace(pool) => (pool, GpuSurface::Trace),
            Drawer::GpuMesh(pool) => {
                let (size, mesh) = self.mesh.clone().ok_or(Error::Internal)?;
                (pool, GpuSurface::Mesh { size, mesh })
            }
        };
        let job = GpuJob {
            case: Arc::clone(&self.case),
            request: self.request,
            surface,
        };
        let drawn = pool.begin_draw(job).map_or_else(
            |error| Some(Err(error)),
            |ticket| ticket.wait_while(is_wanted),
        );
        match drawn.ok_or(Error::Unavailable)? {
            Ok(drawn) => Ok(Drawn {
                frame: drawn.frame,
                drawer: self.drawer,
                reduction: drawn.reduction,
            }),
            Err(error) => {
                tracing::warn!(%error, "the graphics device did not draw: the processor does");
                self.drawer = Drawer::on_processor(self.asked);
                self.draw_in_software(is_wanted)
            }
        }
    }

    fn draw_in_software(self, is_wanted: &Wanted<'_>) -> Result<Drawn, Error> {
        let (scene, request) = (self.case.scene(), &self.request);
        let frame = match &self.drawer {
            Drawer::Mesh | Drawer::GpuMesh(_) => {
                let (size, mesh) = self.mesh.as_ref().ok_or(Error::Internal)?;
                render::draw_mesh_while(&scene, request, Facets::new(*size, mesh), is_wanted)
            }
            Drawer::Trace | Drawer::GpuTrace(_) => {
                render::draw_trace_while(&scene, request, is_wanted)
            }
            Drawer::Splat => render::draw_splat_while(&scene, request, is_wanted),
        };
        Ok(Drawn {
            frame: frame.ok_or(Error::Unavailable)?,
            drawer: self.drawer,
            reduction: None,
        })
    }
}
