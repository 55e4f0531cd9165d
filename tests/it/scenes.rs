//! Heads to draw with no server between: the made-up one, and Colin27 where it is at hand.

use std::sync::Arc;

use geometry::{DepthField, MeshSize, PathTable, Paths, envelope_mesh, path_table};
use measure::MeasuredCase;
use render::gpu::{CaseKey, GpuCase, GpuError, GpuOptions, GpuPool};
use render::{Background, Camera, FrameSize, NamedView, RenderParameters, RenderRequest, Scene};

use crate::heads::data;

/// A head as the service prepares it: its mask closed by 10 mm, the window that of its intensities.
pub(crate) struct Head(MeasuredCase);

impl Head {
    fn new(head: &measure::Head) -> Arc<Self> {
        let (case, _) = MeasuredCase::prepare(head, 10.0).expect("a sound head");
        Arc::new(Self(case))
    }

    /// The made-up head, with voxels of 2 mm.
    pub(crate) fn phantom() -> Arc<Self> {
        Self::new(&measure::Head::phantom(2.0).expect("a head that can be written"))
    }

    /// Colin27, `None` without the test data.
    pub(crate) fn colin27() -> Option<Arc<Self>> {
        let folder = data()?.join("colin27");
        let read = |name| std::fs::read(folder.join(name)).expect("a file of the test data");
        Some(Self::new(&measure::Head {
            name: "Colin27".to_owned(),
            volume: read("ch2.nii.gz"),
            mask: read("ch2bet.nii.gz"),
        }))
    }

    /// The depth below its envelope.
    pub(crate) fn field(&self) -> &DepthField {
        &self.0.field
    }

    /// A square picture of `side` pixels on nothing, in the head's own window.
    pub(crate) fn request(&self, view: NamedView, depth_mm: f64, side: u32) -> RenderRequest {
        let parameters = RenderParameters {
            depth_mm,
            camera: Camera::named(view),
            size: FrameSize::new(side, side).expect("a size within range"),
            background: Background::Transparent,
            ..RenderParameters::new(self.0.window)
        };
        RenderRequest::new(parameters).expect("a depth within range")
    }

    /// The table of a mesh of `contours` × `points` along the gradient.
    pub(crate) fn table(&self, [contours, points]: [usize; 2]) -> PathTable {
        let size = MeshSize::new(contours, points).expect("a size within range");
        let mesh = envelope_mesh(&self.0.field, size).expect("a mesh");
        path_table(&mesh, &self.0.distance, &self.0.field, Paths::Flow)
    }
}

impl GpuCase for Head {
    fn key(&self) -> CaseKey {
        self.0.key()
    }

    fn scene(&self) -> Scene<'_> {
        self.0.scene()
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
