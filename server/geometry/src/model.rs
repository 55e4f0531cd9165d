//! The model: the input of pictures and meshes of one surface.

use std::sync::{Arc, OnceLock};

use crate::{
    BoundingSphere, ContourPlanes, DepthField, DistanceMap, Envelope, Fenced, GeometryError,
    MeshSize, PathTable, Paths, ShellIndex, ShrunkMesh, Volume, envelope_mesh_across, path_table,
    shrink_once,
};

/// The smoothing of the field for normals, in voxels. At 1.5, normals are on average 2° off those of a smooth surface;
/// at 0 they are 13° off and show the staircase of the voxels.
const NORMAL_SIGMA_VOXELS: f32 = 1.5;

/// The margin of the cropped volume around the working grid, in voxels, for trilinear sampling. The working grid itself
/// has a margin of 4 voxels around the brain.
const CROP_MARGIN_VOXELS: usize = 1;

/// The maps of depth that pictures need: about 5 bytes per voxel of the working grid.
#[derive(Debug, Clone)]
pub struct DepthMaps {
    field: DepthField,
    normals: OnceLock<DepthField>,
    shell: ShellIndex,
    bounds: BoundingSphere,
}

/// Equality compares the depths, whether or not the smoothed field was computed.
impl PartialEq for DepthMaps {
    fn eq(&self, other: &Self) -> bool {
        (&self.field, &self.shell, self.bounds) == (&other.field, &other.shell, other.bounds)
    }
}

impl DepthMaps {
    /// The maps of a distance map. The smoothed field is computed at its first use.
    pub fn new(distance: &DistanceMap) -> Self {
        let shell = ShellIndex::new(distance);
        Self::from_parts(DepthField::new(distance), shell)
    }

    /// The maps of a field and a shell index of one distance map.
    pub(crate) fn from_parts(field: DepthField, shell: ShellIndex) -> Self {
        Self {
            field,
            normals: OnceLock::new(),
            bounds: BoundingSphere::of_envelope(&shell),
            shell,
        }
    }

    /// Depth as a continuous function.
    pub fn field(&self) -> &DepthField {
        &self.field
    }

    /// The same, smoothed by 1.5 voxels: normals are its gradient. The first call computes it.
    pub fn normals(&self) -> &DepthField {
        self.normals
            .get_or_init(|| self.field.smoothed(NORMAL_SIGMA_VOXELS))
    }

    /// The voxels of the envelope, sorted by depth.
    pub fn shell(&self) -> &ShellIndex {
        &self.shell
    }

    /// The sphere around the envelope.
    pub fn bounds(&self) -> BoundingSphere {
        self.bounds
    }
}

/// The model of one surface: a volume, the depth below the envelope, and the paths of the vertices of a mesh.
///
/// [`DeformableModel::build`] makes it from a volume and a closed brain, [`DeformableModel::new`] from stored parts. It
/// does not contain the distance map and the forest, which only the paths of other meshes need.
#[derive(Debug, Clone, PartialEq)]
pub struct DeformableModel {
    volume: Volume,
    depth: DepthMaps,
    default_paths: Arc<PathTable>,
    contours: ContourPlanes,
}

impl DeformableModel {
    /// The mesh of [`DeformableModel::default_paths`]: 30 × 30.
    pub const DEFAULT_MESH: MeshSize = MeshSize::STANDARD;

    /// A model from its parts: the volume from [`DeformableModel::crop`], the maps of its envelope, and the table of
    /// forest paths for a mesh of [`DeformableModel::DEFAULT_MESH`].
    pub fn new(volume: Volume, depth: DepthMaps, default_paths: PathTable) -> Self {
        Self {
            volume,
            depth,
            default_paths: Arc::new(default_paths),
            contours: ContourPlanes::Sagittal,
        }
    }

    /// The same model, whose meshes have contours on other planes than sagittal ones. The table must be that of such a mesh.
    pub(crate) fn with_contours(self, contours: ContourPlanes) -> Self {
        Self { contours, ..self }
    }

    /// The part of a volume that pictures of an envelope can show; `None` if the two do not overlap.
    pub fn crop(volume: &Volume, envelope: &Envelope) -> Option<Volume> {
        volume.crop_to(envelope.grid(), CROP_MARGIN_VOXELS)
    }

    /// Intensities on their native grid, cropped to the working grid.
    pub fn volume(&self) -> &Volume {
        &self.volume
    }

    /// The maps of the depth below the envelope.
    pub fn depth(&self) -> &DepthMaps {
        &self.depth
    }

    /// Depth as a continuous function.
    pub fn field(&self) -> &DepthField {
        self.depth.field()
    }

    /// The same, smoothed, for normals. The first call computes it.
    pub fn normals(&self) -> &DepthField {
        self.depth.normals()
    }

    /// The voxels of the envelope, sorted by depth.
    pub fn shell(&self) -> &ShellIndex {
        self.depth.shell()
    }

    /// The sphere around the envelope.
    pub fn bounds(&self) -> BoundingSphere {
        self.depth.bounds()
    }

    /// The table of forest paths for a mesh of [`DeformableModel::DEFAULT_MESH`].
    pub fn default_paths(&self) -> &Arc<PathTable> {
        &self.default_paths
    }

    /// The volume and the table of paths, to be stored. Parts that can be computed again are dropped.
    pub fn into_stored(self) -> (Volume, Arc<PathTable>) {
        (self.volume, self.default_paths)
    }

    /// The table of all depths of a mesh. `distance` must be the map that this model was made from.
    ///
    /// # Errors
    /// If the envelope is too small for the mesh.
    pub fn path_table(
        &self,
        size: MeshSize,
        distance: &DistanceMap,
        paths: Paths<'_>,
    ) -> Result<PathTable, GeometryError> {
        let mesh = envelope_mesh_across(self.field(), size, self.contours)?;
        Ok(path_table(&mesh, distance, self.field(), paths))
    }

    /// A mesh at one depth, without a table. `distance` must be the map that this model was made from.
    ///
    /// # Errors
    /// If the envelope is too small for the mesh.
    pub fn shrink_once(
        &self,
        size: MeshSize,
        distance: &DistanceMap,
        paths: Paths<'_>,
        depth_mm: f32,
    ) -> Result<ShrunkMesh, GeometryError> {
        let mesh = envelope_mesh_across(self.field(), size, self.contours)?;
        Ok(shrink_once(&mesh, distance, self.field(), paths, depth_mm))
    }

    /// Its memory in bytes, including the smoothed field.
    pub fn bytes(&self) -> usize {
        let volume = 2 * self.volume.voxels().len();
        let fields = 4 * self.field().values().len();
        let fenced = self.field().fenced().map_or(0, Fenced::bytes);
        let shell = 4 * self.shell().voxels().len();
        volume + fields + fenced + shell + self.default_paths.bytes()
    }
}
