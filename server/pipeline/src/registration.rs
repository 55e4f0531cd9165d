//! The place of one case in the patient space of another.

use analysis::{Verdict, register, shared_points};
use geometry::{Envelope, Volume};

use crate::affine::rows_of;

/// The place of another case in the patient space of a case.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FoundPlace {
    /// Rows of the best rigid transform from the patient space of the other case to that of the case, LPS mm.
    pub case_from_other: [[f64; 4]; 4],
    /// Whether it can be trusted: the heads are the same, and fit there.
    pub is_trusted: bool,
    /// Normalised mutual information where the headers place both: 1 for none, 2 for complete.
    pub nmi_before: f64,
    /// The same at the best place.
    pub nmi_after: f64,
    /// The fraction of the head that the other volume covers, 0 to 1.
    pub overlap: f64,
    /// The parts of the head are shifted to where each fits best; this is the median shift, in mm. `None` if the other
    /// volume covers too few parts.
    pub residual_mm: Option<f64>,
}

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
pub fn place_case(case: &PlacedCase, other: &PlacedCase) -> FoundPlace {
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
    FoundPlace {
        case_from_other: rows_of(case_from_other),
        is_trusted,
        nmi_before: found.nmi_before,
        nmi_after: found.nmi_after,
        overlap: found.overlap,
        residual_mm: found.residual_mm,
    }
}
