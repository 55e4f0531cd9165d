//! Cases to draw, and a device to draw them on, if there is one.

use std::sync::{Arc, Once};

use geometry::{BuiltModel, DeformableModel, Grid, MeshSize, PathTable, Paths, phantom};
use glam::DVec3;

use super::super::adapter::Adapter;
use super::super::renderer::GpuLimits;
use super::super::worker::GpuWorker;
use super::super::{CaseKey, GpuError, GpuJob, GpuSurface, KeyedModel};
use crate::{
    Camera, FrameSize, KeyedLayers, NamedView, RenderParameters, RenderRequest, Scene, Window,
};

/// A synthetic case with known numbers.
#[derive(Clone)]
pub(super) struct Case {
    pub(super) keyed: KeyedModel,
    built: Arc<BuiltModel>,
}

impl Case {
    /// The voxels of 1 mm for which `is_inside` holds, in a cube of `side` voxels around the origin, and a volume on the
    /// same grid with the `intensity` of each position in LPS mm.
    pub(super) fn new(
        key: u128,
        side: usize,
        is_inside: impl Fn(DVec3) -> bool,
        intensity: impl Fn(DVec3) -> u16,
    ) -> Self {
        let corner = DVec3::splat(-((side - 1) as f64) / 2.0);
        let grid = Grid::aligned([side; 3], [1.0; 3], corner).unwrap();
        let envelope = phantom::envelope(&grid, is_inside);
        let built = phantom::model(phantom::volume(grid, intensity), envelope);
        let keyed = KeyedModel {
            key: CaseKey(key),
            model: Arc::new(built.model.clone()),
        };
        Self {
            keyed,
            built: Arc::new(built),
        }
    }

    /// A ball of radius 30 mm that is brighter to the patient's left, to posterior and to superior.
    pub(super) fn ball(key: u128) -> Self {
        Self::new(
            key,
            71,
            |position| position.length() <= 30.0,
            |position| {
                let brighter = position * DVec3::new(1.5, 0.75, 0.4);
                (110.0 + brighter.element_sum()) as u16
            },
        )
    }

    pub(super) fn model(&self) -> &DeformableModel {
        &self.keyed.model
    }

    pub(super) fn scene(&self) -> Scene<'_> {
        self.keyed.scene()
    }

    /// The table of all depths of a mesh of `contours` × `points`, along the gradient.
    pub(super) fn table(&self, contours: usize, points: usize) -> PathTable {
        self.table_along(Paths::Flow, contours, points)
    }

    /// The same along the forest.
    pub(super) fn forest_table(&self, contours: usize, points: usize) -> PathTable {
        self.table_along(Paths::Forest(&self.built.forest), contours, points)
    }

    fn table_along(&self, paths: Paths<'_>, contours: usize, points: usize) -> PathTable {
        let size = MeshSize::new(contours, points).unwrap();
        let table = self.model().path_table(size, &self.built.distance, paths);
        table.unwrap()
    }
}

/// A view of 128 × 128 pixels.
pub(super) fn parameters(view: NamedView, depth_mm: f64) -> RenderParameters {
    RenderParameters {
        depth_mm,
        camera: Camera::named(view),
        size: FrameSize::new(128, 128).unwrap(),
        ..RenderParameters::new(Window::between(0.0, 255.0))
    }
}

/// The isosurface itself, with these parameters.
pub(super) fn trace(case: &Case, parameters: RenderParameters) -> GpuJob {
    GpuJob {
        case: case.keyed.clone(),
        request: RenderRequest::new(parameters).unwrap(),
        surface: GpuSurface::Trace,
        layers: KeyedLayers::default(),
    }
}

/// Ample limits.
pub(super) const LIMITS: GpuLimits = GpuLimits {
    case_bytes: 1 << 28,
    max_side_3d: None,
};

/// A device, or `None` if there is no driver, which is reported, or fails if tests must not be skipped.
pub(super) fn worker(limits: GpuLimits) -> Option<GpuWorker> {
    match Adapter::find().and_then(|adapter| GpuWorker::new(adapter, limits)) {
        Ok(worker) => Some(worker),
        Err(error) => {
            skip(&error);
            None
        }
    }
}

/// Reports why a test is skipped.
///
/// # Panics
/// If `CI` is set and `ISOCORTEX_NO_GPU` is not.
pub(super) fn skip(error: &GpuError) {
    static ONCE: Once = Once::new();
    let is_set = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    assert!(
        !is_set("CI") || is_set("ISOCORTEX_NO_GPU"),
        "no graphics driver, and CI must have one: {error}"
    );
    ONCE.call_once(|| eprintln!("SKIPPED: the tests of the graphics device: {error}"));
}
