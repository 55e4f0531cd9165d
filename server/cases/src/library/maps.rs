//! The maps of cases: computed once after a case is ready, stored as one of its objects, and cached in memory.

use std::collections::HashMap;
use std::fmt;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use bytes::Bytes;
use case::{CandidateFacts, CaseFacts, CaseId, MapName, ObjectKind};
use geometry::Grid;
use glam::DAffine3;
use pipeline::codec::{decode_maps, decode_volume, encode_maps};
use pipeline::envelope_of;
use pipeline::maps::{CaseMaps, MapsOrReason, compute_maps, map_unit};
use quick_cache::sync::{Cache, DefaultLifecycle};
use quick_cache::{DefaultHashBuilder, OptionsBuilder, Weighter};
use render::{KeyedLayer, Layer, LayerKey, LayerValues};
use storage::{Publisher, StoreError, frame_all};
use tokio::sync::Semaphore;

use super::Library;

/// The greatest number of cases whose maps wait to be computed; others are queued at their next request.
const MOST_WAITING: usize = 64;

/// The fewest entries that the cache makes room for in its books.
const EXPECTED_CASES: usize = 16;

/// The maps of a case in memory, ready for drawing.
#[derive(Debug)]
pub struct LoadedMaps {
    key: u128,
    grid: Grid,
    layers: Vec<(MapName, Arc<Layer>)>,
    /// The most blurred places, the highest value first.
    pub candidates: Vec<CandidateFacts>,
}

impl LoadedMaps {
    /// Takes over the maps of a case; the keys of their layers derive from `key`.
    pub fn new(key: u128, mut maps: CaseMaps) -> Self {
        let candidates = std::mem::take(&mut maps.candidates);
        let grid = maps.map(MapName::Blur).grid().clone();
        let layers = maps.into_named().map(|(name, map)| {
            let scale = map.scale();
            let values = LayerValues::Codes {
                least: scale.least,
                step: scale.step,
                codes: map.into_codes(),
            };
            let texts = [name.name(), map_unit(name)];
            let layer = Layer::new(texts, &grid, DAffine3::IDENTITY, values);
            (name, Arc::new(layer.expect("all maps have the same grid")))
        });
        Self {
            key,
            layers: layers.collect(),
            grid,
            candidates,
        }
    }

    /// The grid of all maps: a block of the grid of the volume.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// One of the maps.
    pub fn layer(&self, name: MapName) -> &Arc<Layer> {
        let found = self.layers.iter().find(|(other, _)| *other == name);
        &found.expect("there is one of each name").1
    }

    /// One of the maps, with the key of its texture on a graphics device.
    pub fn keyed(&self, name: MapName) -> KeyedLayer {
        KeyedLayer {
            key: LayerKey(self.key ^ (1 + name as u128)),
            layer: Arc::clone(self.layer(name)),
        }
    }

    fn bytes(&self) -> u64 {
        let layers = self.layers.iter();
        layers.map(|(_, layer)| layer.bytes() as u64).sum()
    }
}

/// The state of the maps of a case.
#[derive(Debug, Clone)]
pub enum MapsState {
    /// They are available.
    Ready(Arc<LoadedMaps>),
    /// There are none; the reason, as a sentence.
    Undefined(Arc<str>),
    /// They are being computed.
    Making,
    /// This server computes none.
    Off,
}

/// The cached state of the maps of a case.
type Known = Result<Arc<LoadedMaps>, Arc<str>>;

/// Whether to compute existing maps again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Make {
    IfMissing,
    Again,
}

/// The maps in memory, and the running computations.
pub(super) struct MapsDesk {
    known: Cache<CaseId, Known, ByBytes>,
    /// Waiting and at work. Held for moments.
    making: Mutex<HashMap<CaseId, Make>>,
    /// One case at a time, because the filters use every core and about 100 MB.
    one_at_a_time: Semaphore,
}

impl MapsDesk {
    /// An empty cache with a limit in bytes.
    pub(super) fn new(cache_bytes: u64) -> Self {
        Self {
            known: new_cache(cache_bytes),
            making: Mutex::default(),
            one_at_a_time: Semaphore::new(1),
        }
    }

    fn making(&self) -> MutexGuard<'_, HashMap<CaseId, Make>> {
        self.making.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl fmt::Debug for MapsDesk {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter
            .debug_struct("MapsDesk")
            .field("known", &self.known.len())
            .field("making", &self.making().len())
            .finish_non_exhaustive()
    }
}

#[derive(Debug, Clone)]
struct ByBytes;

impl Weighter<CaseId, Known> for ByBytes {
    fn weight(&self, _: &CaseId, known: &Known) -> u64 {
        known.as_ref().map_or(1, |maps| maps.bytes().max(1))
    }
}

fn new_cache(cache_bytes: u64) -> Cache<CaseId, Known, ByBytes> {
    // One shard: a shard cannot hold maps that are larger than its part of the budget.
    let options = OptionsBuilder::new()
        .shards(1)
        .estimated_items_capacity(EXPECTED_CASES)
        .weight_capacity(cache_bytes)
        .build()
        .expect("every option is set");
    Cache::with_options(
        options,
        ByBytes,
        DefaultHashBuilder::default(),
        DefaultLifecycle::default(),
    )
}

/// The reason why maps were not read.
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
            let loaded = maps.map(|maps| Arc::new(LoadedMaps::new(id.number(), maps)));
            Ok(loaded.map_err(Arc::from))
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
        if make == Make::IfMissing {
            let names = self.store().rows().objects(id).await?;
            if names.iter().any(|name| name.kind == ObjectKind::Maps) {
                return Ok(());
            }
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
            let words = maps.as_ref().err().cloned();
            Some((encode_maps(&maps), words, facts.clone()))
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
        tracing::info!(took_ms, undefined, "computed the maps of a case");
        Ok(())
    }

    /// The stored maps of a case; `None` if they are missing, damaged or from another version.
    async fn read_maps(&self, id: &CaseId) -> Result<Option<MapsOrReason>, StoreError> {
        let names = self.store().rows().objects(id).await?;
        if !names.iter().any(|name| name.kind == ObjectKind::Maps) {
            return Ok(None);
        }
        let Some(payload) = self.store().read(id, &names, ObjectKind::Maps).await? else {
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
