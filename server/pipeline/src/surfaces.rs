//! The surfaces of parts of a brain: each hemisphere and the cerebrum closed on its own, computed once and stored as one object.

use std::borrow::Cow;

use analysis::{Division, Head, NoDivision, RegionDoubt, SurfacePart};
use case::{CaseFacts, MaskMethod, Parameters, QualityState, SphereFacts, SurfaceName};
use geometry::{
    BrainMask, BuiltModel, ClosedBrain, DeformableModel, DepthField, Envelope, GeometryError, Mask,
    Volume, cut_envelope, distance_map,
};
use serde::{Deserialize, Serialize};

use crate::brain::closing_radius_mm;
use crate::cuts::cuts_of;
use crate::maps::mirror_plane;

/// The version of the surfaces; part of the entity tags of everything that shows them.
pub const SURFACES_FORMAT: u32 = 1;

/// Why a case has no surfaces of parts.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[error("only the whole brain has a surface: {sentence}")]
pub struct NoSurfaces {
    /// The stable name of the reason: `no-fissure`.
    pub code: Cow<'static, str>,
    /// The reason, for people.
    pub sentence: Cow<'static, str>,
}

impl From<NoDivision> for NoSurfaces {
    fn from(reason: NoDivision) -> Self {
        Self {
            code: reason.code().into(),
            sentence: reason.to_string().into(),
        }
    }
}

impl From<GeometryError> for NoSurfaces {
    fn from(error: GeometryError) -> Self {
        Self {
            code: "surface-geometry".into(),
            sentence: error.to_string().into(),
        }
    }
}

/// The closed parts of a brain.
#[derive(Debug, Clone, PartialEq)]
pub struct Surfaces {
    /// In the order of [`SurfacePart::ALL`].
    pub(crate) envelopes: [Envelope; 3],
}

/// The surfaces of a case, or the reason why it has only that of the whole brain.
pub type SurfacesOrReason = Result<Surfaces, NoSurfaces>;

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

/// Closes the parts of a brain; the reason if it cannot be divided.
///
/// A part is the brain within its region, closed by the ball that closes the whole brain, and clipped to the region: the closing
/// crosses neither the falx nor the tentorium. Where its border runs through tissue it is a fence, not dura.
pub fn compute_surfaces(
    (facts, parameters): (&CaseFacts, &Parameters),
    brain: &BrainMask,
    envelope: &Envelope,
    volume: &Volume,
) -> SurfacesOrReason {
    let quality = facts.quality.as_ref();
    if quality.is_some_and(|quality| quality.state == QualityState::Failed) {
        return Err(NoDivision::from(analysis::MapsUndefined::FailedEnvelope).into());
    }
    let is_pruned = quality.is_some_and(|quality| quality.method == MaskMethod::TreePruning);
    let head = Head {
        volume,
        depth: &DepthField::new(&distance_map(envelope)),
        plane: &mirror_plane(facts),
    };
    let division = Division::new(head, is_pruned.then_some(RegionDoubt::PrunedMask))?;
    let radius_mm = closing_radius_mm(parameters);
    let closed = |part| closed_part((&division, part), brain, envelope, radius_mm);
    let [left, right, cerebrum] = SurfacePart::ALL.map(closed);
    Ok(Surfaces {
        envelopes: [left?, right?, cerebrum?],
    })
}

fn closed_part(
    (division, part): (&Division, SurfacePart),
    brain: &BrainMask,
    envelope: &Envelope,
    radius_mm: f64,
) -> Result<Envelope, GeometryError> {
    let grid = brain.mask().grid();
    if grid != envelope.grid() {
        return Err(GeometryError::ValueCount {
            values: grid.voxel_count(),
            voxels: envelope.grid().voxel_count(),
        });
    }
    let voxels = brain.mask().voxels().iter().enumerate();
    let own = voxels.map(|(index, &is_brain)| is_brain && division.has(part, index));
    let own = Mask::new(grid.clone(), own.collect())?;
    let closed = cut_envelope(&BrainMask::from_stored(own)?, radius_mm, envelope.cuts())?;
    let closed = closed.clipped(|index| division.has(part, index))?;
    let fence = division.fence(part, closed.mask());
    Ok(closed.with_fence(fence))
}

/// A closed part with the cuts of the volume of its case, which are stored as facts.
pub fn with_cuts_of(facts: &CaseFacts, envelope: Envelope) -> Envelope {
    envelope.with_cuts(cuts_of(&facts.cuts))
}

/// The model of a closed part. `volume` is that of the case.
///
/// # Errors
/// If the part is too small for a mesh.
pub fn surface_model(volume: &Volume, envelope: Envelope) -> Result<BuiltModel, GeometryError> {
    let volume = DeformableModel::crop(volume, &envelope).ok_or(GeometryError::EmptyMask)?;
    DeformableModel::build(volume, ClosedBrain::Envelope(envelope), |_| Ok(()))
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
