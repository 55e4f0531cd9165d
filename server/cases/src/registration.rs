//! The registration of two cases, so that both can be looked at side by side.

use case::{CaseFacts, CaseId, CaseRegistration, ObjectKind};
use pipeline::codec::decode_volume;
use pipeline::envelope_of;
use pipeline::registration::{PlacedCase, place_case};

use crate::application::Cases;
use crate::error::Error;

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
        turn.run(move || place_case(&case, &other)).await
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
