//! Compressed bodies, kept in memory.

use bytes::Bytes;
use geometry::MeshSize;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use case::{CaseId, LayerId, MapName, SurfaceName};
use cases::cache::{CaseCache, Part};
use cases::models::PathKind;
use cases::{Cases, ConcurrencyLimit};
use http::negotiate::Coding;
use http::problem::AppError;

/// The content of a body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum BodyKind {
    /// A texture of the volume, with this number of bits.
    Volume(u8, Extent),
    /// The distance texture of a surface, every n-th voxel.
    Distance(usize, SurfaceName),
    /// The triangles of a mesh.
    Triangles(MeshSize),
    /// The texture of a map, and the layer that it belongs to.
    Map(MapName, Option<LayerId>),
    /// The texture of an added layer.
    AddedLayer(LayerId),
    /// Every depth of a mesh of a surface.
    Paths(MeshSize, PathKind, SurfaceName),
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
    pub id: CaseId,
    pub kind: BodyKind,
    pub coding: Coding,
}

/// The bodies in memory, in the cache of the library. Concurrent requests for the same body compute it once. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Bodies {
    cache: CaseCache,
    queue: ConcurrencyLimit,
}

impl Bodies {
    /// The bodies of cases.
    pub fn new(cases: &Cases) -> Self {
        Self {
            cache: cases.library.cache().clone(),
            queue: cases.queue.clone(),
        }
    }

    /// A body from the cache, or encoded from `source` in a turn and compressed.
    ///
    /// # Errors
    /// [`Error::Busy`](cases::Error::Busy) if too much work waits, and those of `source`.
    pub async fn get<S: Send + 'static, E: Into<AppError>>(
        &self,
        BodyKey { id, kind, coding }: BodyKey,
        source: impl Future<Output = Result<S, E>>,
        encode: impl FnOnce(S) -> Bytes + Send + 'static,
    ) -> Result<Bytes, AppError> {
        let part = || Part::Answer(format!("{kind:?}, {coding:?}"));
        if let Some(body) = self.cache.get::<Bytes>(&id, part()) {
            return Ok((*body).clone());
        }
        // Before others can wait for this one to be made, so that nobody waits for the turns of another client.
        let turn = self.queue.turn().await?;
        let made = async {
            let source = source.await.map_err(Into::into)?;
            let encode = move || coding.compress(&encode(source));
            Ok::<_, AppError>(turn.run(encode).await?)
        };
        let body = self.cache.get_or_make(&id, part(), made).await?;
        Ok((*body).clone())
    }
}
