//! The maps of cases: computed once after a case is ready, stored as one of its objects, and cached in memory.

use std::sync::Arc;
use std::time::Instant;

use bytes::Bytes;
use case::{CaseFacts, CaseId, JobKind, ObjectKind, STORE_FAILED};
use pipeline::codec::{decode_brain, decode_maps, decode_volume, encode_maps, encode_surfaces};
use pipeline::envelope_of;
use pipeline::maps::{MapsOrReason, NoMaps};
use pipeline::surfaces::{DividedCase, compute_maps_and_surfaces};
use storage::{NewJob, ObjectName, Publisher, StoreError, frame_all};

use super::Library;
use super::loaded_maps::{Known, LoadedMaps, MapsState};
use crate::cache::Part;

/// Why maps were not read.
enum NotRead {
    NotStored,
    Failed(StoreError),
}

impl Library {
    /// The maps of a ready case. If they are missing, damaged or of another format, the job that computes them is queued.
    /// If that failed as often as it may, they are undefined.
    ///
    /// # Errors
    /// If the store cannot be reached.
    pub async fn maps(&self, id: &CaseId) -> Result<MapsState, StoreError> {
        if !self.makes_maps() {
            return Ok(MapsState::Off);
        }
        if let Some(known) = self.cache().get::<Known>(id, Part::Maps) {
            return Ok((&*known).into());
        }
        let key = id.to_string();
        let job = self.store().latest_job(JobKind::MAPS, &key).await?;
        // A damaged object is not read repeatedly meanwhile.
        if job.as_ref().is_some_and(|job| !job.state.has_ended()) {
            return Ok(MapsState::Making);
        }
        if let Some(found) = self.stored_maps(id).await? {
            return Ok(found);
        }
        // If only the store failed, they may be computed now.
        let failure = job.and_then(|job| job.failure);
        if let Some(failure) = failure.filter(|failure| failure.name != STORE_FAILED) {
            return Ok(MapsState::Undefined(NoMaps {
                sentence: failure.detail.into(),
                code: "maps-failed".into(),
            }));
        }
        let job = NewJob::of_ready_case(JobKind::MAPS, id);
        self.store().enqueue(&job).await?;
        Ok(MapsState::Making)
    }

    /// Queues the job that computes the maps of a ready case if it has none, as [`Library::maps`] does.
    ///
    /// # Errors
    /// If the store cannot be reached.
    pub(crate) async fn ensure_maps(&self, id: &CaseId) -> Result<(), StoreError> {
        if self.makes_maps() && self.maps_object(id).await?.is_none() {
            self.maps(id).await?;
        }
        Ok(())
    }

    /// The maps in memory or in the store; `None` if they must be computed.
    async fn stored_maps(&self, id: &CaseId) -> Result<Option<MapsState>, StoreError> {
        let read = async {
            let read = self.read_maps(id).await.map_err(NotRead::Failed)?;
            let maps = read.ok_or(NotRead::NotStored)?;
            let known: Known = maps.map(|maps| Arc::new(LoadedMaps::new(id.number(), maps)));
            Ok(known)
        };
        match self.cache().get_or_make(id, Part::Maps, read).await {
            Ok(known) => Ok(Some((&*known).into())),
            Err(NotRead::Failed(error)) => Err(error),
            Err(NotRead::NotStored) => Ok(None),
        }
    }

    /// The maps of a ready case, computed now if they are missing.
    ///
    /// # Errors
    /// If the store cannot be reached.
    pub async fn maps_now(&self, id: &CaseId) -> Result<MapsState, StoreError> {
        if self.makes_maps() && self.stored_maps(id).await?.is_none() {
            self.make_maps(id).await?;
        }
        self.maps(id).await
    }

    /// Computes the maps of a case and stores them, unless they are there.
    pub(crate) async fn make_maps(&self, id: &CaseId) -> Result<(), StoreError> {
        const KINDS: &[ObjectKind] = &[ObjectKind::Mask, ObjectKind::Envelope, ObjectKind::Volume];
        if !self.makes_maps() {
            return Ok(());
        }
        if self.read_maps(id).await?.is_some() {
            return Ok(());
        }
        let begun = Instant::now();
        // Deleted meanwhile, if there is none.
        let Some(case) = self.store().case(id).await? else {
            return Ok(());
        };
        let compute = move |facts: &CaseFacts, payloads: &[Bytes]| {
            let [brain, envelope, volume] = payloads else {
                return None;
            };
            let (maps, surfaces) = compute_maps_and_surfaces(DividedCase {
                facts,
                parameters: &case.parameters,
                brain: &decode_brain(brain)?,
                envelope: &envelope_of(facts, envelope)?,
                volume: &decode_volume(volume)?,
            });
            let undefined = maps.as_ref().err().map(|reason| reason.code.clone());
            let payloads = [
                (ObjectKind::Maps, encode_maps(&maps).into()),
                (ObjectKind::Surfaces, encode_surfaces(&surfaces).into()),
            ];
            Some((payloads, undefined, facts.clone()))
        };
        let Some((payloads, undefined, facts)) = self.load(id, KINDS, compute).await? else {
            return Ok(());
        };
        let framed = frame_all(payloads.into()).await?;
        let publisher = Publisher::Rebuild(id);
        self.store().publish(publisher, &framed, &facts).await?;
        self.cache().drop_part(id, Part::Maps);
        let took_ms = u64::try_from(begun.elapsed().as_millis()).unwrap_or(u64::MAX);
        tracing::info!(
            case = id.short(),
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

    /// The stored maps of a case; `None` if they are missing, damaged or of another format.
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
                case = id.short(),
                "the maps of a case are of another format and will be computed again"
            );
        }
        Ok(decoded)
    }
}
