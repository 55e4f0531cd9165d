//! The maps of cases: computed once after a case is ready, stored as one of its objects, and cached in memory.

use std::sync::Arc;
use std::time::Instant;

use bytes::Bytes;
use case::{CaseFacts, CaseId, CaseState, JobKind, Layer, LayerId, ObjectKind, STORE_FAILED};
use geometry::Volume;
use pipeline::codec::{decode_brain, decode_maps, decode_volume, encode_maps, encode_surfaces};
use pipeline::maps::{MapsOrReason, compute_flair};
use pipeline::surfaces::{DividedCase, compute_maps_and_surfaces};
use pipeline::{Undefined, envelope_of};
use storage::tables::jobs;
use storage::{NewJob, Owner, Publisher, StoreError, frame_all};

use super::Library;
use super::loaded_maps::{FLAIR_NOT_PLACED, FlairState, Known, LoadedMaps, MapsState};
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
        self.maps_of(id.into()).await
    }

    /// The map of the newest FLAIR of a ready case, in the same way; `None` if no layer is a FLAIR.
    ///
    /// # Errors
    /// If the store cannot be reached.
    pub async fn flair(&self, id: &CaseId) -> Result<Option<FlairState>, StoreError> {
        let layers = self.store().layers(id).await?;
        if let Some(newest) = Layer::newest_flair(&layers) {
            return Ok(Some(FlairState {
                layer: Some(newest.id),
                state: self.maps_of((id, &newest.id).into()).await?,
            }));
        }
        let open = layers.iter().filter(|layer| layer.closed.is_none());
        let mut flairs = open.filter(|layer| layer.is_flair()).peekable();
        if flairs.peek().is_none() {
            return Ok(None);
        }
        let state = if !self.makes_maps() {
            MapsState::Off
        } else if flairs.all(|layer| layer.state == CaseState::Failed) {
            MapsState::Undefined(FLAIR_NOT_PLACED)
        } else {
            MapsState::Making
        };
        Ok(Some(FlairState { layer: None, state }))
    }

    /// The map of a FLAIR of a ready case, in the same way.
    ///
    /// # Errors
    /// If the store cannot be reached.
    pub async fn maps_of_layer(
        &self,
        id: &CaseId,
        layer: &LayerId,
    ) -> Result<MapsState, StoreError> {
        self.maps_of((id, layer).into()).await
    }

    /// The maps of a case or of one of its layers.
    async fn maps_of(&self, owner: Owner) -> Result<MapsState, StoreError> {
        if !self.makes_maps() {
            return Ok(MapsState::Off);
        }
        let part = Part::Maps(owner.layer);
        if let Some(known) = self.cache().get::<Known>(&owner.case, part) {
            return Ok((&*known).into());
        }
        let new = NewJob::about(JobKind::MAPS, owner);
        let mut connection = self.store().connect().await?;
        let job = jobs::latest(&mut connection, new.kind, &new.key).await?;
        drop(connection);
        // A damaged object is not read repeatedly meanwhile.
        if job.as_ref().is_some_and(|job| !job.state.has_ended()) {
            return Ok(MapsState::Making);
        }
        if let Some(found) = self.stored_maps(owner).await? {
            return Ok(found);
        }
        // If only the store failed, they may be computed now.
        let failure = job.and_then(|job| job.failure);
        if let Some(failure) = failure.filter(|failure| failure.name != STORE_FAILED) {
            return Ok(MapsState::Undefined(Undefined {
                sentence: failure.detail.into(),
                code: "maps-failed".into(),
            }));
        }
        self.store().enqueue(&new).await?;
        Ok(MapsState::Making)
    }

    /// Queues the job that computes the maps of a ready case if it has none, as [`Library::maps`] does.
    ///
    /// # Errors
    /// If the store cannot be reached.
    pub(crate) async fn ensure_maps(&self, id: &CaseId) -> Result<(), StoreError> {
        if !self.makes_maps() {
            return Ok(());
        }
        let names = self.store().objects_of(id).await?;
        if names.iter().all(|name| name.kind != ObjectKind::Maps) {
            self.maps(id).await?;
        }
        Ok(())
    }

    /// The maps in memory or in the store; `None` if they must be computed.
    async fn stored_maps(&self, owner: Owner) -> Result<Option<MapsState>, StoreError> {
        let (id, part) = (&owner.case, Part::Maps(owner.layer));
        let read = async {
            let read = self.read_maps(owner).await.map_err(NotRead::Failed)?;
            let maps = read.ok_or(NotRead::NotStored)?;
            self.note_places(owner, &maps).await;
            let key = match &owner.layer {
                None => id.number(),
                Some(layer) => id.number().rotate_left(1) ^ layer.number(),
            };
            let known: Known = maps.map(|maps| Arc::new(LoadedMaps::new(key, maps)));
            Ok(known)
        };
        match self.cache().get_or_make(id, part, read).await {
            Ok(known) => Ok(Some((&*known).into())),
            Err(NotRead::Failed(error)) => Err(error),
            Err(NotRead::NotStored) => Ok(None),
        }
    }

    /// Notes for lists how many places stand out. Maps are shown without that, too.
    async fn note_places(&self, owner: Owner, maps: &MapsOrReason) {
        let Ok(maps) = maps else { return };
        if let Err(error) = self.store().note_places(owner, maps.standing_out()).await {
            tracing::warn!(%error, "cannot note how many places of a case stand out");
        }
    }

    /// Computes the maps of a ready case, and that of its newest FLAIR, if they are missing.
    ///
    /// # Errors
    /// If the store cannot be reached.
    pub async fn make_maps_now(&self, id: &CaseId) -> Result<(), StoreError> {
        self.make_maps(id.into()).await?;
        let layers = self.store().layers(id).await?;
        match Layer::newest_flair(&layers) {
            Some(newest) => self.make_maps((id, &newest.id).into()).await,
            None => Ok(()),
        }
    }

    /// A layer that is ready, and its voxels; `None` if there is none, or if its voxels are lost and made again.
    async fn flair_voxels(
        &self,
        id: &CaseId,
        layer: &LayerId,
    ) -> Result<Option<(Layer, Volume)>, StoreError> {
        let row = self.store().layer(id, layer).await?;
        let Some(row) = row.filter(|row| row.is_flair() && row.is_shown()) else {
            return Ok(None);
        };
        let voxels = self.stored_voxels(&row).await?;
        Ok(voxels.map(|voxels| (row, voxels)))
    }

    /// Computes the maps of a case or of a layer and stores them, unless they are there.
    pub(crate) async fn make_maps(&self, owner: Owner) -> Result<(), StoreError> {
        const KINDS: &[ObjectKind] = &[ObjectKind::Mask, ObjectKind::Envelope, ObjectKind::Volume];
        if !self.makes_maps() {
            return Ok(());
        }
        if self.read_maps(owner).await?.is_some() {
            return Ok(());
        }
        let id = &owner.case;
        let flair = match &owner.layer {
            None => None,
            Some(layer) => match self.flair_voxels(id, layer).await? {
                None => return Ok(()),
                found => found,
            },
        };
        let begun = Instant::now();
        // Deleted meanwhile, if there is none.
        let Some(case) = self.store().case(id).await? else {
            return Ok(());
        };
        let compute = move |facts: &CaseFacts, payloads: &[Bytes]| {
            let [brain, envelope, volume] = payloads else {
                return None;
            };
            let (envelope, volume) = (envelope_of(facts, envelope)?, decode_volume(volume)?);
            let (maps, surfaces) = match &flair {
                None => {
                    let (maps, surfaces) = compute_maps_and_surfaces(DividedCase {
                        facts,
                        parameters: &case.parameters,
                        brain: &decode_brain(brain)?,
                        envelope: &envelope,
                        volume: &volume,
                    });
                    (maps, Some(surfaces))
                }
                Some((row, voxels)) => {
                    let placement = &row.facts.as_ref()?.placement;
                    let map = compute_flair(facts, &envelope, &volume, voxels, placement);
                    (map, None)
                }
            };
            let undefined = maps.as_ref().err().map(|reason| reason.code.clone());
            let mut payloads = vec![(ObjectKind::Maps, encode_maps(&maps).into())];
            let surfaces = surfaces.map(|surfaces| encode_surfaces(&surfaces).into());
            payloads.extend(surfaces.map(|surfaces| (ObjectKind::Surfaces, surfaces)));
            Some((payloads, undefined, maps))
        };
        let Some((payloads, undefined, maps)) = self.load(id, KINDS, compute).await? else {
            return Ok(());
        };
        let framed = frame_all(payloads).await?;
        let publisher = Publisher::Ready(owner);
        self.store().publish(publisher, framed).await?;
        self.note_places(owner, &maps).await;
        self.cache().drop_part(id, Part::Maps(owner.layer));
        let took_ms = u64::try_from(begun.elapsed().as_millis()).unwrap_or(u64::MAX);
        tracing::info!(
            case = id.short(),
            took_ms,
            undefined = undefined.as_deref(),
            of_layer = owner.layer.is_some(),
            "computed the maps of a case"
        );
        Ok(())
    }

    /// The stored maps of a case or of a layer; `None` if they are missing, damaged or of another format.
    async fn read_maps(&self, owner: Owner) -> Result<Option<MapsOrReason>, StoreError> {
        let names = self.store().objects_of(owner).await?;
        let read = self.store().read(owner, &names, ObjectKind::Maps).await?;
        let Some(payload) = read else {
            return Ok(None);
        };
        let decoded = tokio::task::spawn_blocking(move || decode_maps(&payload)).await?;
        if decoded.is_none() {
            tracing::info!(
                case = owner.case.short(),
                "the maps of a case are of another format and will be computed again"
            );
        }
        Ok(decoded)
    }
}
