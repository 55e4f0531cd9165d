//! Loaded models: the data of cases for rendering, kept in memory within a budget of bytes.

mod model;
#[cfg(test)]
mod tests;
mod whole;

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use quick_cache::Weighter;
use quick_cache::sync::Cache;

use case::{CaseId, CaseState, SurfaceName};
use pipeline::surfaces::NoSurfaces;
use storage::StoreError;

use crate::cache;
use crate::library::Library;

pub use self::model::{PathKind, PathsError, WarmModel};
pub use self::whole::WholeVolumes;

/// How long a model is used before the rows are checked for a deletion of its case by another process.
const TRUST_FOR: Duration = Duration::from_secs(2);

/// How long a case is remembered as ready if the database is unreachable.
pub(crate) const REMEMBERED_WHILE_AWAY: Duration = Duration::from_secs(600);

/// The same in ms.
const REMEMBERED_WHILE_AWAY_MS: u64 = REMEMBERED_WHILE_AWAY.as_secs() * 1000;

/// The models in memory, at most a budget of bytes of them. Cheap to clone.
///
/// A model that exceeds the budget by itself is loaded for each use.
#[derive(Clone)]
pub struct Models {
    inner: Arc<Inner>,
}

struct Inner {
    library: Library,
    cache: Cache<ModelKey, Entry, ByBytes>,
    begun: Instant,
}

type ModelKey = (CaseId, SurfaceName);

#[derive(Clone)]
struct Entry {
    model: Arc<WarmModel>,
    /// When the case was last known to exist, in ms since `Inner::begun`.
    seen_ms: Arc<AtomicU64>,
}

#[derive(Debug, Clone, Copy)]
struct ByBytes;

impl Weighter<ModelKey, Entry> for ByBytes {
    fn weight(&self, _: &ModelKey, entry: &Entry) -> u64 {
        entry.model.bytes()
    }
}

/// The reason why a model was not loaded.
enum NotLoaded {
    NotReady,
    NoSurfaces(NoSurfaces),
    Failed(StoreError),
}

/// The reason why there is no model of a ready case.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// The case has only the surface of the whole brain.
    #[error(transparent)]
    NoSurfaces(NoSurfaces),
    /// The store failed.
    #[error(transparent)]
    Store(#[from] StoreError),
}

impl Models {
    /// Models of the cases of a library, at most `budget_bytes`.
    pub fn new(library: Library, budget_bytes: u64) -> Self {
        let inner = Arc::new(Inner {
            cache: cache::one_shard(ByBytes, budget_bytes, 32),
            begun: Instant::now(),
            library: library.clone(),
        });
        let weak = Arc::downgrade(&inner);
        library.store().on_delete(move |id| {
            if let Some(inner) = weak.upgrade() {
                inner.forget(id);
            }
        });
        Self { inner }
    }

    /// The model of a surface of a case that is ready; `None` if there is no such case or it is not ready.
    ///
    /// A missing or damaged derived object is rebuilt from the source, and the parts of the brain are divided when one is first
    /// asked for. Concurrent callers wait for one loading.
    ///
    /// # Errors
    /// If the case has no such surface, or the store fails.
    pub async fn get(
        &self,
        id: &CaseId,
        surface: SurfaceName,
    ) -> Result<Option<Arc<WarmModel>>, ModelError> {
        let key = (*id, surface);
        if let Some(entry) = self.inner.cache.get(&key) {
            return Ok(self.inner.confirm(id, entry).await?);
        }
        // Loading is rare, and its future large: on the heap, it does not weigh on the stack of every caller.
        let load = Box::pin(self.inner.load(id, surface));
        match self.inner.cache.get_or_insert_async(&key, load).await {
            Ok(entry) => Ok(Some(entry.model)),
            Err(NotLoaded::NotReady) => Ok(None),
            Err(NotLoaded::NoSurfaces(reason)) => Err(ModelError::NoSurfaces(reason)),
            Err(NotLoaded::Failed(error)) => Err(error.into()),
        }
    }

    /// Bytes of the models in memory.
    pub fn bytes(&self) -> u64 {
        self.inner.cache.weight()
    }

    /// Number of models in memory.
    pub fn count(&self) -> usize {
        self.inner.cache.len()
    }
}

impl Inner {
    fn forget(&self, id: &CaseId) {
        for surface in SurfaceName::ALL {
            self.cache.remove(&(*id, surface));
        }
    }

    fn now_ms(&self) -> u64 {
        u64::try_from(self.begun.elapsed().as_millis()).unwrap_or(u64::MAX)
    }

    /// A model from the cache, if its case still exists.
    async fn confirm(
        &self,
        id: &CaseId,
        entry: Entry,
    ) -> Result<Option<Arc<WarmModel>>, StoreError> {
        let now = self.now_ms();
        let unseen_ms = now.saturating_sub(entry.seen_ms.load(Ordering::Relaxed));
        if u128::from(unseen_ms) >= TRUST_FOR.as_millis() {
            let case = match self.library.store().case(id).await {
                Err(error) if error.is_away() && unseen_ms < REMEMBERED_WHILE_AWAY_MS => {
                    return Ok(Some(entry.model));
                }
                asked => asked?,
            };
            if case.is_none_or(|case| case.state != CaseState::Ready) {
                self.forget(id);
                return Ok(None);
            }
            entry.seen_ms.store(now, Ordering::Relaxed);
        }
        Ok(Some(entry.model))
    }

    async fn load(&self, id: &CaseId, surface: SurfaceName) -> Result<Entry, NotLoaded> {
        let seen_ms = self.now_ms();
        match WarmModel::load(&self.library, id, surface).await {
            Ok(Some(model)) => {
                // Whoever looks at a case may want its maps next; a picture does not need them.
                if let Err(error) = self.library.ensure_maps(id).await {
                    tracing::warn!(
                        case = id.short(),
                        error = &error as &dyn std::error::Error,
                        "the maps of a case will be computed later"
                    );
                }
                Ok(Entry {
                    model: Arc::new(model),
                    seen_ms: Arc::new(AtomicU64::new(seen_ms)),
                })
            }
            Ok(None) => Err(NotLoaded::NotReady),
            Err(ModelError::NoSurfaces(reason)) => Err(NotLoaded::NoSurfaces(reason)),
            Err(ModelError::Store(error)) => Err(NotLoaded::Failed(error)),
        }
    }
}

impl fmt::Debug for Models {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter
            .debug_struct("Models")
            .field("count", &self.count())
            .field("bytes", &self.bytes())
            .finish_non_exhaustive()
    }
}
