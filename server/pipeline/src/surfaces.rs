//! The surfaces of parts of a brain: each hemisphere and the cerebrum closed on its own, computed once and stored as one object.

use analysis::{Division, NoDivision, SurfacePart};
use case::{CaseFacts, Parameters, SphereFacts, SurfaceName};
use geometry::{
    BrainMask, BuiltModel, ClosedBrain, DeformableModel, Envelope, GeometryError, Volume,
};

use crate::Undefined;
use crate::brain::closing_radius_mm;
use crate::cuts::cuts_of;
use crate::maps::{MapsOrReason, compute_division, compute_maps_and_division};

/// The version of the surfaces; part of the entity tags of everything that shows them.
pub const SURFACES_FORMAT: u32 = 3;

/// The closed parts of a brain.
#[derive(Debug, Clone, PartialEq)]
pub struct Surfaces {
    /// In the order of [`SurfacePart::ALL`].
    pub(crate) envelopes: [Envelope; 3],
}

/// The surfaces of a case, or the reason why it has only that of the whole brain.
pub type SurfacesOrReason = Result<Surfaces, Undefined>;

impl Surfaces {
    /// The closed part of a surface; `None` for the whole brain, which is an object of its own.
    pub fn into_envelope(self, name: SurfaceName) -> Option<Envelope> {
        let [left, right, cerebrum] = self.envelopes;
        match name {
            SurfaceName::Whole => None,
            SurfaceName::Left => Some(left),
            SurfaceName::Right => Some(right),
            SurfaceName::Cerebrum => Some(cerebrum),
        }
    }
}

/// The case of which the parts are computed.
#[derive(Debug, Clone, Copy)]
pub struct DividedCase<'a> {
    pub facts: &'a CaseFacts,
    /// How it was prepared.
    pub parameters: &'a Parameters,
    /// The brain before closing.
    pub brain: &'a BrainMask,
    pub envelope: &'a Envelope,
    /// The intensities around it.
    pub volume: &'a Volume,
}

/// Closes the parts of a brain, each by the ball that closes the whole brain; the reason if it cannot be divided.
pub fn compute_surfaces(case: DividedCase<'_>) -> SurfacesOrReason {
    let division = compute_division(case.facts, case.envelope, case.volume);
    closed_parts(case, division)
}

/// The maps of a case and the closed parts of its brain, in less time than one after the other.
pub fn compute_maps_and_surfaces(case: DividedCase<'_>) -> (MapsOrReason, SurfacesOrReason) {
    let (maps, division) = compute_maps_and_division(case.facts, case.envelope, case.volume);
    (maps, closed_parts(case, division))
}

fn closed_parts(case: DividedCase<'_>, division: Result<Division, NoDivision>) -> SurfacesOrReason {
    let division = division?;
    let closing = (closing_radius_mm(case.parameters), case.envelope.cuts());
    let [left, right, cerebrum] =
        SurfacePart::ALL.map(|part| division.closed(part, case.brain, closing));
    Ok(Surfaces {
        envelopes: [left?, right?, cerebrum?],
    })
}

/// A closed part with the cuts of the volume of its case, which are stored as facts.
pub fn with_cuts_of(facts: &CaseFacts, envelope: Envelope) -> Envelope {
    envelope.with_cuts(cuts_of(&facts.cuts))
}

/// The model of the closed part of that name. `volume` is that of the case.
///
/// # Errors
/// If the part is too small for a mesh.
pub fn surface_model(
    volume: &Volume,
    envelope: Envelope,
    name: SurfaceName,
) -> Result<BuiltModel, GeometryError> {
    let volume = DeformableModel::crop(volume, &envelope).ok_or(GeometryError::EmptyMask)?;
    let closed = match name {
        SurfaceName::Left | SurfaceName::Right => ClosedBrain::Hemisphere(envelope),
        SurfaceName::Whole | SurfaceName::Cerebrum => ClosedBrain::Envelope(envelope),
    };
    DeformableModel::build(volume, closed, |_| Ok(()))
}

/// The facts of a case for one of its surfaces: the greatest depth and the sphere around it are those of the surface.
pub fn surface_facts(facts: &CaseFacts, built: &BuiltModel) -> CaseFacts {
    let sphere = built.model.bounds();
    CaseFacts {
        envelope_sphere: SphereFacts {
            center_in_patient: sphere.centre_in_patient.to_array(),
            radius_mm: sphere.radius_mm,
        },
        max_depth_mm: built.distance.max_depth_mm(),
        envelope_ml: built.distance.envelope().volume_ml(),
        ..facts.clone()
    }
}
