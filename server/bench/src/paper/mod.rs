//! The paper's experiments on this machine, by its protocol (sections 4.1 and 4.2), with its own figures beside them.
//!
//! A rotation frame rate is that of four turns or ten seconds, whichever ends first, a degree from frame to frame; of one turn for
//! voxel projection. A mesh derivation time is the average over 50 meshes, from one voxel deep to 50.

mod derivation;
pub mod published;
mod rates;
mod setup;

use render::{FrameSize, RenderBackend};

use crate::{BenchError, PreparedHead, StepCosts, Table};

/// How long and how large it is measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Protocol {
    /// Seconds at most for a frame rate; the paper's are 10.
    pub seconds: f64,
    /// How often what is not a frame is measured.
    pub repeat: usize,
    /// Size of a frame. The paper does not name its own.
    pub size: FrameSize,
    /// Depth of the deep isosurface, on which no sulci are left, in mm; no deeper than [`Protocol::inner_depth_mm`] says.
    pub inner_depth_mm: f32,
}

impl Protocol {
    /// The paper's.
    pub fn paper() -> Self {
        Self {
            seconds: 10.0,
            repeat: 5,
            size: FrameSize::default(),
            inner_depth_mm: 40.0,
        }
    }

    /// The inner depth on a case: at most seven tenths of its greatest depth.
    pub fn inner_depth_mm(&self, head: &PreparedHead) -> f32 {
        self.inner_depth_mm.min(0.7 * head.distance.max_depth_mm())
    }
}

/// What is measured, and on what.
pub struct Experiment<'a> {
    /// The prepared head.
    pub head: &'a PreparedHead,
    /// What each preparation took.
    pub runs: &'a [StepCosts],
    /// Who draws.
    pub backends: &'a [RenderBackend],
    /// For how long.
    pub protocol: Protocol,
    /// Is called with what is measured next.
    pub progress: &'a dyn Fn(&str),
}

impl Experiment<'_> {
    /// The steps of the setup; Tables 2 and 3; Figures 5 and 6.
    ///
    /// # Errors
    /// When a picture cannot be drawn or a mesh not be cut.
    pub fn tables(&self) -> Result<Vec<Table>, BenchError> {
        let steps = setup::table(self);
        (self.progress)("Figure 6: mesh derivation times");
        let derivations = derivation::measure(self)?;
        let spins = rates::measure(self)?;
        Ok(vec![
            steps,
            rates::table_2(self, &spins, &derivations),
            rates::table_3(self, &spins),
            rates::figure_5(self, &spins),
            derivation::figure_6(&derivations),
        ])
    }

    /// The backend that draws meshes in Table 2, if there is one.
    fn mesh_backend(&self) -> Option<&RenderBackend> {
        self.backends.iter().find(|backend| backend.needs_mesh())
    }
}
