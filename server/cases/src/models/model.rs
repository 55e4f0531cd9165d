//! The data of one case for rendering and meshes.

use std::fmt;
use std::sync::{Arc, OnceLock};

use bytes::Bytes;
use case::{CaseFacts, CaseId, ObjectKind, SurfaceName};
use geometry::{
    DeformableModel, DepthMaps, DistanceMap, Forest, GeometryError, MeshSize, PathTable, Paths,
    ShrunkMesh,
};
use glam::DVec3;
use pipeline::codec::{decode_forest, decode_paths, decode_volume};
use pipeline::envelope_of;
use quick_cache::Weighter;
use quick_cache::sync::Cache;
use render::gpu::{CaseKey, KeyedModel};
use render::{Hemisphere, Scene};
use serde::{Deserialize, Serialize};
use storage::StoreError;

use crate::cache::{self, CacheValue};
use crate::error::Error;
use crate::library::Library;

/// Tables of paths kept beside the default one, in bytes: four of 10,000 vertices.
const TABLES_BYTES: u64 = 16 << 20;

/// A surface of a case in memory: its model, and the requested tables of paths.
///
/// The distance map, the forest and the mask are not included: only new tables of paths need them, and then they are
/// read.
#[derive(Clone)]
pub struct WarmModel {
    loaded: Arc<LoadedModel>,
    library: Library,
}

/// What is kept of it in the cache of a library. It has no handle of the library: neither would ever be dropped.
pub(super) struct LoadedModel {
    model: Arc<DeformableModel>,
    facts: CaseFacts,
    tables: Cache<TableKey, Arc<PathTable>, ByBytes>,
    id: CaseId,
    surface: SurfaceName,
    /// The centroids of its left and its right half.
    centres: OnceLock<[Option<DVec3>; 2]>,
}

type TableKey = (MeshSize, PathKind);

/// The paths of the vertices.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = Paths))]
#[serde(rename_all = "lowercase")]
pub enum PathKind {
    /// The optimal paths of the second transform, as in the paper.
    #[default]
    Forest,
    /// The gradient of the distance map: the shortest way to a depth.
    Flow,
}

impl LoadedModel {
    /// Reads or builds the model of a surface of a ready case.
    pub(super) async fn load(
        library: &Library,
        id: &CaseId,
        surface: SurfaceName,
    ) -> Result<Self, Error> {
        let loaded = match surface {
            SurfaceName::Whole => Self::load_whole(library, id).await?,
            part => {
                let loaded = library.surface_model(id, part).await?;
                loaded.transpose().map_err(Error::NoSurfaces)?
            }
        };
        let (model, facts) = loaded.ok_or(Error::NoSuchCase)?;
        Ok(Self {
            model: Arc::new(model),
            facts,
            tables: cache::one_shard(ByBytes, TABLES_BYTES, 8),
            id: *id,
            surface,
            centres: OnceLock::new(),
        })
    }

    async fn load_whole(
        library: &Library,
        id: &CaseId,
    ) -> Result<Option<(DeformableModel, CaseFacts)>, StoreError> {
        const KINDS: &[ObjectKind] = &[ObjectKind::Envelope, ObjectKind::Volume, ObjectKind::Paths];
        let decode_all =
            |facts: &CaseFacts, payloads: &[Bytes]| Some((decode(facts, payloads)?, facts.clone()));
        library.load(id, KINDS, decode_all).await
    }
}

impl CacheValue for LoadedModel {
    /// Including the limit for tables of paths.
    fn bytes(&self) -> u64 {
        self.model.bytes() as u64 + TABLES_BYTES
    }
}

impl WarmModel {
    pub(super) fn new(loaded: Arc<LoadedModel>, library: Library) -> Self {
        Self { loaded, library }
    }

    /// Memory in bytes, including the limit for tables of paths.
    pub fn bytes(&self) -> u64 {
        self.loaded.bytes()
    }

    pub fn id(&self) -> &CaseId {
        &self.loaded.id
    }

    /// The facts for clients; the greatest depth and the sphere around the envelope are those of the surface.
    pub fn facts(&self) -> &CaseFacts {
        &self.loaded.facts
    }

    pub fn surface(&self) -> SurfaceName {
        self.loaded.surface
    }

    pub fn model(&self) -> &Arc<DeformableModel> {
        &self.loaded.model
    }

    /// The model, with the key of its textures on a graphics device.
    pub fn keyed(&self) -> KeyedModel {
        KeyedModel {
            // Ids are digests: another surface of another case has this key as rarely as another case.
            key: CaseKey(
                self.loaded
                    .id
                    .number()
                    .wrapping_add(self.loaded.surface as u128),
            ),
            model: Arc::clone(&self.loaded.model),
        }
    }

    /// The centroid of the surface's part of a hemisphere, LPS mm, where the lines of sight of a map end; `None` if it has no
    /// voxel there.
    pub fn hemisphere_centre(&self, hemisphere: Hemisphere) -> Option<DVec3> {
        let centre = |hemisphere: Hemisphere| {
            let normal = DVec3::from_array(self.facts().midsagittal.normal);
            let offset_mm = self.facts().midsagittal.offset_mm;
            let is_of_both = matches!(
                self.loaded.surface,
                SurfaceName::Whole | SurfaceName::Cerebrum
            );
            let is_part =
                |position: DVec3| !is_of_both || hemisphere.has(normal.dot(position) - offset_mm);
            self.loaded.model.shell().centroid(is_part)
        };
        let [left, right] = self
            .loaded
            .centres
            .get_or_init(|| Hemisphere::ALL.map(centre));
        match hemisphere {
            Hemisphere::Left => *left,
            Hemisphere::Right => *right,
        }
    }

    /// The scene for a renderer.
    pub fn scene(&self) -> Scene<'_> {
        Scene::from(&*self.loaded.model)
    }

    /// The table of all depths of a mesh. The default one (30 × 30, forest) is loaded; others are computed at their
    /// first use and kept within 16 MiB. Concurrent callers wait for one computation, which goes on if they leave.
    ///
    /// # Errors
    /// If the mesh cannot be made, the store fails, or the case was deleted.
    pub async fn paths(&self, size: MeshSize, kind: PathKind) -> Result<Arc<PathTable>, Error> {
        if self.is_default(size, kind) {
            return Ok(self.loaded.model.default_paths().clone());
        }
        if let Some(table) = self.loaded.tables.get(&(size, kind)) {
            return Ok(table);
        }
        let of = self.clone();
        let make = tokio::spawn(async move {
            let make = Box::pin(of.make_paths(size, kind));
            of.loaded
                .tables
                .get_or_insert_async(&(size, kind), make)
                .await
        });
        make.await.map_err(StoreError::from)?
    }

    /// Whether a mesh needs no walk: [`WarmModel::shrink`] gives it at once.
    pub fn has_at_hand(&self, size: MeshSize, kind: PathKind) -> bool {
        self.is_default(size, kind) || self.loaded.tables.peek(&(size, kind)).is_some()
    }

    fn is_default(&self, size: MeshSize, kind: PathKind) -> bool {
        kind == PathKind::Forest && size == DeformableModel::DEFAULT_MESH
    }

    async fn make_paths(&self, size: MeshSize, kind: PathKind) -> Result<Arc<PathTable>, Error> {
        let model = Arc::clone(&self.loaded.model);
        let make = move |walk: Walk| model.path_table(size, &walk.distance, walk.paths());
        self.walk(kind, make).await.map(Arc::new)
    }

    /// The mesh at one depth. If its table of paths would exceed the limit for tables, the vertices walk instead.
    ///
    /// # Errors
    /// As [`WarmModel::paths`].
    pub async fn shrink(
        &self,
        size: MeshSize,
        kind: PathKind,
        depth_mm: f32,
    ) -> Result<ShrunkMesh, Error> {
        if self.keeps_table_of(size) {
            return Ok(self.paths(size, kind).await?.shrink(depth_mm));
        }
        let model = Arc::clone(&self.loaded.model);
        let shrink =
            move |walk: Walk| model.shrink_once(size, &walk.distance, walk.paths(), depth_mm);
        Box::pin(self.walk(kind, shrink)).await
    }

    /// Whether the table of paths of a mesh is small enough to be kept.
    pub(super) fn keeps_table_of(&self, size: MeshSize) -> bool {
        let row_bytes = 6 * size.vertex_count() as u64;
        row_bytes * self.loaded.model.default_paths().row_count() as u64 <= TABLES_BYTES / 2
    }

    /// Reads the data for walking and walks, on a blocking thread.
    async fn walk<T: Send + 'static>(
        &self,
        kind: PathKind,
        work: impl Fn(Walk) -> Result<T, GeometryError> + Send + Sync + 'static,
    ) -> Result<T, Error> {
        if !self.loaded.surface.is_whole() {
            let distance = self.distance().await?.ok_or(Error::NoSuchCase)?;
            let walk = move || work(Walk::through(distance, kind));
            return Ok(tokio::task::spawn_blocking(walk)
                .await
                .map_err(StoreError::from)??);
        }
        let kinds: &[ObjectKind] = match kind {
            PathKind::Forest => &[ObjectKind::Envelope, ObjectKind::Forest],
            PathKind::Flow => &[ObjectKind::Envelope],
        };
        let decode_and_work =
            move |facts: &CaseFacts, payloads: &[Bytes]| Walk::decode(facts, payloads).map(&work);
        let done = self
            .library
            .load(&self.loaded.id, kinds, decode_and_work)
            .await?;
        Ok(done.ok_or(Error::NoSuchCase)??)
    }

    /// The distance map, computed from the stored envelope: about 20 ms for a head of 256³.
    ///
    /// # Errors
    /// If the store fails; `None` if the case was deleted.
    pub async fn distance(&self) -> Result<Option<DistanceMap>, StoreError> {
        if !self.loaded.surface.is_whole() {
            return self
                .library
                .surface_distance(&self.loaded.id, self.loaded.surface)
                .await;
        }
        let decode = |facts: &CaseFacts, payloads: &[Bytes]| {
            envelope_of(facts, payloads.first()?).map(|envelope| geometry::distance_map(&envelope))
        };
        self.library
            .load(&self.loaded.id, &[ObjectKind::Envelope], decode)
            .await
    }
}

/// The model from the stored objects envelope, volume and paths, decoded so that little is in memory at a time.
fn decode(facts: &CaseFacts, payloads: &[Bytes]) -> Option<DeformableModel> {
    let [envelope, volume, paths] = payloads else {
        return None;
    };
    let default_paths = decode_paths(paths)?;
    let distance = geometry::distance_map(&envelope_of(facts, envelope)?);
    let depth = DepthMaps::new(&distance);
    drop(distance);
    // Now, not in the first picture.
    depth.normals();
    let volume = decode_volume(volume)?;
    Some(DeformableModel::new(volume, depth, default_paths))
}

/// The data that vertices walk through.
struct Walk {
    distance: DistanceMap,
    /// `None` for walks up the gradient.
    forest: Option<Forest>,
}

impl Walk {
    /// From an envelope and, for the forest's paths, a forest; `None` if they cannot be decoded.
    fn decode(facts: &CaseFacts, payloads: &[Bytes]) -> Option<Self> {
        let envelope = envelope_of(facts, payloads.first()?)?;
        let forest = match payloads.get(1) {
            Some(codes) => Some(decode_forest(codes, &envelope)?),
            None => None,
        };
        Some(Self {
            distance: geometry::distance_map(&envelope),
            forest,
        })
    }

    /// Through a distance map alone; the forest is grown again.
    fn through(distance: DistanceMap, kind: PathKind) -> Self {
        let grown = || geometry::forest(&distance, &geometry::core(&distance));
        Self {
            forest: (kind == PathKind::Forest).then(grown),
            distance,
        }
    }

    fn paths(&self) -> Paths<'_> {
        self.forest.as_ref().map_or(Paths::Flow, Paths::Forest)
    }
}

#[derive(Debug, Clone, Copy)]
struct ByBytes;

impl Weighter<TableKey, Arc<PathTable>> for ByBytes {
    fn weight(&self, _: &TableKey, table: &Arc<PathTable>) -> u64 {
        table.bytes() as u64
    }
}

impl fmt::Debug for WarmModel {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter
            .debug_struct("WarmModel")
            .field("id", self.id())
            .field("bytes", &self.bytes())
            .finish_non_exhaustive()
    }
}
