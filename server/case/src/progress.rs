//! The state and the progress of a case.

use serde::{Deserialize, Serialize};
use strum::{EnumString, IntoStaticStr};

/// The state of a case.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, EnumString, IntoStaticStr,
)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "snake_case")]
pub enum CaseState {
    /// It waits for a worker.
    Queued,
    /// A worker prepares it.
    Preparing,
    /// It is prepared: meshes and pictures are available.
    Ready,
    /// It could not be prepared; the [`Failure`](crate::Failure) states why. Uploading it again starts another attempt.
    Failed,
}

impl CaseState {
    /// The name used in JSON and in rows.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// The state with a name; `None` if there is none.
    pub fn from_name(name: &str) -> Option<Self> {
        name.parse().ok()
    }

    /// Whether the state stays the same until somebody uploads or deletes.
    pub fn is_final(self) -> bool {
        matches!(self, Self::Ready | Self::Failed)
    }
}

/// The stages of a preparation, in order.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize, IntoStaticStr,
)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// The uploaded bytes are read.
    Reading,
    /// The brain is extracted. Skipped if a mask was supplied or the volume is skull-stripped.
    Extracting,
    /// The brain mask is resampled to the working grid.
    Mask,
    /// The mask is closed to the envelope.
    Closing,
    /// The exact distance map is computed.
    Distance,
    /// The core, which seeds the forest, is found.
    Core,
    /// The optimal-path forest is computed.
    Forest,
    /// The default mesh and the table of its paths are computed.
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

    /// The name used in JSON and in rows.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// The progress of a preparation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = ProgressView))]
pub struct Progress {
    /// `reading`, `extracting`, `mask`, `closing`, `distance`, `core`, `forest`, `mesh` or `storing`.
    #[cfg_attr(feature = "openapi", schema(value_type = String))]
    pub stage: Stage,
    /// The finished fraction of the whole preparation, 0 to 1.
    pub fraction: f32,
}

/// The finished fraction when a stage begins, from the timings of a head of 256³.
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
    /// The progress at the beginning of a stage.
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
