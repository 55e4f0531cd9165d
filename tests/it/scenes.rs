//! Heads to draw with no server between: the made-up one, and Colin27 where it is at hand.

use std::sync::Arc;

use geometry::{
    BrainMask, DepthField, DistanceMap, Mask, MeshSize, PathTable, Paths, ShellIndex, Volume,
    distance_map, envelope, envelope_mesh, path_table,
};
use render::gpu::{CaseKey, GpuCase, GpuError, GpuOptions, GpuPool};
use render::{
    Background, BoundingSphere, Camera, FrameSize, NamedView, RenderParameters, RenderRequest,
    Scene, Window,
};

use crate::heads::data;

/// A prepared head.
pub(crate) struct Head {
    key: CaseKey,
    volume: Volume,
    distance: DistanceMap,
    field: DepthField,
    normals: DepthField,
    shell: ShellIndex,
    bounds: BoundingSphere,
    window: Window,
}

impl Head {
    /// A head as the service prepares it: its mask closed by 10 mm, the window that of its intensities.
    fn new(key: u128, volume: Volume, brain: &Mask) -> Arc<Self> {
        let brain = BrainMask::from_mask(brain, brain.grid()).expect("a brain");
        let envelope = envelope(&brain, 10.0).expect("a radius within range");
        let distance = distance_map(&envelope);
        let [black, white] = volume
            .percentiles_inside(&envelope, [0.02, 0.98])
            .expect("a volume around its envelope");
        let field = DepthField::new(&distance);
        let shell = ShellIndex::new(&distance);
        Arc::new(Self {
            key: CaseKey(key),
            normals: field.smoothed(1.5),
            bounds: BoundingSphere::of_envelope(&shell),
            window: Window::between(black, white),
            volume,
            distance,
            field,
            shell,
        })
    }

    /// The made-up head, with voxels of 2 mm.
    pub(crate) fn phantom() -> Arc<Self> {
        let head = geometry::phantom::head(2.0);
        Self::new(1, head.volume, &head.brain)
    }

    /// Colin27, `None` without the test data.
    pub(crate) fn colin27() -> Option<Arc<Self>> {
        let folder = data()?.join("colin27");
        let read = |name| std::fs::read(folder.join(name)).expect("a file of the test data");
        let limits = imaging::Limits::default();
        let volume = imaging::nifti::read_volume(&read("ch2.nii.gz"), &limits);
        let brain = imaging::nifti::read_mask(&read("ch2bet.nii.gz"), &limits);
        Some(Self::new(
            27,
            volume.expect("a sound file"),
            &brain.expect("a sound file"),
        ))
    }

    /// A square picture of `side` pixels on nothing, in the head's own window.
    pub(crate) fn request(&self, view: NamedView, depth_mm: f64, side: u32) -> RenderRequest {
        let parameters = RenderParameters {
            depth_mm,
            camera: Camera::named(view),
            size: FrameSize::new(side, side).expect("a size within range"),
            background: Background::Transparent,
            ..RenderParameters::new(self.window)
        };
        RenderRequest::new(parameters).expect("a depth within range")
    }

    /// The table of a mesh of `contours` × `points` along the gradient.
    pub(crate) fn table(&self, [contours, points]: [usize; 2]) -> PathTable {
        let size = MeshSize::new(contours, points).expect("a size within range");
        let mesh = envelope_mesh(&self.field, size).expect("a mesh");
        path_table(&mesh, &self.distance, &self.field, Paths::Flow)
    }
}

impl GpuCase for Head {
    fn key(&self) -> CaseKey {
        self.key
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

/// A graphics device, `None` where there is no driver: said aloud, and a failure where tests must not be skipped.
///
/// # Panics
/// Without a driver where `CI` is set, unless `ISOCORTEX_NO_GPU` is, too.
pub(crate) fn device() -> Option<GpuPool> {
    let skip = |error: GpuError| {
        let is_set = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
        assert!(
            !is_set("CI") || is_set("ISOCORTEX_NO_GPU"),
            "no graphics driver, and CI must have one: {error}"
        );
        eprintln!("SKIPPED: the pictures of the graphics device: {error}");
    };
    GpuPool::start(GpuOptions::default()).map_err(skip).ok()
}
