//! The registration of two cases, so that both can be looked at side by side.

use case::{CaseFacts, CaseId, ObjectKind};
use pipeline::codec::decode_volume;
use pipeline::envelope_of;
use pipeline::registration::{PlacedCase, place_case};
use serde::Serialize;

use crate::application::Cases;
use crate::error::Error;

/// The place of another case in the patient space of a case.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CaseRegistration {
    /// Rows of the rigid transform from the patient space of the other case to that of the case, LPS mm.
    pub case_from_other: [[f64; 4]; 4],
    /// Whether the transform can be trusted.
    pub verdict: RegistrationVerdict,
    /// Normalised mutual information where the headers place both: 1 for none, 2 for complete.
    pub nmi_before: f64,
    /// The same with the transform.
    pub nmi_after: f64,
    /// The fraction of the head that the other volume covers, 0 to 1.
    pub overlap: f64,
    /// The parts of the head are shifted to where each fits best; this is the median shift, in mm. Absent if the other
    /// volume covers too few parts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub residual_mm: Option<f64>,
}

/// Whether the transform from one case to another can be trusted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum RegistrationVerdict {
    /// Both show the same head, and fit with this transform.
    Registered,
    /// They show different heads, or do not fit: the transform aligns them only roughly.
    Rough,
}

impl Cases {
    /// Registers `other` to a case, by the same method as layers. This takes about a second of CPU time, for two different
    /// heads twice as long.
    ///
    /// # Errors
    /// As [`Cases::ready`], for both cases; [`Error::Busy`].
    pub async fn registration(
        &self,
        id: &CaseId,
        other: &CaseId,
    ) -> Result<CaseRegistration, Error> {
        let _one_at_a_time = self.registering.lock().await;
        let turn = self.queue.turn().await?;
        let (case, other) = (self.placed(id).await?, self.placed(other).await?);
        let found = turn.run(move || place_case(&case, &other)).await?;
        Ok(CaseRegistration {
            case_from_other: found.case_from_other,
            verdict: match found.is_trusted {
                true => RegistrationVerdict::Registered,
                false => RegistrationVerdict::Rough,
            },
            nmi_before: found.nmi_before,
            nmi_after: found.nmi_after,
            overlap: found.overlap,
            residual_mm: found.residual_mm,
        })
    }

    /// The parts of a case that are compared: its volume around the brain, and its envelope.
    pub(crate) async fn placed(&self, id: &CaseId) -> Result<PlacedCase, Error> {
        const KINDS: &[ObjectKind] = &[ObjectKind::Volume, ObjectKind::Envelope];
        let decode = |facts: &CaseFacts, payloads: &[bytes::Bytes]| {
            let [volume, envelope] = payloads else {
                return None;
            };
            Some(PlacedCase {
                volume: decode_volume(volume)?,
                envelope: envelope_of(facts, envelope)?,
            })
        };
        match self.library.load(id, KINDS, decode).await? {
            Some(placed) => Ok(placed),
            None => Err(self.gone(id).await),
        }
    }
}
