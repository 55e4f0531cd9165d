//! Cases to draw, and a device to draw them on, if there is one.

use std::sync::{Arc, Once};

use geometry::{DepthField, DistanceMap, Envelope, Grid, Mask, Rescale, ShellIndex, Volume};
use glam::DVec3;

use super::super::host::Host;
use super::super::painter::Painter;
use super::super::studio::StudioLimits;
use super::super::{CaseKey, GpuCase, GpuError, GpuJob, GpuSurface};
use crate::{
    BoundingSphere, Camera, FrameSize, NamedView, RenderParameters, RenderRequest, Scene, Window,
};

/// A made-up case, all of whose numbers are known.
pub(super) struct Case {
    key: CaseKey,
    pub(super) volume: Volume,
    pub(super) distance: DistanceMap,
    pub(super) field: DepthField,
    pub(super) normals: DepthField,
    shell: ShellIndex,
}

impl Case {
    /// The voxels of 1 mm at which `is_inside` holds, in a cube of `side` voxels about the origin, and a volume of the same
    /// voxels that is `intensity` of a position in LPS mm.
    pub(super) fn new(
        key: u128,
        side: usize,
        is_inside: impl Fn(DVec3) -> bool,
        intensity: impl Fn(DVec3) -> u16,
    ) -> Arc<Self> {
        let corner = DVec3::splat(-((side - 1) as f64) / 2.0);
        let grid = Grid::aligned([side; 3], [1.0; 3], corner).unwrap();
        let position =
            |index| corner + DVec3::from(grid.voxel(index).map(|coordinate| coordinate as f64));
        let indices = 0..grid.voxel_count();
        let mask = indices
            .clone()
            .map(|index| is_inside(position(index)))
            .collect();
        let voxels = indices.map(|index| intensity(position(index))).collect();
        let rescale = Rescale {
            slope: 1.0,
            intercept: 0.0,
        };
        let volume = Volume::new(grid.clone(), voxels, rescale).unwrap();
        let envelope = Envelope::from_stored(Mask::new(grid, mask).unwrap()).unwrap();
        let distance = geometry::distance_map(&envelope);
        let field = DepthField::new(&distance);
        Arc::new(Self {
            key: CaseKey(key),
            volume,
            normals: field.smoothed(1.5),
            shell: ShellIndex::new(&distance),
            field,
            distance,
        })
    }

    /// A ball of radius 30 mm that is brighter to the patient's left, to posterior and to superior.
    pub(super) fn ball(key: u128) -> Arc<Self> {
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
}

impl GpuCase for Case {
    fn key(&self) -> CaseKey {
        self.key
    }

    fn scene(&self) -> Scene<'_> {
        Scene {
            volume: &self.volume,
            field: &self.field,
            normals: &self.normals,
            shell: &self.shell,
            bounds: BoundingSphere::of_envelope(&self.shell),
        }
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

/// The isosurface itself, as `parameters` say.
pub(super) fn trace(case: &Arc<Case>, parameters: RenderParameters) -> GpuJob {
    GpuJob {
        case: Arc::clone(case) as Arc<dyn GpuCase>,
        request: RenderRequest::new(parameters).unwrap(),
        surface: GpuSurface::Trace,
    }
}

/// Plenty.
pub(super) const LIMITS: StudioLimits = StudioLimits {
    case_bytes: 1 << 28,
    max_side_3d: None,
};

/// A device, or `None` where there is no driver: said aloud, and a failure where tests must not be skipped.
pub(super) fn painter(limits: StudioLimits) -> Option<Painter> {
    match Host::find().and_then(|host| Painter::new(host, limits)) {
        Ok(painter) => Some(painter),
        Err(error) => {
            skip(&error);
            None
        }
    }
}

/// Says why a test is skipped.
///
/// # Panics
/// Where `CI` is set, unless `ISOCORTEX_NO_GPU` is, too.
pub(super) fn skip(error: &GpuError) {
    static ONCE: Once = Once::new();
    let is_set = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    assert!(
        !is_set("CI") || is_set("ISOCORTEX_NO_GPU"),
        "no graphics driver, and CI must have one: {error}"
    );
    ONCE.call_once(|| eprintln!("SKIPPED: the tests of the graphics device: {error}"));
}
