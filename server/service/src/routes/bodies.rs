//! A cache of compressed bodies within a budget of bytes.

use std::sync::Arc;

use bytes::Bytes;
use geometry::MeshSize;
use quick_cache::Weighter;
use quick_cache::sync::Cache;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use case::{CaseId, LayerId, MapName};
use cases::models::PathKind;
use cases::{Cases, ConcurrencyLimit};
use http_support::negotiate::Coding;
use http_support::problem::AppError;

/// The fewest entries that the cache makes room for in its books.
const EXPECTED_BODIES: usize = 64;

/// The content of a body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum BodyKind {
    /// A texture of the volume, with this number of bits.
    Volume(u8, Extent),
    /// The distance texture, every n-th voxel.
    Distance(usize),
    /// The triangles of a mesh.
    Triangles(MeshSize),
    /// The texture of a map, and the layer that it belongs to.
    Map(MapName, Option<LayerId>),
    /// The texture of an added layer.
    AddedLayer(LayerId),
    /// Every depth of a mesh.
    Paths(MeshSize, PathKind),
}

/// The part of the acquired volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum Extent {
    /// Cropped to the envelope.
    #[default]
    Envelope,
    /// All of it.
    Whole,
}

impl Extent {
    pub(super) fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// The key of a body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct BodyKey {
    /// The case.
    pub id: CaseId,
    /// The content.
    pub kind: BodyKind,
    /// The coding.
    pub coding: Coding,
}

#[derive(Debug, Clone)]
struct ByLength;

impl Weighter<BodyKey, Bytes> for ByLength {
    fn weight(&self, _key: &BodyKey, body: &Bytes) -> u64 {
        body.len() as u64
    }
}

/// The bodies in memory. Concurrent requests for the same body compute it once. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Bodies {
    cache: Arc<Cache<BodyKey, Bytes, ByLength>>,
    queue: ConcurrencyLimit,
}

impl Bodies {
    /// An empty cache of at most `budget_bytes`. The bodies of a case are dropped when the case is forgotten.
    pub fn new(cases: &Cases, budget_bytes: u64) -> Self {
        let cache = Cache::with_weighter(EXPECTED_BODIES, budget_bytes, ByLength);
        let cache = Arc::new(cache);
        let weak = Arc::downgrade(&cache);
        cases.on_forget(move |id| {
            if let Some(cache) = weak.upgrade() {
                cache.retain(|key: &BodyKey, _| key.id != *id);
            }
        });
        Self {
            cache,
            queue: cases.queue.clone(),
        }
    }

    /// A body from the cache, or encoded from `source` in a turn and compressed.
    ///
    /// # Errors
    /// [`Error::Busy`](cases::Error::Busy) if too much work waits, and those of `source`.
    pub async fn get<S: Send + 'static, E: Into<AppError>>(
        &self,
        key: BodyKey,
        source: impl Future<Output = Result<S, E>>,
        encode: impl FnOnce(S) -> Bytes + Send + 'static,
    ) -> Result<Bytes, AppError> {
        let made = async {
            let turn = self.queue.turn().await?;
            let source = source.await.map_err(Into::into)?;
            let encode = move || key.coding.compress(&encode(source));
            Ok(turn.run(encode).await?)
        };
        self.cache.get_or_insert_async(&key, made).await
    }
}
