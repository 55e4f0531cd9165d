//! How far a case has come.

use serde::{Deserialize, Serialize};

/// How far a case has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CaseState {
    /// Waits for a worker.
    Queued,
    /// A worker prepares it.
    Preparing,
    /// Everything can be asked of it.
    Ready,
    /// It could not be prepared; the [`Failure`] says why. The same upload again tries again.
    Failed,
}

impl CaseState {
    /// The name used in JSON and in rows.
    pub fn name(self) -> &'static str {
        match self {
            Self::Queued => "queued",
            Self::Preparing => "preparing",
            Self::Ready => "ready",
            Self::Failed => "failed",
        }
    }

    /// Whether the state stays as it is until somebody uploads or deletes.
    pub fn is_final(self) -> bool {
        matches!(self, Self::Ready | Self::Failed)
    }
}

/// The steps of a preparation, in their order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// The uploaded bytes are read.
    Reading,
    /// The brain is extracted. Only where no mask was supplied and the volume shows more than a brain.
    Extracting,
    /// The brain mask comes to the working grid.
    Mask,
    /// The mask is closed to the envelope.
    Closing,
    /// The exact distance map.
    Distance,
    /// The seeds of the forest.
    Core,
    /// The optimal-path forest.
    Forest,
    /// The default mesh and the table of its paths.
    Mesh,
    /// The results are written to the store.
    Storing,
}

impl Stage {
    /// Every stage, in order.
    pub const ALL: [Self; 9] = [
        Self::Reading,
        Self::Extracting,
        Self::Mask,
        Self::Closing,
        Self::Distance,
        Self::Core,
        Self::Forest,
        Self::Mesh,
        Self::Storing,
    ];

    /// The stage of a name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|stage| stage.name() == name)
    }

    /// The name used in JSON and in rows.
    pub fn name(self) -> &'static str {
        match self {
            Self::Reading => "reading",
            Self::Extracting => "extracting",
            Self::Mask => "mask",
            Self::Closing => "closing",
            Self::Distance => "distance",
            Self::Core => "core",
            Self::Forest => "forest",
            Self::Mesh => "mesh",
            Self::Storing => "storing",
        }
    }
}

/// How far a preparation has come.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Progress {
    /// The step at work.
    pub stage: Stage,
    /// How much of the whole preparation is done, 0 to 1.
    pub fraction: f32,
}

/// How much of a preparation is done when a stage begins: from the timings of a head of 256³.
fn fraction_at(stage: Stage) -> f32 {
    match stage {
        Stage::Reading => 0.0,
        Stage::Extracting => 0.04,
        Stage::Mask => 0.18,
        Stage::Closing => 0.24,
        Stage::Distance => 0.32,
        Stage::Core => 0.36,
        Stage::Forest => 0.40,
        Stage::Mesh => 0.80,
        Stage::Storing => 0.90,
    }
}

impl Progress {
    /// The progress of a preparation that begins a stage.
    pub fn at(stage: Stage) -> Self {
        Self {
            stage,
            fraction: fraction_at(stage),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stages_have_one_name_in_json_and_in_rows() {
        for stage in Stage::ALL {
            assert_eq!(serde_json::to_value(stage).unwrap(), stage.name());
        }
    }

    #[test]
    fn fractions_grow_from_stage_to_stage() {
        let fractions = Stage::ALL.map(fraction_at);
        assert!(fractions.is_sorted() && fractions[0] == 0.0 && fractions[8] < 1.0);
    }
}
