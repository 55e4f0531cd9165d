//! Heads to draw with no server between: the made-up one, and Colin27 where it is at hand.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use geometry::{
    BrainMask, BuiltModel, ClosedBrain, DeformableModel, GeometryError, Mask, MeshSize, PathTable,
    Paths, Volume, phantom,
};
use render::gpu::{CaseKey, GpuError, GpuOptions, GpuPool, KeyedModel};
use render::{
    Background, Camera, Frame, FrameSize, Hits, NamedView, RenderBackend, RenderJob,
    RenderParameters, RenderRequest, Scene, SizedMesh, Window,
};

use crate::heads::data;

/// A head as the service prepares it: its mask closed by 10 mm, the window that of its intensities.
pub(crate) struct Head {
    built: BuiltModel,
    case: KeyedModel,
    window: Window,
}

impl Head {
    fn new(volume: &Volume, mask: &Mask) -> Self {
        let brain = BrainMask::from_mask(mask, volume.grid()).expect("a brain");
        let envelope = geometry::envelope(&brain, 10.0).expect("a radius within range");
        let volume = DeformableModel::crop(volume, &envelope).expect("a mask of this volume");
        let window = volume.percentiles_inside(&envelope, [0.02, 0.98]);
        let [black, white] = window.expect("voxels inside of the envelope");
        let closed = ClosedBrain::Envelope(envelope);
        let built = DeformableModel::build(volume, closed, |_| Ok::<_, GeometryError>(()));
        let built = built.expect("a head that is large enough");
        static KEYS: AtomicU64 = AtomicU64::new(0);
        Self {
            case: KeyedModel {
                key: CaseKey(KEYS.fetch_add(1, Ordering::Relaxed).into()),
                model: Arc::new(built.model.clone()),
            },
            window: Window::between(black, white),
            built,
        }
    }

    /// The made-up head, with voxels of 2 mm.
    pub(crate) fn phantom() -> Self {
        let head = phantom::head(2.0);
        Self::new(&head.volume, &head.brain)
    }

    /// Colin27, `None` without the test data.
    pub(crate) fn colin27() -> Option<Self> {
        let folder = data()?.join("colin27");
        let read = |path: &Path| std::fs::read(path).expect("a file of the test data");
        let limits = imaging::Limits::default();
        let volume = imaging::nifti::read_volume(&read(&folder.join("ch2.nii.gz")), &limits);
        let mask = imaging::nifti::read_mask(&read(&folder.join("ch2bet.nii.gz")), &limits);
        Some(Self::new(
            &volume.expect("a sound volume"),
            &mask.expect("a sound mask"),
        ))
    }

    /// Its model.
    pub(crate) fn model(&self) -> &DeformableModel {
        &self.case.model
    }

    /// What a renderer needs of it.
    pub(crate) fn scene(&self) -> Scene<'_> {
        self.case.scene()
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
        let table = self
            .model()
            .path_table(size, &self.built.distance, Paths::Flow);
        table.expect("a mesh")
    }

    /// A picture without a mesh.
    pub(crate) fn draw(&self, backend: &RenderBackend, request: &RenderRequest) -> Frame {
        let drawn = backend.draw(&self.job(request, None));
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
        let drawn = backend.draw(&self.job(request, Some(mesh)));
        drawn.expect("a picture").frame
    }

    /// What a picture without a mesh shows.
    pub(crate) fn hits(&self, backend: &RenderBackend, request: &RenderRequest) -> Hits {
        backend.hits(&self.job(request, None)).expect("hits")
    }

    fn job(&self, request: &RenderRequest, mesh: Option<SizedMesh>) -> RenderJob {
        RenderJob {
            case: self.case.clone(),
            request: *request,
            mesh,
        }
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
