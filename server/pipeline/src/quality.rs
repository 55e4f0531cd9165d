//! How far a mask can be trusted: what was measured of it, and what that means.

use case::{MaskMethod, Quality, QualityNumbers, QualityState};
use extraction::{MaskNumbers, Method, Verdict};
use geometry::{BrainMask, Envelope, Grid};

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

/// The method of an extraction.
pub fn method_of(method: Method) -> MaskMethod {
    match method {
        Method::Network => MaskMethod::Network,
        Method::TreePruning => MaskMethod::TreePruning,
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
