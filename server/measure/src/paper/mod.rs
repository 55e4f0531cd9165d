//! The paper's experiments on this machine, by its protocol (sections 4.1 and 4.2), with its own figures beside them.
//!
//! A rotation frame rate is that of four turns or ten seconds, whichever ends first, a degree from frame to frame; of one turn for
//! voxel projection. A mesh derivation time is the average over 50 meshes, from one voxel deep to 50.

mod derivation;
pub mod published;
mod rates;
mod setup;

use std::sync::Arc;

use render::FrameSize;

use crate::{MeasureError, MeasuredCase, Painter, StepCosts, Table};

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
    pub fn inner_depth_mm(&self, case: &MeasuredCase) -> f32 {
        self.inner_depth_mm.min(0.7 * case.distance.max_depth_mm())
    }
}

/// What is measured, and on what.
#[derive(Debug)]
pub struct Experiment<'a> {
    /// The prepared head.
    pub case: &'a Arc<MeasuredCase>,
    /// What each preparation took.
    pub runs: &'a [StepCosts],
    /// Who draws; of meshes, one at most.
    pub painters: &'a [Painter],
    /// For how long.
    pub protocol: Protocol,
    /// Is told what is measured next.
    pub tell: &'a dyn Telling,
}

/// Something that is told what goes on.
pub trait Telling: std::fmt::Debug + Sync {
    /// What is measured next.
    fn tell(&self, what: &str);
}

/// Nobody is told.
#[derive(Debug, Clone, Copy)]
pub struct Silent;

impl Telling for Silent {
    fn tell(&self, _: &str) {}
}

impl Experiment<'_> {
    /// The steps of the setup; Tables 2 and 3; Figures 5 and 6.
    ///
    /// # Errors
    /// When a picture cannot be drawn or a mesh not be cut.
    pub fn tables(&self) -> Result<Vec<Table>, MeasureError> {
        let steps = setup::table(self);
        self.tell.tell("Figure 6: mesh derivation times");
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

    /// The painter of meshes, if there is one.
    pub fn mesh_painter(&self) -> Option<&Painter> {
        self.painters.iter().find(|painter| painter.draws_mesh())
    }
}
