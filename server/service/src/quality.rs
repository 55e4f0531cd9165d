//! How far a mask can be trusted: what was measured of it, and what that means.

use extraction::{MaskNumbers, Method, Verdict};
use geometry::{BrainMask, Envelope, Grid};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// The verdict on a mask.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum QualityState {
    /// Nothing is unusual.
    Ok,
    /// Look at the quality sheet before anything is read from the case.
    Review,
    /// The mask is not that of a brain; replace it.
    Failed,
}

impl QualityState {
    /// The name used in JSON and in headers.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Review => "review",
            Self::Failed => "failed",
        }
    }
}

/// Where a mask came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum MaskMethod {
    /// It was supplied.
    Supplied,
    /// The volume was skull-stripped already.
    Volume,
    /// The network extracted it.
    Network,
    /// Tree pruning extracted it.
    TreePruning,
}

impl MaskMethod {
    /// Where the mask came from, in words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Supplied => "mask as supplied",
            Self::Volume => "mask from the skull-stripped volume",
            Self::Network => "brain extracted by the network",
            Self::TreePruning => "brain extracted by tree pruning",
        }
    }

    /// Whether the brain was extracted by this program.
    pub fn is_extraction(self) -> bool {
        matches!(self, Self::Network | Self::TreePruning)
    }
}

/// How far the mask of a case can be trusted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Quality {
    /// The verdict.
    pub state: QualityState,
    /// Where the mask came from.
    pub method: MaskMethod,
    /// What was measured.
    pub numbers: QualityNumbers,
    /// Why the verdict is not `ok`: plain sentences; none where it is.
    pub reasons: Vec<String>,
}

/// What was measured of a mask.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct QualityNumbers {
    /// Volume of the brain mask.
    pub brain_ml: f64,
    /// What the closing and the filling of holes added, as a share of the brain mask.
    pub closing_added: f64,
    /// Share of the mask that is in its largest piece, which alone is kept.
    pub largest_component: f64,
    /// Extents along left to right, front to back and top to bottom.
    pub extents_mm: [f64; 3],
    /// The brain's area on the faces of the volume at left, right, posterior, anterior, superior and inferior.
    pub cut_area_cm2: [f64; 6],
    /// How well the network's first, coarse look and its mask agree (Dice), where it extracted the brain.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub agreement: Option<f64>,
    /// Voxels of which the network is unsure, as a share of those of the brain.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub uncertain: Option<f64>,
    /// How much brighter the inside of an extracted brain is than its rim, as a share of the range of intensities.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contrast: Option<f64>,
}

/// Measures a supplied mask and judges it.
///
/// It is never `failed`, for somebody chose it: what is unusual about it is said, and put to `review`. What the closing added
/// is not judged, for masks may follow the sulci.
pub fn of_supplied(measured: QualityNumbers, method: MaskMethod) -> Quality {
    let doubts = MaskNumbers {
        volume_ml: measured.brain_ml,
        largest_component: measured.largest_component,
        cut_area_cm2: measured.cut_area_cm2,
    }
    .doubts();
    let state = if doubts.is_empty() {
        QualityState::Ok
    } else {
        QualityState::Review
    };
    Quality {
        state,
        method,
        numbers: measured,
        reasons: doubts.into_iter().map(|doubt| doubt.reason).collect(),
    }
}

/// Joins what the extraction says of its mask with what was measured of the mask as it is used.
pub fn of_extracted(
    measured: QualityNumbers,
    method: MaskMethod,
    found: &extraction::Quality,
) -> Quality {
    Quality {
        state: match found.verdict {
            Verdict::Ok => QualityState::Ok,
            Verdict::Review => QualityState::Review,
            Verdict::Failed => QualityState::Failed,
        },
        method,
        numbers: QualityNumbers {
            agreement: found.agreement,
            uncertain: found.uncertain,
            contrast: found.contrast,
            ..measured
        },
        reasons: found.reasons.clone(),
    }
}

impl From<Method> for MaskMethod {
    fn from(method: Method) -> Self {
        match method {
            Method::Network => Self::Network,
            Method::TreePruning => Self::TreePruning,
        }
    }
}

/// Measures a brain mask and its envelope.
pub fn measure(
    brain: &BrainMask,
    envelope: &Envelope,
    largest_component: f64,
    volume_grid: &Grid,
) -> QualityNumbers {
    let brain_ml = brain.volume_ml();
    QualityNumbers {
        brain_ml,
        closing_added: envelope.volume_ml() / brain_ml - 1.0,
        largest_component,
        extents_mm: brain.extents_mm(),
        cut_area_cm2: brain.cut_area_cm2(volume_grid),
        agreement: None,
        uncertain: None,
        contrast: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers() -> QualityNumbers {
        QualityNumbers {
            brain_ml: 1300.0,
            closing_added: 0.3,
            largest_component: 1.0,
            extents_mm: [130.0, 170.0, 140.0],
            cut_area_cm2: [0.0, 0.0, 0.0, 0.0, 0.0, 9.0],
            agreement: None,
            uncertain: None,
            contrast: None,
        }
    }

    fn state(numbers: QualityNumbers) -> (QualityState, usize) {
        let quality = of_supplied(numbers, MaskMethod::Supplied);
        (quality.state, quality.reasons.len())
    }

    #[test]
    fn a_usual_brain_is_ok_even_where_its_stem_leaves_the_volume() {
        assert_eq!(state(numbers()), (QualityState::Ok, 0));
    }

    #[test]
    fn what_is_unusual_is_put_to_review_with_its_reason() {
        let mut cut = numbers();
        cut.cut_area_cm2[4] = 30.0;
        let apart = QualityNumbers {
            largest_component: 0.9,
            ..numbers()
        };
        let small = QualityNumbers {
            brain_ml: 420.0,
            ..apart.clone()
        };
        assert_eq!(state(cut), (QualityState::Review, 1));
        assert_eq!(state(apart), (QualityState::Review, 1));
        assert_eq!(state(small), (QualityState::Review, 2));
    }
}
