//! A cache bounded by bytes.

use std::collections::HashMap;
use std::hash::Hash;

/// Values by key; the least recently used are dropped first.
#[derive(Debug)]
pub(super) struct Cache<K, V> {
    limit: u64,
    clock: u64,
    entries: HashMap<K, Entry<V>>,
}

#[derive(Debug)]
struct Entry<V> {
    value: V,
    bytes: u64,
    used: u64,
}

impl<K: Copy + Eq + Hash, V> Cache<K, V> {
    /// An empty cache for at most `limit` bytes.
    pub(super) fn new(limit: u64) -> Self {
        Self {
            limit,
            clock: 0,
            entries: HashMap::new(),
        }
    }

    /// The limit for all values, in bytes.
    pub(super) fn limit(&self) -> u64 {
        self.limit
    }

    /// The bytes of all values.
    pub(super) fn bytes(&self) -> u64 {
        self.entries.values().map(|entry| entry.bytes).sum()
    }

    /// The value of a key, which becomes the most recently used.
    pub(super) fn get(&mut self, key: K) -> Option<&V> {
        self.clock += 1;
        let entry = self.entries.get_mut(&key)?;
        entry.used = self.clock;
        Some(&entry.value)
    }

    /// Drops values until `bytes` more fit, the least recently used first.
    pub(super) fn make_room(&mut self, bytes: u64) {
        while self.bytes().saturating_add(bytes) > self.limit {
            let oldest = self.entries.iter().min_by_key(|(_, entry)| entry.used);
            let Some((&oldest, _)) = oldest else { break };
            self.entries.remove(&oldest);
        }
    }

    pub(super) fn insert(&mut self, key: K, value: V, bytes: u64) {
        self.make_room(bytes);
        self.clock += 1;
        let used = self.clock;
        self.entries.insert(key, Entry { value, bytes, used });
    }

    pub(super) fn clear(&mut self) {
        self.entries.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_used_longest_ago_gives_way() {
        let mut cache = Cache::new(10);
        cache.insert('a', 1, 4);
        cache.insert('b', 2, 4);
        assert_eq!(cache.get('a'), Some(&1));
        cache.insert('c', 3, 4);
        assert_eq!(
            ['a', 'b', 'c'].map(|key| cache.get(key).copied()),
            [Some(1), None, Some(3)]
        );
        assert_eq!(cache.bytes(), 8);
        cache.make_room(10);
        assert_eq!(cache.bytes(), 0);
    }
}
