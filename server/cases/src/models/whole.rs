//! The whole acquired volumes of cases, kept in memory within a budget of bytes.

use std::fmt;
use std::sync::Arc;

use case::CaseId;
use geometry::Volume;
use quick_cache::Weighter;
use quick_cache::sync::Cache;

use crate::cache;
use crate::library::Library;
use storage::StoreError;

/// The expected number of volumes in memory.
const EXPECTED_VOLUMES: usize = 8;

/// The whole volumes in memory. Cheap to clone.
///
/// A volume that exceeds the budget by itself is loaded for each use.
#[derive(Clone)]
pub struct WholeVolumes {
    library: Library,
    cache: Arc<Cache<CaseId, Arc<Volume>, ByBytes>>,
}

/// The reason why a volume was not read.
enum NotRead {
    NotReady,
    Failed(StoreError),
}

#[derive(Debug, Clone, Copy)]
struct ByBytes;

impl Weighter<CaseId, Arc<Volume>> for ByBytes {
    fn weight(&self, _: &CaseId, volume: &Arc<Volume>) -> u64 {
        size_of_val(volume.voxels()) as u64
    }
}

impl WholeVolumes {
    /// The volumes of the cases of a library, at most `budget_bytes`.
    pub fn new(library: Library, budget_bytes: u64) -> Self {
        Self {
            library,
            cache: Arc::new(cache::one_shard(ByBytes, budget_bytes, EXPECTED_VOLUMES)),
        }
    }

    /// The volume of a case that is ready; `None` if there is no such case or it is not ready. Concurrent callers wait
    /// for one loading.
    ///
    /// # Errors
    /// If the store fails.
    pub async fn get(&self, id: &CaseId) -> Result<Option<Arc<Volume>>, StoreError> {
        // Loading is rare, and its future large: on the heap, it does not weigh on the stack of every caller.
        let load = Box::pin(async {
            let loaded = self.library.whole_volume(id).await;
            let volume = loaded.map_err(NotRead::Failed)?;
            volume.map(Arc::new).ok_or(NotRead::NotReady)
        });
        match self.cache.get_or_insert_async(id, load).await {
            Ok(volume) => Ok(Some(volume)),
            Err(NotRead::NotReady) => Ok(None),
            Err(NotRead::Failed(error)) => Err(error),
        }
    }

    /// The volume of any case; if it is not in memory, what `read` reads from its source. Concurrent callers wait for one
    /// reading.
    ///
    /// # Errors
    /// Those of `read`.
    pub async fn get_or_read<E>(
        &self,
        id: &CaseId,
        read: impl Future<Output = Result<Volume, E>>,
    ) -> Result<Arc<Volume>, E> {
        let read = async { read.await.map(Arc::new) };
        self.cache.get_or_insert_async(id, read).await
    }

    /// Drops the volume of a case.
    pub fn forget(&self, id: &CaseId) {
        self.cache.remove(id);
    }

    /// Bytes of the volumes in memory.
    pub fn bytes(&self) -> u64 {
        self.cache.weight()
    }
}

impl fmt::Debug for WholeVolumes {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter
            .debug_struct("WholeVolumes")
            .field("count", &self.cache.len())
            .field("bytes", &self.bytes())
            .finish_non_exhaustive()
    }
}
