//! Loaded models: the data of cases for rendering, kept in memory.

mod model;
#[cfg(test)]
mod tests;

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use case::{CaseId, CaseState, SurfaceName};
use pipeline::surfaces::NoSurfaces;
use storage::StoreError;

use crate::cache::{CacheValue, Part};
use crate::library::Library;

use self::model::LoadedModel;
pub use self::model::{PathKind, PathsError, WarmModel};

/// How long a model is used before the rows are checked for a deletion of its case by another process.
const TRUST_FOR: Duration = Duration::from_secs(2);

/// How long a case is remembered as ready if the database is unreachable.
pub(crate) const REMEMBERED_WHILE_AWAY: Duration = Duration::from_secs(600);

/// The same in ms.
const REMEMBERED_WHILE_AWAY_MS: u64 = REMEMBERED_WHILE_AWAY.as_secs() * 1000;

/// The models of the cases of a library, in its cache. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Models {
    library: Library,
    begun: Instant,
}

struct Entry {
    model: Arc<LoadedModel>,
    /// When the case was last known to exist, in ms since `Models::begun`.
    seen_ms: AtomicU64,
}

impl CacheValue for Entry {
    fn bytes(&self) -> u64 {
        self.model.bytes()
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
    #[error(transparent)]
    Store(#[from] StoreError),
}

impl Models {
    /// Models of the cases of a library.
    pub fn new(library: Library) -> Self {
        let begun = Instant::now();
        Self { library, begun }
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
    ) -> Result<Option<WarmModel>, ModelError> {
        let (cache, part) = (self.library.cache(), Part::Model(surface));
        if let Some(entry) = cache.get(id, part.clone()) {
            return Ok(self.confirm(id, &entry).await?);
        }
        match cache.get_or_make(id, part, self.load(id, surface)).await {
            Ok(entry) => Ok(Some(self.warm(&entry))),
            Err(NotLoaded::NotReady) => Ok(None),
            Err(NotLoaded::NoSurfaces(reason)) => Err(ModelError::NoSurfaces(reason)),
            Err(NotLoaded::Failed(error)) => Err(error.into()),
        }
    }

    /// Lets time pass on the clock of this handle.
    #[cfg(test)]
    pub(crate) fn pass_time(&mut self, by: Duration) {
        self.begun -= by;
    }

    fn warm(&self, entry: &Entry) -> WarmModel {
        WarmModel::new(Arc::clone(&entry.model), self.library.clone())
    }

    fn now_ms(&self) -> u64 {
        u64::try_from(self.begun.elapsed().as_millis()).unwrap_or(u64::MAX)
    }

    /// A model from the cache, if its case still exists.
    async fn confirm(&self, id: &CaseId, entry: &Entry) -> Result<Option<WarmModel>, StoreError> {
        let now = self.now_ms();
        let unseen_ms = now.saturating_sub(entry.seen_ms.load(Ordering::Relaxed));
        if u128::from(unseen_ms) >= TRUST_FOR.as_millis() {
            let case = match self.library.store().case(id).await {
                Err(error) if error.is_away() && unseen_ms < REMEMBERED_WHILE_AWAY_MS => {
                    return Ok(Some(self.warm(entry)));
                }
                asked => asked?,
            };
            if case.is_none_or(|case| case.state != CaseState::Ready) {
                self.library.cache().forget(id);
                return Ok(None);
            }
            entry.seen_ms.store(now, Ordering::Relaxed);
        }
        Ok(Some(self.warm(entry)))
    }

    async fn load(&self, id: &CaseId, surface: SurfaceName) -> Result<Entry, NotLoaded> {
        let seen_ms = self.now_ms();
        match LoadedModel::load(&self.library, id, surface).await {
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
                    seen_ms: AtomicU64::new(seen_ms),
                })
            }
            Ok(None) => Err(NotLoaded::NotReady),
            Err(ModelError::NoSurfaces(reason)) => Err(NotLoaded::NoSurfaces(reason)),
            Err(ModelError::Store(error)) => Err(NotLoaded::Failed(error)),
        }
    }
}
