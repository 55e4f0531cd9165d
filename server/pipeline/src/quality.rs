//! The quality of a mask: measurements and a rating.

use case::{CorrectedHeader, MaskMethod, Quality, QualityNumbers, QualityState};
use extraction::{Method, Rating};
use geometry::{BrainMask, Envelope, Grid};
use glam::DVec3;

use super::affine::rows_of;

/// The rating of a mask with the measurements of the brain in use, whose surface may have been moved since.
pub fn of(
    brain: &BrainMask,
    envelope: &Envelope,
    method: MaskMethod,
    found: &extraction::Quality,
    volume_grid: &Grid,
) -> Quality {
    let brain_ml = brain.volume_ml();
    let distance = found.comparison.map(|comparison| comparison.distance);
    Quality {
        state: match found.rating {
            Rating::Ok => QualityState::Ok,
            Rating::Review => QualityState::Review,
            Rating::Failed => QualityState::Failed,
        },
        method,
        numbers: QualityNumbers {
            brain_ml,
            closing_added: envelope.volume_ml() / brain_ml - 1.0,
            largest_component: found.largest_component,
            extents_mm: brain.extents_mm(),
            cut_area_cm2: found.cut_area_cm2,
            agreement: found.agreement,
            uncertain: found.uncertain,
            contrast: found.contrast,
            rim: found.rim.map(|rim| rim.here),
            overlap: found.comparison.map(|comparison| comparison.overlap),
            distance_95_mm: distance.map(|distance| distance.percentile_95_mm),
            distance_mean_mm: distance.map(|distance| distance.mean_mm),
            distant_cm2: distance.map(|distance| distance.patch_cm2),
        },
        reasons: (found.reasons.iter())
            .map(|reason| reason.sentence.clone())
            .collect(),
        reason_codes: (found.reasons.iter())
            .map(|reason| reason.code.to_owned())
            .collect(),
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
