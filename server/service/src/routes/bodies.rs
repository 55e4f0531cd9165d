//! Bodies that are made once, compressed once, and kept within a budget of bytes.

use bytes::Bytes;
use geometry::MeshSize;
use quick_cache::Weighter;
use quick_cache::sync::Cache;

use crate::caching::compress;
use crate::negotiate::Coding;
use crate::problem::AppError;
use case::CaseId;
use cases::models::PathKind;
use cases::pictures::RenderPool;

/// The fewest entries that the cache makes room for in its books.
const EXPECTED_BODIES: usize = 64;

/// What a body holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum BodyKind {
    /// The volume's texture, in so many bits.
    Volume(u8),
    /// The distance texture, every so manieth voxel of it.
    Distance(usize),
    /// The triangles of a mesh.
    Triangles(MeshSize),
    /// Every depth of a mesh.
    Paths(MeshSize, PathKind),
}

/// Names a body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct BodyKey {
    /// The case.
    pub id: CaseId,
    /// What of it.
    pub kind: BodyKind,
    /// How it is compressed.
    pub coding: Coding,
}

#[derive(Debug, Clone)]
struct ByLength;

impl Weighter<BodyKey, Bytes> for ByLength {
    fn weight(&self, _key: &BodyKey, body: &Bytes) -> u64 {
        body.len() as u64
    }
}

/// The bodies in memory. Two requests for the same body make it once.
#[derive(Debug)]
pub struct Bodies {
    cache: Cache<BodyKey, Bytes, ByLength>,
    pool: RenderPool,
}

impl Bodies {
    /// An empty cache of at most `budget_bytes`; bodies are made by `pool`.
    pub fn new(pool: RenderPool, budget_bytes: u64) -> Self {
        Self {
            cache: Cache::with_weighter(EXPECTED_BODIES, budget_bytes, ByLength),
            pool,
        }
    }

    /// A body, made by `make` and compressed unless it is there.
    ///
    /// # Errors
    /// [`Error::Busy`](cases::Error::Busy) when too much work waits.
    pub async fn get(
        &self,
        key: BodyKey,
        make: impl FnOnce() -> Bytes + Send + 'static,
    ) -> Result<Bytes, AppError> {
        let made = self.pool.run(move || compress(&make(), key.coding));
        Ok(self.cache.get_or_insert_async(&key, made).await?)
    }

    /// Drops the bodies of a case.
    pub fn forget(&self, id: &CaseId) {
        self.cache.retain(|key, _| key.id != *id);
    }
}
