//! The steps of a preparation and their costs.

use std::fmt;

use geometry::BuildStep;

use crate::clock::Instants;
use crate::{Cost, Costs};

/// A step of the preparation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// Reading volume and mask from the bytes of the files.
    Reading,
    /// Resampling the mask to the working grid.
    Mask,
    /// Closing the mask to the envelope.
    Closing,
    /// Cropping the volume to the envelope.
    Crop,
    /// A step of building the model.
    Build(BuildStep),
    /// Computing the window and the plane between the hemispheres.
    Facts,
    /// Smoothing the depth field for normals.
    Normals,
}

impl Step {
    /// All steps in their order.
    pub const ALL: [Self; 13] = [
        Self::Reading,
        Self::Mask,
        Self::Closing,
        Self::Crop,
        Self::Build(BuildStep::Distance),
        Self::Build(BuildStep::Core),
        Self::Build(BuildStep::Forest),
        Self::Build(BuildStep::Field),
        Self::Build(BuildStep::Mesh),
        Self::Build(BuildStep::Table),
        Self::Build(BuildStep::Shell),
        Self::Facts,
        Self::Normals,
    ];

    /// Whether facets (Table 2 of the paper) need this step before their first picture.
    pub fn is_for_meshes(self) -> bool {
        self != Self::Facts
    }

    /// Whether voxel projection (Table 3 of the paper) needs this step before its first picture.
    pub fn is_for_voxels(self) -> bool {
        use BuildStep::{Core, Forest, Mesh, Table};
        let is_for_paths = matches!(self, Self::Build(Core | Forest | Mesh | Table));
        self.is_for_meshes() && !is_for_paths
    }
}

impl fmt::Display for Step {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Reading => "reading both files",
            Self::Mask => "mask to the working grid",
            Self::Closing => "closing to the envelope",
            Self::Crop => "crop of the volume",
            Self::Build(BuildStep::Distance) => "exact distance map",
            Self::Build(BuildStep::Core) => "core",
            Self::Build(BuildStep::Forest) => "forest",
            Self::Build(BuildStep::Field) => "depth field",
            Self::Build(BuildStep::Mesh) => "envelope mesh",
            Self::Build(BuildStep::Table) => "table of paths",
            Self::Build(BuildStep::Shell) => "shell index",
            Self::Facts => "window and plane between the hemispheres",
            Self::Normals => "smoothed field, for normals",
        })
    }
}

/// The cost of each step.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct StepCosts(Vec<(Step, Cost)>);

impl StepCosts {
    /// The cost of one step; zero for a step that was not performed.
    pub fn of(&self, step: Step) -> Cost {
        self.sum(|other| other == step)
    }

    /// The total cost of the steps for which `are` is true.
    pub fn sum(&self, are: impl Fn(Step) -> bool) -> Cost {
        let zero = Cost {
            wall_s: 0.0,
            cpu_s: Some(0.0),
        };
        let meant = self.0.iter().filter(|(step, _)| are(*step));
        meant.fold(zero, |sum, (_, cost)| sum.and(*cost))
    }
}

/// The total costs of some steps over several preparations.
pub(crate) fn sums(runs: &[StepCosts], are: impl Fn(Step) -> bool) -> Costs {
    runs.iter().map(|costs| costs.sum(&are)).collect()
}

/// A timer for a preparation: a step ends when the next one begins.
#[derive(Debug, Default)]
pub(crate) struct StepClock {
    begun: Option<(Step, Instants)>,
    costs: StepCosts,
}

impl StepClock {
    /// Ends the previous step and begins this one.
    pub(crate) fn begin(&mut self, step: Step) {
        self.end();
        self.begun = Some((step, Instants::now()));
    }

    /// Ends the last step.
    pub(crate) fn finish(mut self) -> StepCosts {
        self.end();
        self.costs
    }

    fn end(&mut self) {
        if let Some((step, begin)) = self.begun.take() {
            self.costs.0.push((step, begin.cost()));
        }
    }
}
