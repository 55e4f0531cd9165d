//! What is kept of cases in memory: one cache, within one budget of bytes.

use std::any::Any;
use std::fmt;
use std::sync::Arc;

use case::{CaseId, LayerId, SurfaceName};
use geometry::Volume;
use quick_cache::sync::{Cache, DefaultLifecycle};
use quick_cache::{DefaultHashBuilder, OptionsBuilder, Weighter};

/// The expected number of values in memory.
const EXPECTED_VALUES: usize = 256;

/// A value that the cache may keep.
pub trait CacheValue: Any + Send + Sync {
    /// Its memory in bytes.
    fn bytes(&self) -> u64;
}

/// What a value is of a case; each part has values of one type.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub enum Part {
    /// The model of a surface.
    Model(SurfaceName),
    /// The whole acquired volume.
    WholeVolume,
    /// The maps, or the map of this FLAIR; or the reason why there are none.
    Maps(Option<LayerId>),
    /// The names of gyri, if the head fits the atlas.
    Gyri,
    /// A layer under this name, which is part of its legend.
    Layer(LayerId, String),
    /// An encoded answer, under a name that its protocol chooses.
    Answer(String),
}

type Key = (CaseId, Part);

#[derive(Clone)]
struct Kept {
    value: Arc<dyn Any + Send + Sync>,
    bytes: u64,
}

#[derive(Debug, Clone, Copy)]
struct ByBytes;

impl Weighter<Key, Kept> for ByBytes {
    fn weight(&self, _: &Key, kept: &Kept) -> u64 {
        kept.bytes
    }
}

/// The values in memory. Cheap to clone.
///
/// A value that exceeds the budget by itself is made for each use.
#[derive(Clone)]
pub struct CaseCache {
    cache: Arc<Cache<Key, Kept, ByBytes>>,
}

impl CaseCache {
    /// An empty cache of at most `budget_bytes`.
    pub fn new(budget_bytes: u64) -> Self {
        Self {
            cache: Arc::new(one_shard(ByBytes, budget_bytes, EXPECTED_VALUES)),
        }
    }

    /// A part of a case, if it is in memory.
    pub fn get<T: CacheValue>(&self, id: &CaseId, part: Part) -> Option<Arc<T>> {
        self.cache.get(&(*id, part)).map(typed)
    }

    /// A part of a case; what `make` makes, if it is not in memory. Concurrent callers wait for one making.
    ///
    /// # Errors
    /// Those of `make`.
    pub async fn get_or_make<T: CacheValue, E>(
        &self,
        id: &CaseId,
        part: Part,
        make: impl Future<Output = Result<T, E>>,
    ) -> Result<Arc<T>, E> {
        let key = (*id, part);
        if let Some(kept) = self.cache.get(&key) {
            return Ok(typed(kept));
        }
        let made = async {
            let value = make.await?;
            let bytes = value.bytes().max(1);
            let value = Arc::new(value);
            Ok(Kept { value, bytes })
        };
        // Making is rare, and its future large: on the heap, it does not weigh on the stack of every caller.
        let made = Box::pin(made);
        let kept = self.cache.get_or_insert_async(&key, made).await?;
        Ok(typed(kept))
    }

    /// Drops a part of a case.
    pub(crate) fn drop_part(&self, id: &CaseId, part: Part) {
        self.cache.remove(&(*id, part));
    }

    /// Drops everything of a case.
    pub(crate) fn forget(&self, id: &CaseId) {
        self.cache.retain(|(case, _), _| case != id);
    }

    /// Bytes of the values in memory.
    pub fn bytes(&self) -> u64 {
        self.cache.weight()
    }

    /// Number of values in memory.
    pub fn count(&self) -> usize {
        self.cache.len()
    }
}

fn typed<T: CacheValue>(kept: Kept) -> Arc<T> {
    let value = kept.value.downcast();
    value.expect("each part has values of one type")
}

impl fmt::Debug for CaseCache {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter
            .debug_struct("CaseCache")
            .field("count", &self.count())
            .field("bytes", &self.bytes())
            .finish()
    }
}

impl CacheValue for Volume {
    fn bytes(&self) -> u64 {
        size_of_val(self.voxels()) as u64
    }
}

impl CacheValue for bytes::Bytes {
    fn bytes(&self) -> u64 {
        self.len() as u64
    }
}

impl CacheValue for render::KeyedLayer {
    fn bytes(&self) -> u64 {
        self.layer.bytes() as u64
    }
}

/// An empty cache of at most `budget_bytes`, for about so many values.
///
/// It has one shard: a shard cannot hold a value that is larger than its part of the budget.
pub(crate) fn one_shard<K: Eq + std::hash::Hash, V: Clone, W: Weighter<K, V> + Clone>(
    weighter: W,
    budget_bytes: u64,
    values: usize,
) -> Cache<K, V, W> {
    let options = OptionsBuilder::new()
        .shards(1)
        .estimated_items_capacity(values)
        .weight_capacity(budget_bytes)
        .build()
        .expect("every option is set");
    Cache::with_options(
        options,
        weighter,
        DefaultHashBuilder::default(),
        DefaultLifecycle::default(),
    )
}
