//! The quality of a mask: measurements and a rating.

use case::{CorrectedHeader, MaskMethod, Quality, QualityNumbers, QualityState};
use extraction::{Judgement, MaskNumbers, Method, Reason, Verdict};
use geometry::{BrainMask, Envelope, Grid};
use glam::DVec3;

use super::affine::rows_of;

/// Combines the measurements of a supplied mask with its rating, if it was compared with the volume.
///
/// A supplied mask is at worst `review`, because somebody chose it. The volume added by the closing is not rated,
/// because masks may follow the sulci.
pub fn of_supplied(
    measured: QualityNumbers,
    method: MaskMethod,
    judgement: Option<&Judgement>,
) -> Quality {
    let numbers = MaskNumbers {
        volume_ml: measured.brain_ml,
        largest_component: measured.largest_component,
        cut_area_cm2: measured.cut_area_cm2,
    };
    let doubts = match judgement {
        Some(judgement) => judgement.doubts.clone(),
        None => numbers.doubts(),
    };
    let comparison = judgement.and_then(|judgement| judgement.comparison);
    let reasons: Vec<Reason> = doubts.into_iter().map(|doubt| doubt.reason).collect();
    Quality {
        state: if reasons.is_empty() {
            QualityState::Ok
        } else {
            QualityState::Review
        },
        method,
        numbers: QualityNumbers {
            contrast: judgement.and_then(|judgement| judgement.contrast),
            rim: judgement.and_then(|judgement| judgement.rim.map(|rim| rim.here)),
            overlap: comparison.map(|comparison| comparison.overlap),
            distance_95_mm: comparison.map(|comparison| comparison.apart.percentile_95_mm),
            distance_mean_mm: comparison.map(|comparison| comparison.apart.mean_mm),
            distant_cm2: comparison.map(|comparison| comparison.apart.patch_cm2),
            ..measured
        },
        reason_codes: codes(&reasons),
        reasons: sentences(reasons),
        corrected_header: None,
    }
}

fn codes(reasons: &[Reason]) -> Vec<String> {
    reasons
        .iter()
        .map(|reason| reason.code.to_owned())
        .collect()
}

fn sentences(reasons: Vec<Reason>) -> Vec<String> {
    reasons.into_iter().map(|reason| reason.sentence).collect()
}

/// Combines the rating of an extracted mask with the measurements of the mask in use.
pub fn of_extracted(
    measured: QualityNumbers,
    method: MaskMethod,
    found: &extraction::Quality,
    volume_grid: &Grid,
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
        reason_codes: codes(&found.reasons),
        reasons: sentences(found.reasons.clone()),
        corrected_header: found
            .other_patient_from_voxel
            .map(|turned| CorrectedHeader::reflected_at(middle(volume_grid).x, rows_of(turned))),
    }
}

/// The centre of a grid, LPS mm.
fn middle(grid: &Grid) -> DVec3 {
    let last = DVec3::from_array(grid.size().map(|side| (side - 1) as f64));
    grid.patient_from_voxel().transform_point3(last / 2.0)
}

/// The method of an extraction.
pub fn method_of(method: Method) -> MaskMethod {
    match method {
        Method::Network => MaskMethod::Network,
        Method::TreePruning => MaskMethod::TreePruning,
    }
}

/// Measures a brain mask and its envelope. The share of its largest component, and the area on what cuts it, were measured before
/// its surface was moved.
pub fn measure(
    brain: &BrainMask,
    envelope: &Envelope,
    (largest_component, cut_area_cm2): (f64, [f64; 6]),
) -> QualityNumbers {
    let brain_ml = brain.volume_ml();
    QualityNumbers {
        brain_ml,
        closing_added: envelope.volume_ml() / brain_ml - 1.0,
        largest_component,
        extents_mm: brain.extents_mm(),
        cut_area_cm2,
        agreement: None,
        uncertain: None,
        contrast: None,
        rim: None,
        overlap: None,
        distance_95_mm: None,
        distance_mean_mm: None,
        distant_cm2: None,
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
            rim: None,
            overlap: None,
            distance_95_mm: None,
            distance_mean_mm: None,
            distant_cm2: None,
        }
    }

    fn state(numbers: QualityNumbers) -> (QualityState, usize) {
        let quality = of_supplied(numbers, MaskMethod::Supplied, None);
        assert_eq!(quality.reasons.len(), quality.reason_codes.len());
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

    #[test]
    fn a_brain_that_is_cut_off_below_is_told_from_one_whose_stem_leaves_the_volume() {
        for (area_cm2, expected) in [(14.9, vec![]), (15.0, vec!["mask-cut-inferior"])] {
            let mut cut = numbers();
            cut.cut_area_cm2[5] = area_cm2;
            let quality = of_supplied(cut, MaskMethod::Supplied, None);
            assert_eq!(quality.reason_codes, expected);
        }
    }
}
