//! The whole acquired volumes of cases.

use std::sync::Arc;

use bytes::Bytes;
use case::{CaseFacts, CaseId, CaseState, ObjectKind};
use geometry::Volume;
use pipeline::codec::{decode_volume, encode_volume};
use pipeline::read_volume;
use storage::{Attempt, Publisher, StoreError, frame_all};

use super::Library;

const KINDS: &[ObjectKind] = &[ObjectKind::WholeVolume];

impl Library {
    /// The whole acquired volume of a ready case; `None` if there is no such case or it is not ready.
    ///
    /// A lost object is read from the source and stored again, without preparing the case again. If the source is damaged, the case becomes failed, as with any derived object.
    ///
    /// # Errors
    /// [`StoreError::SourceMissing`], or if the store cannot be reached.
    pub async fn whole_volume(&self, id: &CaseId) -> Result<Option<Volume>, StoreError> {
        let decode_one = Arc::new(decode);
        match self.store().read_derived(id, KINDS, &decode_one).await? {
            Attempt::Read(volume) => return Ok(Some(volume)),
            Attempt::NoCase => return Ok(None),
            Attempt::Bad => {}
        }
        match self.restore_whole_volume(id).await? {
            Some(volume) => Ok(Some(volume)),
            None => self.load(id, KINDS, decode).await,
        }
    }

    /// Stores the whole volume again, from the source; `None` if the case or its source is lost.
    async fn restore_whole_volume(&self, id: &CaseId) -> Result<Option<Volume>, StoreError> {
        let ready = |case: &case::Case| case.state == CaseState::Ready;
        let case = self.store().case(id).await?.filter(ready);
        if case.is_none() {
            return Ok(None);
        }
        let names = self.store().objects_of(id).await?;
        let Some(source) = self.source(id, &names).await? else {
            return Ok(None);
        };
        let limits = self.limits();
        let read = move || {
            let volume = read_volume(&source, &limits).ok()?;
            let payload = Bytes::from(encode_volume(&volume));
            Some((volume, payload))
        };
        // Not a reason to give up the case: its surfaces can be shown.
        let (volume, payload) = tokio::task::spawn_blocking(read).await?.ok_or_else(|| {
            StoreError::Objects("a volume exceeds the limits of this server".into())
        })?;
        let framed = frame_all(vec![(ObjectKind::WholeVolume, payload)]).await?;
        let publisher = Publisher::Ready(id.into());
        self.store().publish(publisher, framed).await?;
        Ok(Some(volume))
    }
}

fn decode(_: &CaseFacts, payloads: &[Bytes]) -> Option<Volume> {
    decode_volume(payloads.first()?)
}
