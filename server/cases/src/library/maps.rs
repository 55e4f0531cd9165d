//! The maps of cases: computed once after a case is ready, stored as one of its objects, and cached in memory.

use std::sync::Arc;
use std::time::Instant;

use bytes::Bytes;
use case::{CaseFacts, CaseId, ObjectKind};
use pipeline::codec::{decode_maps, decode_volume, encode_maps};
use pipeline::envelope_of;
use pipeline::maps::{MapsOrReason, compute_maps};
use storage::{ObjectName, Publisher, StoreError, frame_all};

use super::Library;
use super::desk::{LoadedMaps, Make, MapsDesk, MapsState};

/// The greatest number of cases whose maps wait to be computed; others are queued at their next request.
const MOST_WAITING: usize = 64;

/// Why maps were not read.
enum NotRead {
    NotStored,
    Failed(StoreError),
}

impl Library {
    /// The maps of a ready case. If they are missing, damaged or from another version, their computation begins.
    ///
    /// # Errors
    /// If the store cannot be reached.
    pub async fn maps(&self, id: &CaseId) -> Result<MapsState, StoreError> {
        let Some(desk) = &self.inner.maps else {
            return Ok(MapsState::Off);
        };
        // A damaged object is not read repeatedly meanwhile.
        if desk.making().get(id) == Some(&Make::Again) {
            return Ok(MapsState::Making);
        }
        let found = self.stored_maps(desk, id).await?;
        Ok(found.unwrap_or_else(|| {
            self.begin_maps(id, Make::Again);
            MapsState::Making
        }))
    }

    /// The maps in memory or in the store; `None` if they must be computed.
    async fn stored_maps(
        &self,
        desk: &MapsDesk,
        id: &CaseId,
    ) -> Result<Option<MapsState>, StoreError> {
        let read = async {
            let read = self.read_maps(id).await.map_err(NotRead::Failed)?;
            let maps = read.ok_or(NotRead::NotStored)?;
            Ok(maps.map(|maps| Arc::new(LoadedMaps::new(id.number(), maps))))
        };
        match desk.known.get_or_insert_async(id, read).await {
            Ok(Ok(maps)) => Ok(Some(MapsState::Ready(maps))),
            Ok(Err(reason)) => Ok(Some(MapsState::Undefined(reason))),
            Err(NotRead::Failed(error)) => Err(error),
            Err(NotRead::NotStored) => Ok(None),
        }
    }

    /// Begins to compute the maps of a ready case, unless they are stored or being computed.
    pub fn ensure_maps(&self, id: &CaseId) {
        self.begin_maps(id, Make::IfMissing);
    }

    /// The maps of a ready case, computed now if they are missing.
    ///
    /// # Errors
    /// If the store cannot be reached.
    pub async fn maps_now(&self, id: &CaseId) -> Result<MapsState, StoreError> {
        if let Some(desk) = &self.inner.maps
            && self.stored_maps(desk, id).await?.is_none()
        {
            self.make_maps(desk, id, Make::Again).await?;
        }
        self.maps(id).await
    }

    /// Drops the maps of a case from memory.
    pub(super) fn forget_maps(&self, id: &CaseId) {
        if let Some(desk) = &self.inner.maps {
            desk.known.remove(id);
        }
    }

    fn begin_maps(&self, id: &CaseId, make: Make) {
        let Some(desk) = &self.inner.maps else {
            return;
        };
        let mut making = desk.making();
        if making.len() >= MOST_WAITING || making.contains_key(id) {
            return;
        }
        making.insert(*id, make);
        drop(making);
        let (library, id) = (self.clone(), *id);
        tokio::spawn(async move {
            let Some(desk) = &library.inner.maps else {
                return;
            };
            let made = library.make_maps(desk, &id, make).await;
            desk.making().remove(&id);
            if let Err(error) = made {
                tracing::error!(
                    error = &error as &dyn std::error::Error,
                    "cannot compute the maps of a case"
                );
            }
        });
    }

    /// Computes the maps of a case and stores them, after waiting for their turn.
    async fn make_maps(&self, desk: &MapsDesk, id: &CaseId, make: Make) -> Result<(), StoreError> {
        const KINDS: &[ObjectKind] = &[ObjectKind::Envelope, ObjectKind::Volume];
        let Ok(_turn) = desk.one_at_a_time.acquire().await else {
            return Ok(());
        };
        // Somebody else may have made them meanwhile.
        let are_there = match make {
            Make::IfMissing => self.maps_object(id).await?.is_some(),
            Make::Again => self.read_maps(id).await?.is_some(),
        };
        if are_there {
            return Ok(());
        }
        let begun = Instant::now();
        let compute = |facts: &CaseFacts, payloads: &[Bytes]| {
            let [envelope, volume] = payloads else {
                return None;
            };
            let maps = compute_maps(
                facts,
                &envelope_of(facts, envelope)?,
                &decode_volume(volume)?,
            );
            let undefined = maps.as_ref().err().map(|reason| reason.code.clone());
            Some((encode_maps(&maps), undefined, facts.clone()))
        };
        let Some((payload, undefined, facts)) = self.load(id, KINDS, compute).await? else {
            // Deleted meanwhile.
            return Ok(());
        };
        let framed = frame_all(vec![(ObjectKind::Maps, payload.into())]).await?;
        let publisher = Publisher::Rebuild(id);
        self.store().publish(publisher, &framed, &facts).await?;
        desk.known.remove(id);
        let took_ms = u64::try_from(begun.elapsed().as_millis()).unwrap_or(u64::MAX);
        tracing::info!(
            took_ms,
            undefined = undefined.as_deref(),
            "computed the maps of a case"
        );
        Ok(())
    }

    /// The object of the maps of a case; `None` if it has none yet.
    async fn maps_object(&self, id: &CaseId) -> Result<Option<ObjectName>, StoreError> {
        let names = self.store().case_objects(id).await?;
        Ok(names.into_iter().find(|name| name.kind == ObjectKind::Maps))
    }

    /// The stored maps of a case; `None` if they are missing, damaged or from another version.
    async fn read_maps(&self, id: &CaseId) -> Result<Option<MapsOrReason>, StoreError> {
        let Some(name) = self.maps_object(id).await? else {
            return Ok(None);
        };
        let Some(payload) = self.store().read(id, &[name], ObjectKind::Maps).await? else {
            return Ok(None);
        };
        let decoded = tokio::task::spawn_blocking(move || decode_maps(&payload)).await?;
        if decoded.is_none() {
            tracing::info!(
                "the maps of a case are from another version and will be computed again"
            );
        }
        Ok(decoded)
    }
}
