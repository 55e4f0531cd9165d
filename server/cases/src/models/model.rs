//! What rendering and meshes need of one case.

use std::fmt;
use std::sync::Arc;

use bytes::Bytes;
use case::{CaseFacts, CaseId, ObjectKind};
use geometry::{
    DepthField, DistanceMap, Forest, GeometryError, MeshSize, PathTable, Paths, ShellIndex,
    ShrunkMesh, Volume,
};
use pipeline::DEFAULT_MESH;
use pipeline::codec::{decode_envelope, decode_forest, decode_paths, decode_volume};
use quick_cache::sync::{Cache, DefaultLifecycle};
use quick_cache::{DefaultHashBuilder, OptionsBuilder, Weighter};
use render::gpu::{CaseKey, GpuCase};
use render::{BoundingSphere, Scene};
use serde::{Deserialize, Serialize};
use storage::StoreError;

use crate::library::Library;

/// How much the field is smoothed for normals: at 1.5 voxels they are on average 2° off those of a smooth surface, at 0 they
/// are 13° off and show the staircase of the voxels.
const NORMAL_SIGMA_VOXELS: f32 = 1.5;

/// Tables of paths kept beside the default one, in bytes: four of 10,000 vertices.
const TABLES_BYTES: u64 = 16 << 20;

/// Everything of a case that rendering and meshes need: some 16 bytes for each voxel of the envelope's box.
///
/// The distance map, the forest and the mask are not among it: they are needed for new tables of paths alone, and read then.
pub struct Model {
    /// Intensities, cropped to the working grid.
    pub volume: Volume,
    /// Depth as a continuous function.
    pub field: Arc<DepthField>,
    /// The same, smoothed: normals are its gradient.
    pub normals: DepthField,
    /// The envelope's voxels by depth.
    pub shell: ShellIndex,
    /// What a camera looks at.
    pub bounds: BoundingSphere,
    /// What clients are told.
    pub facts: CaseFacts,
    default_paths: Arc<PathTable>,
    tables: Cache<TableKey, Arc<PathTable>, ByBytes>,
    library: Library,
    id: CaseId,
}

type TableKey = (MeshSize, PathKind);

/// What vertices follow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = Paths))]
#[serde(rename_all = "lowercase")]
pub enum PathKind {
    /// The optimal paths of the second transform, as in the paper.
    #[default]
    Forest,
    /// Up the gradient of the distance map: the nearest way to a depth.
    Flow,
}

/// Why a table of paths could not be had.
#[derive(Debug, thiserror::Error)]
pub enum PathsError {
    /// The case was deleted meanwhile.
    #[error("the case was deleted")]
    Deleted,
    /// The store failed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The mesh cannot be made.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
}

/// A model's parts, before it knows its store.
struct Parts {
    volume: Volume,
    field: DepthField,
    normals: DepthField,
    shell: ShellIndex,
    default_paths: PathTable,
    facts: CaseFacts,
}

impl Model {
    /// Reads the model of a ready case; `None` where there is none.
    pub(super) async fn load(library: &Library, id: &CaseId) -> Result<Option<Self>, StoreError> {
        const KINDS: &[ObjectKind] = &[ObjectKind::Envelope, ObjectKind::Volume, ObjectKind::Paths];
        let parts = library.load(id, KINDS, Parts::decode).await?;
        Ok(parts.map(|parts| Self {
            volume: parts.volume,
            field: Arc::new(parts.field),
            normals: parts.normals,
            bounds: BoundingSphere::of_envelope(&parts.shell),
            shell: parts.shell,
            facts: parts.facts,
            default_paths: Arc::new(parts.default_paths),
            tables: new_tables(),
            library: library.clone(),
            id: *id,
        }))
    }

    /// The table of all depths of a mesh. The default one (30 × 30, forest) is at hand; others are made at their first use and
    /// kept within 16 MiB. Several callers at once wait for one making.
    ///
    /// # Errors
    /// When the mesh cannot be cut, the store fails, or the case was deleted.
    pub async fn paths(
        &self,
        size: MeshSize,
        kind: PathKind,
    ) -> Result<Arc<PathTable>, PathsError> {
        if self.is_default(size, kind) {
            return Ok(self.default_paths.clone());
        }
        let make = self.make_paths(size, kind);
        self.tables.get_or_insert_async(&(size, kind), make).await
    }

    /// The table of the default mesh: 30 × 30, forest.
    pub fn default_paths(&self) -> &Arc<PathTable> {
        &self.default_paths
    }

    /// Whether a mesh needs no walk: [`Model::shrink`] gives it at once.
    pub fn has_at_hand(&self, size: MeshSize, kind: PathKind) -> bool {
        self.is_default(size, kind) || self.tables.peek(&(size, kind)).is_some()
    }

    fn is_default(&self, size: MeshSize, kind: PathKind) -> bool {
        kind == PathKind::Forest
            && [size.contour_count(), size.points_per_contour()] == DEFAULT_MESH
    }

    async fn make_paths(
        &self,
        size: MeshSize,
        kind: PathKind,
    ) -> Result<Arc<PathTable>, PathsError> {
        let field = self.field.clone();
        let make = move |walk: Walk| {
            let mesh = geometry::envelope_mesh(&field, size)?;
            Ok(geometry::path_table(
                &mesh,
                &walk.distance,
                &field,
                walk.paths(),
            ))
        };
        self.walk(kind, make).await.map(Arc::new)
    }

    /// The mesh at one depth. Where its table of paths would exceed what is kept of tables, none is made: the vertices walk.
    ///
    /// # Errors
    /// As [`Model::paths`].
    pub async fn shrink(
        &self,
        size: MeshSize,
        kind: PathKind,
        depth_mm: f32,
    ) -> Result<ShrunkMesh, PathsError> {
        if self.keeps_table_of(size) {
            return Ok(self.paths(size, kind).await?.shrink(depth_mm));
        }
        let field = self.field.clone();
        let shrink = move |walk: Walk| {
            let mesh = geometry::envelope_mesh(&field, size)?;
            Ok(geometry::shrink_once(
                &mesh,
                &walk.distance,
                &field,
                walk.paths(),
                depth_mm,
            ))
        };
        self.walk(kind, shrink).await
    }

    /// Whether the table of paths of a mesh is small enough to be kept.
    pub(super) fn keeps_table_of(&self, size: MeshSize) -> bool {
        let row_bytes = 6 * size.vertex_count() as u64;
        row_bytes * self.default_paths.row_count() as u64 <= TABLES_BYTES / 2
    }

    /// Reads what walking needs and walks, on a blocking thread.
    async fn walk<T: Send + 'static>(
        &self,
        kind: PathKind,
        work: impl Fn(Walk) -> Result<T, GeometryError> + Send + Sync + 'static,
    ) -> Result<T, PathsError> {
        let kinds: &[ObjectKind] = match kind {
            PathKind::Forest => &[ObjectKind::Envelope, ObjectKind::Forest],
            PathKind::Flow => &[ObjectKind::Envelope],
        };
        let decode_and_work =
            move |_: &CaseFacts, payloads: &[Bytes]| Walk::decode(payloads).map(&work);
        let done = self.library.load(&self.id, kinds, decode_and_work).await?;
        Ok(done.ok_or(PathsError::Deleted)??)
    }

    /// The distance map, made anew from the stored envelope: some 20 ms for a head of 256³.
    ///
    /// # Errors
    /// When the store fails; `None` where the case was deleted.
    pub async fn distance(&self) -> Result<Option<DistanceMap>, StoreError> {
        let decode = |_: &CaseFacts, payloads: &[Bytes]| {
            decode_envelope(payloads.first()?).map(|envelope| geometry::distance_map(&envelope))
        };
        self.library
            .load(&self.id, &[ObjectKind::Envelope], decode)
            .await
    }

    /// Memory held, in bytes, with what the tables of paths may come to take.
    pub fn bytes(&self) -> u64 {
        let volume = 2 * self.volume.voxels().len();
        let fields = 2 * (self.field.values().len() + self.normals.values().len());
        let shell = 4 * self.shell.shell(0.0, f32::INFINITY).len();
        let held = volume + fields + shell + table_bytes(&self.default_paths);
        held as u64 + TABLES_BYTES
    }
}

impl GpuCase for Model {
    fn key(&self) -> CaseKey {
        CaseKey(self.id.number())
    }

    fn scene(&self) -> Scene<'_> {
        Scene {
            volume: &self.volume,
            field: &self.field,
            normals: &self.normals,
            shell: &self.shell,
            bounds: self.bounds,
        }
    }
}

impl Parts {
    fn decode(facts: &CaseFacts, payloads: &[Bytes]) -> Option<Self> {
        let [envelope, volume, paths] = payloads else {
            return None;
        };
        let default_paths = decode_paths(paths)?;
        let distance = geometry::distance_map(&decode_envelope(envelope)?);
        let shell = ShellIndex::new(&distance);
        let field = DepthField::new(&distance);
        drop(distance);
        Some(Self {
            normals: field.smoothed(NORMAL_SIGMA_VOXELS),
            field,
            shell,
            volume: decode_volume(volume)?,
            default_paths,
            facts: facts.clone(),
        })
    }
}

/// What vertices walk through.
struct Walk {
    distance: DistanceMap,
    /// `None` for walks up the gradient.
    forest: Option<Forest>,
}

impl Walk {
    /// From an envelope and, for the forest's paths, a forest; `None` where they cannot be decoded.
    fn decode(payloads: &[Bytes]) -> Option<Self> {
        let envelope = decode_envelope(payloads.first()?)?;
        let forest = match payloads.get(1) {
            Some(codes) => Some(decode_forest(codes, &envelope)?),
            None => None,
        };
        Some(Self {
            distance: geometry::distance_map(&envelope),
            forest,
        })
    }

    fn paths(&self) -> Paths<'_> {
        self.forest.as_ref().map_or(Paths::Flow, Paths::Forest)
    }
}

#[derive(Debug, Clone, Copy)]
struct ByBytes;

impl Weighter<TableKey, Arc<PathTable>> for ByBytes {
    fn weight(&self, _: &TableKey, table: &Arc<PathTable>) -> u64 {
        table_bytes(table) as u64
    }
}

fn table_bytes(table: &PathTable) -> usize {
    6 * table.rows.len() + size_of_val(&table.pieces[..]) + 4 * table.first_piece.len()
}

fn new_tables() -> Cache<TableKey, Arc<PathTable>, ByBytes> {
    // One shard: a shard cannot hold a table that is larger than its part of the budget.
    let options = OptionsBuilder::new()
        .shards(1)
        .estimated_items_capacity(8)
        .weight_capacity(TABLES_BYTES)
        .build()
        .expect("every option is set");
    Cache::with_options(
        options,
        ByBytes,
        DefaultHashBuilder::default(),
        DefaultLifecycle::default(),
    )
}

impl fmt::Debug for Model {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter
            .debug_struct("Model")
            .field("id", &self.id)
            .field("bytes", &self.bytes())
            .finish_non_exhaustive()
    }
}
