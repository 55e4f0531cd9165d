//! The checks of every renderer, on the graphics device.

use std::sync::Mutex;

use super::super::job::Call;
use super::super::painter::Painter;
use super::super::studio::Studio;
use super::super::{CaseKey, GpuError, GpuSurface};
use super::support::{LIMITS, painter};
use crate::conformance::{Limits, check};
use crate::scene_meshes::{SceneMeshes, key_of};
use crate::{Frame, Hits, RenderError, RenderRequest, Renderer, Scene};

/// The graphics device as a renderer of whatever scene it is given.
struct OnDevice {
    painter: Mutex<Painter>,
    meshes: Option<SceneMeshes>,
}

impl OnDevice {
    /// With contours and points of the mesh, or none to trace.
    fn new(mesh: Option<[usize; 2]>) -> Option<Self> {
        Some(Self {
            painter: Mutex::new(painter(LIMITS)?),
            meshes: mesh.map(SceneMeshes::new),
        })
    }

    fn surface(&self, scene: &Scene<'_>, depth_mm: f32) -> GpuSurface {
        match &self.meshes {
            None => GpuSurface::Trace,
            Some(meshes) => GpuSurface::Mesh {
                size: meshes.size,
                mesh: meshes.shrunk(scene, depth_mm),
            },
        }
    }

    fn attempt<T>(
        &self,
        scene: &Scene<'_>,
        request: &RenderRequest,
        draw: impl Fn(&mut Studio, &Call<'_>) -> Result<T, GpuError>,
    ) -> T {
        let key = CaseKey(key_of(scene));
        let surface = self.surface(scene, request.parameters().depth_mm as f32);
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
        if self.meshes.is_some() {
            "mesh"
        } else {
            "trace"
        }
    }

    fn draw(&self, scene: &Scene<'_>, request: &RenderRequest) -> Result<Frame, RenderError> {
        Ok(self.attempt(scene, request, Studio::draw_call).frame)
    }

    fn hits(&self, scene: &Scene<'_>, request: &RenderRequest) -> Result<Hits, RenderError> {
        Ok(self.attempt(scene, request, Studio::hits_call))
    }
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
