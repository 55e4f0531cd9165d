//! The experiments of the paper on this machine, by its protocol (sections 4.1 and 4.2), beside the published figures.
//!
//! A rotation frame rate is measured over four turns or ten seconds, whichever ends first, at one degree per frame;
//! over one turn for voxel projection. A mesh derivation time is the mean over 50 meshes, from one voxel deep to 50.

mod derivation;
mod pictures;
pub mod published;
mod rates;
mod sentences;
mod setup;

pub use pictures::{Picture, pictures};

use render::{FrameSize, RenderBackend};

use crate::{BenchError, PreparedHead, StepCosts, Table};

/// The durations and sizes of the measurements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Protocol {
    /// The longest time for a frame rate, in seconds; 10 in the paper.
    pub seconds: f64,
    /// The number of repetitions of everything but frames.
    pub repeat: usize,
    /// Size of a frame. The paper does not state its own.
    pub size: FrameSize,
    /// Depth of the deep isosurface, without sulci, in mm; limited by [`Protocol::inner_depth_mm`].
    pub inner_depth_mm: f32,
}

impl Protocol {
    /// The protocol of the paper.
    pub fn paper() -> Self {
        Self {
            seconds: 10.0,
            repeat: 5,
            size: FrameSize::default(),
            inner_depth_mm: 40.0,
        }
    }

    /// The inner depth of a case: at most 0.7 of its greatest depth.
    pub fn inner_depth_mm(&self, head: &PreparedHead) -> f32 {
        self.inner_depth_mm.min(0.7 * head.distance.max_depth_mm())
    }
}

/// An experiment.
pub struct Experiment<'a> {
    /// The prepared head.
    pub head: &'a PreparedHead,
    /// The costs of each preparation.
    pub runs: &'a [StepCosts],
    /// The backends.
    pub backends: &'a [RenderBackend],
    /// The protocol.
    pub protocol: Protocol,
    /// Receives the name of the next measurement.
    pub progress: &'a dyn Fn(&str),
}

impl Experiment<'_> {
    /// The steps of the setup; Tables 2 and 3; Figures 5 and 6; sentences of the paper that state or imply a number.
    ///
    /// # Errors
    /// If a picture cannot be drawn or a mesh cannot be made.
    pub fn tables(&self) -> Result<Vec<Table>, BenchError> {
        let steps = setup::table(self);
        (self.progress)("Figure 6: mesh derivation times");
        let derivations = derivation::measure(self)?;
        let spins = rates::measure(self)?;
        let mut tables = vec![
            steps,
            rates::table_2(self, &spins, &derivations),
            rates::table_3(self, &spins),
            rates::figure_5(self, &spins),
            derivation::figure_6(&derivations),
        ];
        (self.progress)("contours, degenerate triangles, closest points, shells");
        tables.extend(sentences::tables(self.head)?);
        Ok(tables)
    }

    /// The backend that draws meshes in Table 2, if there is one.
    fn mesh_backend(&self) -> Option<&RenderBackend> {
        self.backends.iter().find(|backend| backend.needs_mesh())
    }
}
