//! Heads to draw with no server between: the made-up one, and Colin27 where it is at hand.

use std::sync::Arc;

use bench::PreparedHead;
use geometry::{DeformableModel, MeshSize, PathTable, Paths};
use render::gpu::{GpuError, GpuOptions, GpuPool};
use render::{
    Background, Camera, Frame, FrameSize, Hits, NamedView, RenderBackend, RenderParameters,
    RenderRequest, SizedMesh,
};

use crate::heads::data;

/// A head as the service prepares it: its mask closed by 10 mm, the window that of its intensities.
pub(crate) struct Head(PreparedHead);

impl Head {
    fn new(head: &bench::Head) -> Self {
        let (prepared, _) = PreparedHead::prepare(head, 10.0).expect("a sound head");
        Self(prepared)
    }

    /// The made-up head, with voxels of 2 mm.
    pub(crate) fn phantom() -> Self {
        Self::new(&bench::Head::phantom(2.0).expect("a head that can be written"))
    }

    /// Colin27, `None` without the test data.
    pub(crate) fn colin27() -> Option<Self> {
        let folder = data()?.join("colin27");
        let read = |name| std::fs::read(folder.join(name)).expect("a file of the test data");
        Some(Self::new(&bench::Head {
            name: "Colin27".to_owned(),
            volume: read("ch2.nii.gz"),
            mask: read("ch2bet.nii.gz"),
        }))
    }

    /// Its model.
    pub(crate) fn model(&self) -> &DeformableModel {
        self.0.model()
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
        let table = self.model().path_table(size, &self.0.distance, Paths::Flow);
        table.expect("a mesh")
    }

    /// A picture without a mesh.
    pub(crate) fn draw(&self, backend: &RenderBackend, request: &RenderRequest) -> Frame {
        let drawn = backend.draw(&self.0.job(*request, None));
        drawn.expect("a picture").frame
    }

    /// A picture of the mesh of a table, at the depth of the request.
    pub(crate) fn draw_mesh(
        &self,
        backend: &RenderBackend,
        table: &PathTable,
        request: &RenderRequest,
    ) -> Frame {
        let mesh = SizedMesh {
            size: table.size,
            mesh: table.shrink(request.parameters().depth_mm as f32),
        };
        let drawn = backend.draw(&self.0.job(*request, Some(mesh)));
        drawn.expect("a picture").frame
    }

    /// What a picture without a mesh shows.
    pub(crate) fn hits(&self, backend: &RenderBackend, request: &RenderRequest) -> Hits {
        backend.hits(&self.0.job(*request, None)).expect("hits")
    }
}

/// A graphics device, `None` where there is no driver: said aloud, and a failure where tests must not be skipped.
///
/// # Panics
/// Without a driver where `CI` is set, unless `ISOCORTEX_NO_GPU` is, too.
pub(crate) fn device() -> Option<Arc<GpuPool>> {
    let skip = |error: GpuError| {
        let is_set = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
        assert!(
            !is_set("CI") || is_set("ISOCORTEX_NO_GPU"),
            "no graphics driver, and CI must have one: {error}"
        );
        eprintln!("SKIPPED: the pictures of the graphics device: {error}");
    };
    let pool = GpuPool::start(GpuOptions::default());
    pool.map_err(skip).ok().map(Arc::new)
}
