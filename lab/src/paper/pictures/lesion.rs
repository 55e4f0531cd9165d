//! A synthetic lesion in ten mesh sizes and by voxels: Figure 7.

use std::sync::Arc;

use crate::study::{Effect, Ground, Lesion, Place};
use analysis::midsagittal_plane;
use geometry::{DeformableModel, MeshSize};
use glam::DVec3;
use render::gpu::KeyedModel;
use render::{
    Camera, Frame, KeyedLayers, NamedView, RenderBackend, RenderJob, RenderParameters,
    RenderRequest, SizedMesh, SliceParameters, SlicePlane, SliceRequest, draw_slice,
};

use super::sheet::{Cell, Cells};
use super::{Picture, looking_at, square};
use crate::agreement::MESH_SIZES;
use crate::prepared::next_key;
use crate::{BenchError, PreparedHead};

const CELL: u32 = 150;
const ZOOM: f64 = 2.6;
const LEVEL: u8 = 6;
/// The number of places to choose from, and the seed of all random choices.
const PLACES: usize = 40;
const SEED: u64 = 2006;
/// The depths of a suitable place, in mm: a shallow isosurface, but below the crowns.
const SUITABLE_MM: std::ops::RangeInclusive<f32> = 6.0..=14.0;
/// The mean radius of the lesion, in mm.
const RADIUS_MM: f64 = 9.0;
/// The strongest signs of the study.
const EFFECT: Effect = Effect {
    blur_mm: 2.0,
    thickening_mm: 2.0,
    darkening: 0.2,
    brightening: 0.0,
};
/// The directions of view.
const VIEWS: [NamedView; 5] = [
    NamedView::Left,
    NamedView::Right,
    NamedView::Anterior,
    NamedView::Posterior,
    NamedView::Superior,
];

/// The ten meshes in two rows; in a third one voxels, the exact isosurface with and without the lesion, and two slices.
pub(super) fn figure_7(head: &PreparedHead) -> Result<Vec<Picture>, BenchError> {
    let volume = head.model().volume();
    let plane = midsagittal_plane(head.distance.envelope(), volume);
    let ground = Ground::new(analysis::Head {
        volume,
        depth: head.model().field(),
        plane: &plane,
    })?;
    let Some((place, view)) = best_seen(head, ground.places(PLACES, SEED)) else {
        return Ok(Vec::new());
    };
    let with_lesion = ground.with_lesion(&Lesion {
        centre_in_patient: place.position_in_patient,
        radius_mm: RADIUS_MM,
        effect: EFFECT,
        band_to: None,
        seed: SEED,
    });
    let model = head.model();
    let paths = model.default_paths().as_ref().clone();
    let model = DeformableModel::new(with_lesion, model.depth().clone(), paths);
    let case = KeyedModel {
        key: next_key(),
        model: Arc::new(model),
    };
    let camera = Camera::named(view).with_zoom(ZOOM)?;
    let request = RenderRequest::new(RenderParameters {
        depth_mm: place.depth_mm.into(),
        camera: looking_at(camera, &head.scene().bounds, place.position_in_patient)?,
        size: square(CELL)?,
        ..RenderParameters::new(head.window)
    })?;
    let close_up = CloseUp {
        head,
        case: &case,
        place,
        request,
    };
    let meshes = close_up.meshes()?;
    let (few, many) = meshes.split_at(5);
    Ok(vec![
        Cells::row(few.to_vec()).picture("figure_7_a_to_e", LEVEL)?,
        Cells::row(many.to_vec()).picture("figure_7_f_to_j", LEVEL)?,
        Cells::row(close_up.others()?).picture("figure_7_k", LEVEL)?,
    ])
}

/// The place where the isosurface faces one of the views most directly, and that view; shallow places first.
fn best_seen(head: &PreparedHead, places: Vec<Place>) -> Option<(Place, NamedView)> {
    let field = head.model().field();
    let grid = field.grid();
    let facing = |place: &Place, view: NamedView| {
        let voxel = grid
            .voxel_from_patient()
            .transform_point3(place.position_in_patient);
        let inwards = field.gradient(voxel.as_vec3()).as_dvec3();
        let inwards = grid.patient_from_voxel().transform_vector3(inwards);
        let towards_viewer = view.orientation().inverse() * DVec3::Z;
        -inwards.normalize_or_zero().dot(towards_viewer)
    };
    let score = |place: &Place, view| {
        let is_suitable = SUITABLE_MM.contains(&place.depth_mm);
        facing(place, view) + f64::from(u8::from(is_suitable)) * 2.0
    };
    let pairs = places
        .into_iter()
        .flat_map(|place| VIEWS.map(|view| (place, view)));
    pairs.max_by(|(a, from), (b, to)| score(a, *from).total_cmp(&score(b, *to)))
}

/// Pictures around the lesion.
struct CloseUp<'a> {
    head: &'a PreparedHead,
    /// The head with the lesion.
    case: &'a KeyedModel,
    place: Place,
    request: RenderRequest,
}

impl CloseUp<'_> {
    fn drawn(
        &self,
        backend: &RenderBackend,
        case: &KeyedModel,
        mesh: Option<SizedMesh>,
    ) -> Result<Frame, BenchError> {
        let job = RenderJob {
            case: case.clone(),
            request: self.request,
            mesh,
            layers: KeyedLayers::default(),
        };
        Ok(backend.draw(&job)?.frame)
    }

    /// The ten meshes of the paper.
    fn meshes(&self) -> Result<Vec<Cell>, BenchError> {
        let cell = |(letter, [contours, points]): (char, [usize; 2])| {
            let size = MeshSize::new(contours, points)?;
            let (_, table) = self.head.table(size)?;
            let mesh = SizedMesh {
                size,
                mesh: table.shrink(self.place.depth_mm),
            };
            let frame = self.drawn(&RenderBackend::Mesh, self.case, Some(mesh))?;
            Ok((format!("{letter}: {}", size.triangle_count()), frame))
        };
        ('a'..).zip(MESH_SIZES).map(cell).collect()
    }

    /// Voxels, the exact isosurface, the same without the lesion, and two slices.
    fn others(&self) -> Result<Vec<Cell>, BenchError> {
        let trace = &RenderBackend::Trace;
        Ok(vec![
            (
                "k: voxels".to_owned(),
                self.drawn(&RenderBackend::Splat, self.case, None)?,
            ),
            ("exact".to_owned(), self.drawn(trace, self.case, None)?),
            (
                "no lesion".to_owned(),
                self.drawn(trace, &self.head.case, None)?,
            ),
            ("coronal".to_owned(), self.slice(SlicePlane::Coronal)?),
            ("axial".to_owned(), self.slice(SlicePlane::Axial)?),
        ])
    }

    /// A slice through the lesion, at the scale of the other pictures.
    fn slice(&self, plane: SlicePlane) -> Result<Frame, BenchError> {
        let centre = self.place.position_in_patient;
        let scene = self.case.scene();
        let mut parameters = SliceParameters {
            zoom: ZOOM,
            size: square(CELL)?,
            ..SliceParameters::new(plane, centre[plane.axis()], self.head.window)
        };
        let projection = SliceRequest::new(parameters.clone())?.projection(&scene.bounds);
        let off = projection.frame_from_patient().transform_point3(centre);
        let middle = 0.5 * f64::from(CELL);
        let mm = projection.mm_per_pixel();
        parameters.pan_mm = [(middle - off.x) * mm, (off.y - middle) * mm];
        Ok(draw_slice(&scene, &SliceRequest::new(parameters)?))
    }
}
