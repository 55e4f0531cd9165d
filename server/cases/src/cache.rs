//! Caches of values, limited by their bytes.

use std::hash::Hash;

use quick_cache::sync::{Cache, DefaultLifecycle};
use quick_cache::{DefaultHashBuilder, OptionsBuilder, Weighter};

/// An empty cache of at most `budget_bytes`, for about so many values.
///
/// It has one shard: a shard cannot hold a value that is larger than its part of the budget.
pub(crate) fn one_shard<K: Eq + Hash, V: Clone, W: Weighter<K, V> + Clone>(
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
