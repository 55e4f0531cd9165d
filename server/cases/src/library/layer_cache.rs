//! Layers in memory, as they are drawn.

use case::{CaseId, LayerId};
use quick_cache::Weighter;
use quick_cache::sync::Cache;
use render::KeyedLayer;

use crate::cache;

/// The expected number of layers in memory.
const EXPECTED_LAYERS: usize = 16;

/// A layer in memory: its name is part of its legend.
type CacheKey = (CaseId, LayerId, String);

/// The layers in memory.
pub(super) type LayerCache = Cache<CacheKey, KeyedLayer, ByBytes>;

/// An empty cache with a limit in bytes.
pub(super) fn layer_cache(cache_bytes: u64) -> LayerCache {
    cache::one_shard(ByBytes, cache_bytes, EXPECTED_LAYERS)
}

#[derive(Debug, Clone)]
pub(super) struct ByBytes;

impl Weighter<CacheKey, KeyedLayer> for ByBytes {
    fn weight(&self, _: &CacheKey, keyed: &KeyedLayer) -> u64 {
        (keyed.layer.bytes() as u64).max(1)
    }
}
