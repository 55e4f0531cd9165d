//! The rotation frame rate of the paper.

use std::time::{Duration, Instant};

use glam::DQuat;
use render::{
    Camera, FrameSize, NamedView, RenderBackend, RenderJob, RenderParameters, RenderRequest,
    SizedMesh,
};

use crate::{BenchError, Cost, PreparedHead, Summary, timed};

/// The angle between two frames, in degrees.
const STEP_DEGREES: f64 = 1.0;

/// The name of a backend in the tables, which states whether its graphics device is software.
pub fn backend_label(backend: &RenderBackend) -> &'static str {
    let is_software = backend.adapter().map(|adapter| adapter.is_software);
    match (backend.needs_mesh(), is_software) {
        (_, None) => backend.name(),
        (true, Some(true)) => "mesh, software device",
        (true, Some(false)) => "mesh, graphics device",
        (false, Some(_)) => "trace, graphics device",
    }
}

/// A rotation of the head about its vertical axis, one degree per frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spin {
    /// The greatest number of frames: 360 per turn.
    pub frames: usize,
    /// The longest time, in seconds; at least one frame is drawn.
    pub seconds: f64,
    /// Size of a frame.
    pub size: FrameSize,
    /// Depth of the isosurface, in mm.
    pub depth_mm: f32,
}

/// A rotation frame rate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rate {
    /// Frames per second over the whole time.
    pub frames_per_s: f64,
    /// The times of single frames, in seconds.
    pub wall_s: Summary,
    /// CPU time of all threads divided by the frames, in seconds.
    pub cpu_s: Option<f64>,
    /// The time of the picture before the first frame, which includes the upload of textures, in seconds.
    pub first_s: f64,
}

impl Spin {
    /// The request of a frame.
    ///
    /// # Errors
    /// If the depth is out of range.
    pub fn request(&self, head: &PreparedHead, frame: usize) -> Result<RenderRequest, BenchError> {
        let turn = DQuat::from_rotation_z((frame as f64 * STEP_DEGREES).to_radians());
        let orientation = NamedView::Left.orientation() * turn;
        Ok(RenderRequest::new(RenderParameters {
            depth_mm: f64::from(self.depth_mm),
            camera: Camera::new(orientation.to_array(), 1.0, [0.0; 2])?,
            size: self.size,
            ..RenderParameters::new(head.window)
        })?)
    }

    /// Turns the head and measures frames. `mesh` is for backends that draw one.
    ///
    /// # Errors
    /// If a frame cannot be drawn.
    pub fn rate(
        &self,
        head: &PreparedHead,
        backend: &RenderBackend,
        mesh: Option<SizedMesh>,
    ) -> Result<Rate, BenchError> {
        let mut job = head.job(self.request(head, 0)?, mesh);
        let (first, cost) = timed(|| backend.draw(&job));
        first?;
        let (frames, spin): (Result<Vec<f64>, BenchError>, Cost) =
            timed(|| self.frames(head, backend, &mut job));
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
        head: &PreparedHead,
        backend: &RenderBackend,
        job: &mut RenderJob,
    ) -> Result<Vec<f64>, BenchError> {
        let enough = Duration::from_secs_f64(self.seconds);
        let begin = Instant::now();
        let mut times = Vec::new();
        loop {
            job.request = self.request(head, times.len())?;
            let (frame, cost) = timed(|| backend.draw(job));
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

    fn case() -> PreparedHead {
        let head = Head::phantom(4.0).unwrap();
        PreparedHead::prepare(&head, 10.0).unwrap().0
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
        let counted = spin(7, 60.0)
            .rate(&case, &RenderBackend::Splat, None)
            .unwrap();
        assert_eq!(counted.wall_s.count, 7);
        let timed = spin(1_000_000, 0.05);
        let timed = timed.rate(&case, &RenderBackend::Splat, None).unwrap();
        assert!(timed.wall_s.count < 1_000_000 && timed.frames_per_s > 0.0);
    }

    #[test]
    fn a_quarter_of_a_turn_from_the_left_shows_the_front_or_the_back() {
        let case = case();
        let spin = spin(1, 1.0);
        let towards_viewer = |frame| {
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
