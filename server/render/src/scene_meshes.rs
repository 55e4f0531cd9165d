//! Meshes of whatever scene a test draws.

use std::collections::HashMap;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::sync::Mutex;

use geometry::{Envelope, Mask, MeshSize, PathTable, Paths, ShrunkMesh};

use crate::Scene;

/// The meshes of a size, of all scenes that were asked for.
#[derive(Debug)]
pub(crate) struct SceneMeshes {
    pub(crate) size: MeshSize,
    tables: Mutex<HashMap<u128, PathTable>>,
}

impl SceneMeshes {
    /// Meshes of `contours` and `points`.
    pub(crate) fn new([contours, points]: [usize; 2]) -> Self {
        Self {
            size: MeshSize::new(contours, points).unwrap(),
            tables: Mutex::default(),
        }
    }

    /// The mesh of a scene at a depth.
    pub(crate) fn shrunk(&self, scene: &Scene<'_>, depth_mm: f32) -> ShrunkMesh {
        let mut tables = self.tables.lock().unwrap();
        let table = tables
            .entry(key_of(scene))
            .or_insert_with(|| table(scene, self.size));
        table.shrink(depth_mm)
    }
}

/// A key for a scene: equal scenes have equal ones.
pub(crate) fn key_of(scene: &Scene<'_>) -> u128 {
    let mut hasher = DefaultHasher::new();
    scene.volume.voxels().hash(&mut hasher);
    scene.field.values().hash(&mut hasher);
    let matrix = scene.volume.grid().patient_from_voxel().to_cols_array();
    matrix.map(f64::to_bits).hash(&mut hasher);
    scene.volume.grid().size().hash(&mut hasher);
    hasher.finish().into()
}

/// The paths of a scene's mesh. A scene knows its envelope by its voxels alone.
fn table(scene: &Scene<'_>, size: MeshSize) -> PathTable {
    let grid = scene.shell.grid();
    let mut inside = vec![false; grid.voxel_count()];
    for voxel in scene.shell.shell(0.0, f32::INFINITY) {
        inside[grid.index(voxel.position().map(|place| place as usize))] = true;
    }
    let mask = Mask::new(grid.clone(), inside).unwrap();
    let distance = geometry::distance_map(&Envelope::from_stored(mask).unwrap());
    let mesh = geometry::envelope_mesh(scene.field, size).unwrap();
    geometry::path_table(&mesh, &distance, scene.field, Paths::Flow)
}
