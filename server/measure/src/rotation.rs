//! How fast a head turns: the paper's rotation frame rate.

use std::sync::Arc;
use std::time::{Duration, Instant};

use geometry::{MeshSize, ShrunkMesh};
use glam::DQuat;
use render::gpu::{GpuJob, GpuPool, GpuSurface};
use render::{
    Camera, Facets, Frame, FrameSize, NamedView, RenderParameters, RenderRequest, draw_mesh,
    draw_splat, draw_trace,
};

use crate::{Cost, MeasureError, MeasuredCase, Summary, timed};

/// Degrees between two frames.
const STEP_DEGREES: f64 = 1.0;

/// Who draws.
#[derive(Debug, Clone)]
pub enum Painter {
    /// Voxel projection, on the processor.
    Splat,
    /// The facets, on the processor.
    Mesh,
    /// Sphere tracing, on the processor.
    Trace,
    /// The facets, on a graphics device.
    GpuMesh(Arc<GpuPool>),
    /// Sphere tracing, on a graphics device.
    GpuTrace(Arc<GpuPool>),
}

impl Painter {
    /// Its name, and whether the graphics device that it draws on is a program.
    pub fn name(&self) -> &'static str {
        let is_software = |pool: &GpuPool| pool.adapter().is_software;
        match self {
            Self::Splat => "splat",
            Self::Mesh => "mesh",
            Self::Trace => "trace",
            Self::GpuMesh(pool) if is_software(pool) => "mesh, device in software",
            Self::GpuMesh(_) => "mesh, graphics device",
            Self::GpuTrace(_) => "trace, graphics device",
        }
    }

    /// Whether it draws facets.
    pub fn draws_mesh(&self) -> bool {
        matches!(self, Self::Mesh | Self::GpuMesh(_))
    }

    /// Draws a picture; `mesh` is what a painter of meshes draws.
    ///
    /// # Errors
    /// When the graphics device fails.
    ///
    /// # Panics
    /// When a painter of meshes is given none.
    pub fn draw(
        &self,
        case: &Arc<MeasuredCase>,
        request: RenderRequest,
        mesh: Option<&(MeshSize, ShrunkMesh)>,
    ) -> Result<Frame, MeasureError> {
        use render::gpu::GpuCase as _;
        let given = || mesh.expect("a mesh for a painter of meshes");
        let (pool, surface) = match self {
            Self::Splat => return Ok(draw_splat(&case.scene(), &request)),
            Self::Trace => return Ok(draw_trace(&case.scene(), &request)),
            Self::Mesh => {
                let (size, mesh) = given();
                let facets = Facets::new(*size, mesh);
                return Ok(draw_mesh(&case.scene(), &request, facets));
            }
            Self::GpuTrace(pool) => (pool, GpuSurface::Trace),
            Self::GpuMesh(pool) => {
                let (size, mesh) = given().clone();
                (pool, GpuSurface::Mesh { size, mesh })
            }
        };
        let case = Arc::clone(case) as Arc<dyn render::gpu::GpuCase>;
        let job = GpuJob {
            case,
            request,
            surface,
        };
        Ok(pool.draw(job)?.frame)
    }
}

/// A head that turns about its vertical axis, a degree from frame to frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spin {
    /// Frames at most: 360 to a turn.
    pub frames: usize,
    /// Time at most, in seconds; at least one frame is drawn.
    pub seconds: f64,
    /// Size of a frame.
    pub size: FrameSize,
    /// Depth of the isosurface, in mm.
    pub depth_mm: f32,
}

/// A rotation frame rate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rate {
    /// Frames over the time they took together.
    pub frames_per_s: f64,
    /// Of one frame, in seconds.
    pub wall_s: Summary,
    /// Processor time of all threads over the frames, in seconds.
    pub cpu_s: Option<f64>,
    /// Time of the picture before the first of these, in which a device gets its textures, in seconds.
    pub first_s: f64,
}

impl Spin {
    /// The request of a frame.
    ///
    /// # Errors
    /// When the depth is out of range.
    pub fn request(
        &self,
        case: &MeasuredCase,
        frame: usize,
    ) -> Result<RenderRequest, MeasureError> {
        let turn = DQuat::from_rotation_z((frame as f64 * STEP_DEGREES).to_radians());
        let orientation = NamedView::Left.orientation() * turn;
        Ok(RenderRequest::new(RenderParameters {
            depth_mm: f64::from(self.depth_mm),
            camera: Camera::new(orientation.to_array(), 1.0, [0.0; 2])?,
            size: self.size,
            ..RenderParameters::new(case.window)
        })?)
    }

    /// Turns the head and counts frames.
    ///
    /// # Errors
    /// When a frame cannot be drawn.
    pub fn rate(
        &self,
        case: &Arc<MeasuredCase>,
        painter: &Painter,
        mesh: Option<&(MeshSize, ShrunkMesh)>,
    ) -> Result<Rate, MeasureError> {
        let (first, cost) = timed(|| painter.draw(case, self.request(case, 0)?, mesh));
        first?;
        let (frames, spin): (Result<Vec<f64>, MeasureError>, Cost) =
            timed(|| self.frames(case, painter, mesh));
        let frames = frames?;
        let count = frames.len() as f64;
        Ok(Rate {
            frames_per_s: count / spin.wall_s,
            cpu_s: spin.cpu_s.map(|cpu_s| cpu_s / count),
            wall_s: Summary::of(frames).expect("at least one frame"),
            first_s: cost.wall_s,
        })
    }

    fn frames(
        &self,
        case: &Arc<MeasuredCase>,
        painter: &Painter,
        mesh: Option<&(MeshSize, ShrunkMesh)>,
    ) -> Result<Vec<f64>, MeasureError> {
        let enough = Duration::from_secs_f64(self.seconds);
        let begin = Instant::now();
        let mut times = Vec::new();
        loop {
            let (frame, cost) =
                timed(|| painter.draw(case, self.request(case, times.len())?, mesh));
            std::hint::black_box(frame?);
            times.push(cost.wall_s);
            if times.len() >= self.frames || begin.elapsed() >= enough {
                return Ok(times);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Head;

    fn case() -> Arc<MeasuredCase> {
        let (case, _) = MeasuredCase::prepare(&Head::phantom(4.0).unwrap(), 10.0).unwrap();
        Arc::new(case)
    }

    fn spin(frames: usize, seconds: f64) -> Spin {
        Spin {
            frames,
            seconds,
            size: FrameSize::new(32, 32).unwrap(),
            depth_mm: 5.0,
        }
    }

    #[test]
    fn a_spin_ends_with_its_frames_or_with_its_time() {
        let case = case();
        let counted = spin(7, 60.0).rate(&case, &Painter::Splat, None).unwrap();
        assert_eq!(counted.wall_s.count, 7);
        let timed = spin(1_000_000, 0.05);
        let timed = timed.rate(&case, &Painter::Splat, None).unwrap();
        assert!(timed.wall_s.count < 1_000_000 && timed.frames_per_s > 0.0);
    }

    #[test]
    fn a_quarter_of_a_turn_from_the_left_shows_the_front_or_the_back() {
        let case = case();
        let spin = spin(1, 1.0);
        let towards_viewer = |frame| {
            use render::gpu::GpuCase as _;
            let request = spin.request(&case, frame).unwrap();
            request
                .projection(&case.scene())
                .towards_viewer_in_patient()
        };
        assert!(towards_viewer(0).x > 0.999);
        assert!(towards_viewer(90).y.abs() > 0.999);
        assert!(towards_viewer(180).x < -0.999);
        assert!(towards_viewer(360).x > 0.999);
    }
}
