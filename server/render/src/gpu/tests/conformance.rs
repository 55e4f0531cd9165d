//! The checks of every renderer, on the graphics device.

use std::collections::HashMap;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::sync::Mutex;

use geometry::{Envelope, Mask, MeshSize, PathTable, Paths};

use super::super::job::Call;
use super::super::painter::Painter;
use super::super::studio::Studio;
use super::super::{CaseKey, GpuError, GpuSurface};
use super::support::{LIMITS, painter};
use crate::conformance::{Limits, check};
use crate::{Frame, Hits, RenderError, RenderRequest, Renderer, Scene};

/// The graphics device as a renderer of whatever scene it is given.
struct OnDevice {
    /// Contours and points of the mesh; none to trace.
    mesh: Option<[usize; 2]>,
    painter: Mutex<Painter>,
    tables: Mutex<HashMap<CaseKey, PathTable>>,
}

impl OnDevice {
    fn new(mesh: Option<[usize; 2]>) -> Option<Self> {
        Some(Self {
            mesh,
            painter: Mutex::new(painter(LIMITS)?),
            tables: Mutex::default(),
        })
    }

    fn surface(&self, key: CaseKey, scene: &Scene<'_>, depth_mm: f32) -> GpuSurface {
        let Some([contours, points]) = self.mesh else {
            return GpuSurface::Trace;
        };
        let size = MeshSize::new(contours, points).unwrap();
        let mut tables = self.tables.lock().unwrap();
        let table = tables.entry(key).or_insert_with(|| table(scene, size));
        let mesh = table.shrink(depth_mm);
        GpuSurface::Mesh { size, mesh }
    }

    fn attempt<T>(
        &self,
        scene: &Scene<'_>,
        request: &RenderRequest,
        draw: impl Fn(&mut Studio, &Call<'_>) -> Result<T, GpuError>,
    ) -> T {
        let key = key_of(scene);
        let surface = self.surface(key, scene, request.parameters().depth_mm as f32);
        let call = Call {
            key,
            scene: *scene,
            request,
            surface: &surface,
        };
        let mut painter = self.painter.lock().unwrap();
        painter.attempt(|studio| draw(studio, &call)).unwrap()
    }
}

impl Renderer for OnDevice {
    fn name(&self) -> &'static str {
        if self.mesh.is_some() { "mesh" } else { "trace" }
    }

    fn draw(&self, scene: &Scene<'_>, request: &RenderRequest) -> Result<Frame, RenderError> {
        Ok(self.attempt(scene, request, Studio::draw_call).frame)
    }

    fn hits(&self, scene: &Scene<'_>, request: &RenderRequest) -> Result<Hits, RenderError> {
        Ok(self.attempt(scene, request, Studio::hits_call))
    }
}

/// A key for a scene: equal scenes have equal ones.
fn key_of(scene: &Scene<'_>) -> CaseKey {
    let mut hasher = DefaultHasher::new();
    scene.volume.voxels().hash(&mut hasher);
    scene.field.values().hash(&mut hasher);
    let matrix = scene.volume.grid().patient_from_voxel().to_cols_array();
    matrix.map(f64::to_bits).hash(&mut hasher);
    scene.volume.grid().size().hash(&mut hasher);
    CaseKey(hasher.finish().into())
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

#[test]
fn the_device_traces_as_a_renderer_must() {
    let Some(renderer) = OnDevice::new(None) else {
        return;
    };
    // 0.02 mm of 1.25.
    let limits = Limits {
        depth_voxels: 0.016,
        mean_difference: 1.0,
        has_soft_edges: false,
    };
    check(&renderer, limits);
}

#[test]
fn the_mesh_does_what_a_renderer_must() {
    let Some(renderer) = OnDevice::new(Some([200, 200])) else {
        return;
    };
    let limits = Limits {
        depth_voxels: 0.5,
        mean_difference: 3.0,
        has_soft_edges: true,
    };
    check(&renderer, limits);
}
