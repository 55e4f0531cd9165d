//! The place of one case in the patient space of another.

use analysis::{Verdict, register, shared_points};
use case::{CaseRegistration, RegistrationVerdict};
use geometry::{Envelope, Volume};

use crate::affine::rows_of;

/// A case, as it is registered to another.
#[derive(Debug)]
pub struct PlacedCase {
    /// Its volume, cropped to the envelope.
    pub volume: Volume,
    pub envelope: Envelope,
}

/// Finds the place of `other` in the patient space of `case`: see [`analysis::register`].
///
/// Two different heads can only be aligned roughly: no transform between them can be trusted. They are registered in
/// both directions, and the transform with the greater overlap of the envelopes is returned.
pub fn place_case(case: &PlacedCase, other: &PlacedCase) -> CaseRegistration {
    let found = register(&case.volume, &case.envelope, &other.volume);
    let is_trusted = !matches!(found.verdict, Verdict::Failed(_));
    let case_from_other = if is_trusted {
        found.case_from_layer
    } else {
        let back = register(&other.volume, &other.envelope, &case.volume);
        let [one, two] = [
            found.best_case_from_layer,
            back.best_case_from_layer.inverse(),
        ];
        let [first, second] =
            [one, two].map(|candidate| shared_points(&case.envelope, &other.envelope, candidate));
        if first >= second { one } else { two }
    };
    CaseRegistration {
        case_from_other: rows_of(case_from_other),
        verdict: match is_trusted {
            true => RegistrationVerdict::Registered,
            false => RegistrationVerdict::Rough,
        },
        nmi_before: found.nmi_before,
        nmi_after: found.nmi_after,
        overlap: found.overlap,
        residual_mm: found.residual_mm,
    }
}
