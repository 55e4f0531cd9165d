//! Checks that every renderer must pass, on a synthetic case whose pictures are known on paper, and the [`Agreement`] of pictures.
//!
//! A renderer passes if [`check`] does not panic.

mod agreement;
mod layers;

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

use geometry::{
    Cut, DistanceMap, Envelope, Face, Grid, MeshSize, PathTable, Paths, Volume, phantom,
};
use glam::{DAffine3, DMat3, DVec3};

pub use agreement::{Agreement, difference_picture};

use crate::gpu::{CaseKey, KeyedModel};
use crate::{
    Background, Camera, ColorMap, Frame, FrameSize, Hits, KeyedLayers, Look, NamedView,
    PixelFormat, RenderBackend, RenderJob, RenderParameters, RenderRequest, SizedMesh, Window,
};

/// How much a renderer may differ from the truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Greatest distance of a hit from {depth = D}, in working voxels, from 5 voxels of depth on; nearer the envelope,
    /// where its terraces are smoothed away, a voxel more.
    pub depth_voxels: f64,
    /// Mean difference from the exact renderer over covered pixels, in levels of 255.
    pub mean_difference: f64,
}

/// A synthetic case: an ellipsoid of half axes 30, 38 and 26 mm about (5, −7, 11), at 1.25 mm.
#[derive(Debug)]
struct Phantom {
    case: KeyedModel,
    distance: DistanceMap,
}

const CENTRE: DVec3 = DVec3::new(5.0, -7.0, 11.0);
const HALF_AXES: DVec3 = DVec3::new(30.0, 38.0, 26.0);
const VOXEL_MM: f64 = 1.25;

impl Phantom {
    /// The ellipsoid, and a volume on a grid of its own that is `intensity` of a position in LPS mm.
    fn new(patient_from_voxel: DAffine3, intensity: impl Fn(DVec3) -> u16) -> Self {
        let native = Grid::new([80, 90, 70], patient_from_voxel).unwrap();
        Self::of_volume(phantom::volume(native, intensity))
    }

    /// A bright ellipsoid as far as a cut leaves it.
    fn cut_by(cut: Cut) -> Self {
        let native = Grid::new([80, 90, 70], aligned()).unwrap();
        let envelope = envelope_where(|position| cut.distance_mm(position) >= 0.0);
        Self::of(
            phantom::volume(native, |_| 200),
            envelope.with_cuts(vec![cut]),
        )
    }

    fn of_volume(volume: Volume) -> Self {
        Self::of(volume, envelope_where(|_| true))
    }

    fn of(volume: Volume, envelope: Envelope) -> Self {
        let built = phantom::model(volume, envelope);
        Self {
            case: KeyedModel {
                key: next_key(),
                model: Arc::new(built.model),
            },
            distance: built.distance,
        }
    }
}

/// The part of the ellipsoid where something holds of a position in LPS mm.
fn envelope_where(is_seen: impl Fn(DVec3) -> bool) -> Envelope {
    let corner = CENTRE - DVec3::new(40.0, 45.0, 35.0);
    let working = Grid::aligned([64, 72, 56], [VOXEL_MM; 3], corner).unwrap();
    phantom::envelope(&working, |position| {
        ((position - CENTRE) / HALF_AXES).length() <= 1.0 && is_seen(position)
    })
}

/// A key that no other case of this process has.
fn next_key() -> CaseKey {
    static NEXT: AtomicU64 = AtomicU64::new(0);
    CaseKey(u128::from(NEXT.fetch_add(1, Ordering::Relaxed)))
}

/// A backend, and the mesh that it draws.
struct Renderer {
    backend: RenderBackend,
    /// All phantoms have the same envelope and so the same mesh.
    table: OnceLock<PathTable>,
    layers: KeyedLayers,
}

impl Renderer {
    fn new(backend: RenderBackend) -> Self {
        Self {
            backend,
            table: OnceLock::new(),
            layers: KeyedLayers::default(),
        }
    }

    /// The same with layers in every picture.
    fn with_layers(&self, layers: KeyedLayers) -> Self {
        Self {
            backend: self.backend.clone(),
            table: self.table.clone(),
            layers,
        }
    }

    /// Contours and points of the mesh: fine, so that its facets do not show.
    const MESH: [usize; 2] = [200, 200];

    fn job(&self, phantom: &Phantom, request: &RenderRequest) -> RenderJob {
        let mesh = self.backend.needs_mesh().then(|| {
            let table = self.table.get_or_init(|| table(phantom));
            let depth_mm = request.parameters().depth_mm as f32;
            SizedMesh {
                size: table.size,
                mesh: table.shrink(depth_mm),
            }
        });
        RenderJob {
            case: phantom.case.clone(),
            request: *request,
            mesh,
            layers: self.layers.clone(),
        }
    }

    fn draw(&self, phantom: &Phantom, request: &RenderRequest) -> Frame {
        let drawn = self.backend.draw(&self.job(phantom, request));
        drawn.expect("a picture").frame
    }

    fn hits(&self, phantom: &Phantom, request: &RenderRequest) -> Hits {
        let hits = self.backend.hits(&self.job(phantom, request));
        hits.expect("hits")
    }
}

fn table(phantom: &Phantom) -> PathTable {
    let [contours, points] = Renderer::MESH;
    let size = MeshSize::new(contours, points).unwrap();
    let model = &phantom.case.model;
    let table = model.path_table(size, &phantom.distance, Paths::Flow);
    table.unwrap()
}

/// Voxels of 1.1 mm along L, P and S around the ellipsoid.
fn aligned() -> DAffine3 {
    DAffine3 {
        matrix3: DMat3::from_diagonal(DVec3::splat(1.1)),
        translation: CENTRE - DVec3::new(43.5, 49.0, 38.0),
    }
}

fn bright() -> Phantom {
    Phantom::new(aligned(), |_| 200)
}

/// A picture of the bright ellipsoid, with its default mesh.
#[cfg(test)]
pub(crate) fn job() -> RenderJob {
    let case = bright().case;
    let table = case.model.default_paths();
    let mesh = SizedMesh {
        size: table.size,
        mesh: table.shrink(0.0),
    };
    RenderJob {
        mesh: Some(mesh),
        request: request(parameters()),
        layers: KeyedLayers::default(),
        case,
    }
}

/// Lit everywhere alike.
fn lit() -> Look {
    Look {
        ambient: 1.0,
        ..Look::default()
    }
}

/// The same over nothing.
fn clear() -> Look {
    Look {
        background: Background::Transparent,
        ..lit()
    }
}

fn parameters() -> RenderParameters {
    RenderParameters {
        size: FrameSize::new(96, 96).unwrap(),
        look: lit(),
        ..RenderParameters::new(Window::between(0.0, 255.0))
    }
}

fn request(parameters: RenderParameters) -> RenderRequest {
    RenderRequest::new(parameters).unwrap()
}

/// Standard directions and odd ones.
fn cameras() -> Vec<Camera> {
    let odd = [
        [0.3, -0.5, 0.1, 0.8],
        [0.7, 0.2, -0.6, 0.3],
        [0.1, 0.9, 0.4, -0.2],
    ];
    let odd = odd.map(|orientation| Camera::new(orientation, 1.0, [0.0; 2]).unwrap());
    NamedView::ALL
        .into_iter()
        .map(Camera::named)
        .chain(odd)
        .collect()
}

/// Runs all checks.
///
/// # Panics
/// If a check fails: the message says which.
pub fn check(backend: RenderBackend, limits: Limits) {
    let renderer = &Renderer::new(backend);
    there_are_no_holes_inside_the_silhouette(renderer);
    hits_lie_on_the_isosurface(renderer, &limits);
    hits_are_those_of_the_ellipsoid_that_face_the_viewer(renderer);
    a_mark_on_the_right_shows_from_the_right_alone(renderer);
    any_number_of_threads_gives_the_same_bytes(renderer);
    a_pixel_shows_the_native_intensity_at_its_hit(renderer);
    a_head_light_is_brightest_where_the_surface_faces_the_viewer(renderer);
    outside_of_the_volume_nothing_is_shown(renderer);
    beside_a_cut_nothing_is_shown(renderer);
    beside_a_fence_nothing_is_shown(renderer);
    colours_are_those_of_the_map(renderer);
    deeper_than_the_deepest_there_is_nothing(renderer);
    a_slab_averages_over_depth_but_not_beyond_the_envelope(renderer);
    one_pixel_and_extreme_zooms_are_drawn(renderer);
    pictures_agree_with_the_exact_ones(renderer, &limits);
    layers::check(renderer, &limits);
}

fn pictures_agree_with_the_exact_ones(renderer: &Renderer, limits: &Limits) {
    let case = Phantom::new(aligned(), |position| {
        (3.0 * position.x - 2.0 * position.y + position.z + 300.0) as u16
    });
    let judge = Renderer::new(RenderBackend::Trace);
    for camera in cameras() {
        for depth_mm in [0.0, 5.0, 10.0, 20.0] {
            let request = request(RenderParameters {
                depth_mm,
                camera,
                look: Background::Transparent.into(),
                window: Window::between(100.0, 500.0),
                ..parameters()
            });
            let found = renderer.draw(&case, &request);
            let exact = judge.draw(&case, &request);
            let [mut sum, mut both] = [0.0; 2];
            for index in 0..96 * 96 {
                let [x, y] = [index % 96, index / 96];
                let [found, reference] = [&found, &exact].map(|frame| frame.pixel(x, y).unwrap());
                match (found[1] > 0, reference[1] > 0) {
                    (true, true) => {
                        both += 1.0;
                        sum += f64::from(found[0].abs_diff(reference[0]));
                    }
                    (false, false) => {}
                    _ => assert!(
                        is_at_edge(&exact, [x, y]),
                        "({x}, {y}) is more than a pixel off the silhouette at {depth_mm} mm, {camera:?}"
                    ),
                }
            }
            assert!(both > 20.0, "{camera:?} at {depth_mm} mm");
            let mean = sum / both;
            assert!(
                mean <= limits.mean_difference,
                "{mean} levels off at {depth_mm} mm, {camera:?}"
            );
        }
    }
}

/// Whether the eight pixels around a pixel differ in that they show something.
fn is_at_edge(frame: &Frame, [x, y]: [u32; 2]) -> bool {
    let around = (y.saturating_sub(1)..=y + 1)
        .flat_map(|y| (x.saturating_sub(1)..=x + 1).map(move |x| [x, y]));
    let covered: Vec<bool> = around
        .map(|[x, y]| frame.pixel(x, y).is_some_and(|pixel| pixel[1] > 0))
        .collect();
    covered.contains(&true) && covered.contains(&false)
}

fn there_are_no_holes_inside_the_silhouette(renderer: &Renderer) {
    let case = bright();
    for camera in cameras() {
        for zoom in [0.3, 1.0, 2.0, 4.0] {
            for depth_mm in [0.0, 3.3, 12.0] {
                let camera = camera.with_zoom(zoom).unwrap();
                let request = request(RenderParameters {
                    depth_mm,
                    camera,
                    ..parameters()
                });
                let frame = renderer.draw(&case, &request);
                let width = frame.size().width() as usize;
                let mut lit = 0;
                // An ellipsoid's picture is convex: a row's lit pixels stand in one piece.
                for (y, row) in (0..).zip(frame.bytes().chunks_exact(width)) {
                    let first = row.iter().position(|&byte| byte > 0).unwrap_or(width);
                    let last = row
                        .iter()
                        .rposition(|&byte| byte > 0)
                        .map_or(first, |last| last + 1);
                    for (x, &byte) in row.iter().enumerate().take(last).skip(first) {
                        let is_soft = || byte > 0 && is_beside_black(&frame, x, y);
                        assert!(
                            byte == 200 || is_soft(),
                            "{byte} at ({x}, {y}), {depth_mm} mm, {camera:?}"
                        );
                    }
                    lit += last - first;
                }
                assert!(lit > 20, "{camera:?} at {depth_mm} mm shows {lit} pixels");
            }
        }
    }
}

/// Whether one of the eight pixels around a pixel of a grey picture is black or outside of the picture.
pub(crate) fn is_beside_black(frame: &Frame, x: usize, y: usize) -> bool {
    let [x, y] = [x as u32, y as u32];
    (0..9).any(|step| {
        let [x, y] = [x + step % 3, y + step / 3].map(|place| place.wrapping_sub(1));
        frame.pixel(x, y).is_none_or(|pixel| pixel[0] == 0)
    })
}

fn hits_lie_on_the_isosurface(renderer: &Renderer, limits: &Limits) {
    let case = bright();
    let field = case.case.model.field();
    for camera in cameras() {
        for (zoom, depth_mm) in [(1.0, 0.0), (1.0, 8.0), (3.0, 15.5), (0.4, 5.0)] {
            let camera = camera.with_zoom(zoom).unwrap();
            let request = request(RenderParameters {
                depth_mm,
                camera,
                ..parameters()
            });
            let hits = renderer.hits(&case, &request);
            let voxel_from_patient = field.grid().voxel_from_patient();
            let mut count = 0;
            for index in 0..96 * 96 {
                if let Some(position) = hits.position_in_patient(index % 96, index / 96) {
                    let position_in_voxel = voxel_from_patient.transform_point3(position);
                    let found = field.depth_mm(position_in_voxel.as_vec3());
                    let off = (f64::from(found) - depth_mm).abs() / VOXEL_MM;
                    let shallow = if depth_mm < 5.0 * VOXEL_MM { 1.0 } else { 0.0 };
                    let allowed = limits.depth_voxels + shallow;
                    assert!(off < allowed, "{off} voxel off at {depth_mm} mm");
                    count += 1;
                }
            }
            assert!(count > 100);
        }
    }
}

fn hits_are_those_of_the_ellipsoid_that_face_the_viewer(renderer: &Renderer) {
    let case = bright();
    let request = request(RenderParameters {
        camera: Camera::named(NamedView::Left),
        ..parameters()
    });
    let hits = renderer.hits(&case, &request);
    let centre = hits.position_in_patient(48, 48).unwrap();
    let left_pole = CENTRE.x + HALF_AXES.x;
    assert!((centre.x - left_pole).abs() < VOXEL_MM, "{centre}");
    assert_eq!(hits.position_in_patient(0, 0), None);
    assert_eq!(hits.position_in_patient(96, 0), None);
}

/// The mean of a picture's bytes.
fn mean(bytes: &[u8]) -> f64 {
    bytes.iter().map(|&byte| f64::from(byte)).sum::<f64>() / bytes.len() as f64
}

fn a_mark_on_the_right_shows_from_the_right_alone(renderer: &Renderer) {
    let mark = CENTRE - DVec3::X * HALF_AXES.x;
    let intensity = |position: DVec3| {
        if (position - mark).length() < 8.0 {
            1000
        } else {
            50
        }
    };
    let mut ras = aligned();
    ras.matrix3.x_axis = -ras.matrix3.x_axis;
    ras.matrix3.y_axis = -ras.matrix3.y_axis;
    ras.translation += DVec3::new(79.0 * 1.1, 89.0 * 1.1, 0.0);
    let turn = DMat3::from_quat(glam::DQuat::from_xyzw(0.05, -0.08, 0.1, 0.98).normalize());
    let oblique = DAffine3::from_translation(CENTRE)
        * DAffine3::from_mat3(turn)
        * DAffine3::from_translation(-CENTRE)
        * aligned();
    for patient_from_voxel in [aligned(), ras, oblique] {
        let case = Phantom::new(patient_from_voxel, intensity);
        for view in NamedView::ALL {
            let camera = Camera::named(view).with_zoom(4.0).unwrap();
            let window = Window::between(100.0, 900.0);
            let request = request(RenderParameters {
                camera,
                window,
                ..parameters()
            });
            let frame = renderer.draw(&case, &request);
            let shows_mark = mean(frame.bytes()) > 100.0;
            assert_eq!(shows_mark, view == NamedView::Right, "{view:?}");
        }
    }
}

fn any_number_of_threads_gives_the_same_bytes(renderer: &Renderer) {
    let case = Phantom::new(aligned(), |position| (position.length() * 40.0) as u16);
    let camera = cameras().pop().unwrap();
    let request = request(RenderParameters {
        depth_mm: 4.0,
        camera,
        window: Window::between(0.0, 2000.0),
        look: Look {
            slab_mm: 1.5,
            colormap: ColorMap::Viridis,
            ..Look::default()
        },
        ..parameters()
    });
    let draw = |threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| renderer.draw(&case, &request))
    };
    let one = draw(1);
    assert!(mean(one.bytes()) > 10.0);
    for threads in [2, 3, 7] {
        assert!(draw(threads) == one, "{threads} threads");
    }
}

fn a_pixel_shows_the_native_intensity_at_its_hit(renderer: &Renderer) {
    let case = Phantom::new(aligned(), |position| {
        (3.0 * position.x - 2.0 * position.y + position.z + 200.0) as u16
    });
    let window = Window::between(0.0, 510.0);
    let request = request(RenderParameters {
        depth_mm: 6.0,
        window,
        ..parameters()
    });
    let frame = renderer.draw(&case, &request);
    let hits = renderer.hits(&case, &request);
    for index in 0..96 * 96 {
        let [x, y] = [index % 96, index / 96];
        let is_soft = is_beside_black(&frame, x as usize, y as usize);
        if let Some(at) = hits.position_in_patient(x, y).filter(|_| !is_soft) {
            let expected = (3.0 * at.x - 2.0 * at.y + at.z + 199.5) / 2.0;
            let found = f64::from(frame.pixel(x, y).unwrap()[0]);
            assert!((found - expected).abs() < 1.6, "{found} for {expected}");
        }
    }
}

fn a_head_light_is_brightest_where_the_surface_faces_the_viewer(renderer: &Renderer) {
    let case = bright();
    let request = request(RenderParameters {
        depth_mm: 5.0,
        look: Look {
            ambient: 0.2,
            ..clear()
        },
        ..parameters()
    });
    let frame = renderer.draw(&case, &request);
    assert!(frame.pixel(48, 48).unwrap()[0] >= 198);
    let (pixels, _) = frame.bytes().as_chunks::<2>();
    // The less is covered, the coarser is a colour that was mixed with nothing.
    let covered = pixels.iter().filter(|[_, alpha]| *alpha >= 128);
    let least = covered.map(|[grey, _]| *grey).min().unwrap();
    assert!((38..100).contains(&least), "{least} at the edge");
}

fn outside_of_the_volume_nothing_is_shown(renderer: &Renderer) {
    // The volume ends 10 mm to the right of the middle.
    let whole = Grid::new([80, 90, 70], aligned()).unwrap();
    let half = whole.block([0, 0, 0], [30, 90, 70]).unwrap();
    let case = Phantom::of_volume(phantom::volume(half, |_| 200));
    let camera = Camera::named(NamedView::Posterior);
    let request = request(RenderParameters {
        camera,
        look: Look {
            slab_mm: 2.0,
            ..clear()
        },
        ..parameters()
    });
    let frame = renderer.draw(&case, &request);
    assert_eq!(frame.format(), PixelFormat::GreyAlpha8);
    assert_eq!(
        frame.pixel(30, 48),
        Some(&[0, 0][..]),
        "the left, from behind"
    );
    assert_eq!(frame.pixel(70, 48), Some(&[200, 255][..]), "the right");
}

/// What is nearer to the cut than to any border of the whole ellipsoid is bare; what is not shows what the whole one
/// shows.
fn beside_a_cut_nothing_is_shown(renderer: &Renderer) {
    let cut = Cut {
        face: Face::Inferior,
        inward: DVec3::Z,
        offset_mm: CENTRE.z - 10.0,
    };
    let whole = bright();
    let part = Phantom::cut_by(cut);
    // Another envelope has another mesh.
    let renderer = &Renderer::new(renderer.backend.clone());
    let whole_depth_mm = |position: DVec3| {
        let grid = whole.distance.grid();
        let voxel = grid.voxel_from_patient().transform_point3(position).round();
        let index = grid.index(voxel.to_array().map(|place| place as usize));
        whole.distance.depth_mm(index).map_or(0.0, f64::from)
    };
    for depth_mm in [0.0, 6.0, 10.0] {
        for (view, least) in [
            (NamedView::Left, 200),
            (NamedView::Superior, 200),
            (NamedView::Inferior, 0),
        ] {
            let request = request(RenderParameters {
                depth_mm,
                camera: Camera::named(view),
                look: clear(),
                ..parameters()
            });
            let hits = renderer.hits(&part, &request);
            let frame = renderer.draw(&part, &request);
            let mut count = 0;
            for index in 0..96 * 96 {
                let Some(position) = hits.position_in_patient(index % 96, index / 96) else {
                    continue;
                };
                count += 1;
                let from_cut_mm = cut.distance_mm(position);
                assert!(
                    from_cut_mm >= depth_mm,
                    "{view:?} at {depth_mm} mm: {from_cut_mm} mm from the cut"
                );
                let off_mm = (whole_depth_mm(position) - depth_mm).abs();
                assert!(
                    off_mm < 2.5 * VOXEL_MM,
                    "{view:?} at {depth_mm} mm: {off_mm} mm off"
                );
            }
            assert!(count >= least, "{view:?} at {depth_mm} mm: {count}");
            // From below the cut covers the middle, and is bare.
            let is_bare = frame.pixel(48, 48).unwrap()[1] == 0;
            let is_below = view == NamedView::Inferior;
            assert_eq!(is_bare, is_below, "{view:?} at {depth_mm} mm");
        }
    }
}

/// A fence in the upper half of the patient's right side: what is nearer to it than to other border is bare, the rest is as without.
fn beside_a_fence_nothing_is_shown(renderer: &Renderer) {
    let whole = bright();
    let envelope = envelope_where(|_| true);
    let grid = envelope.grid().clone();
    let inside = envelope.mask().voxels();
    let is_fence = |&index: &u32| {
        let index = index as usize;
        let voxel = DVec3::from_array(grid.voxel(index).map(|along| along as f64));
        let place = grid.patient_from_voxel().transform_point3(voxel);
        let mut around = geometry::face_neighbours(grid.size(), index);
        let is_border = inside[index] && around.any(|(_, beyond)| !inside[beyond]);
        is_border && place.x < CENTRE.x - 5.0 && place.z > CENTRE.z
    };
    let fence: Vec<u32> = (0..inside.len() as u32).filter(is_fence).collect();
    let native = Grid::new([80, 90, 70], aligned()).unwrap();
    let volume = phantom::volume(native, |_| 200);
    let part = Phantom::of(volume, envelope.with_fence(fence));
    let fenced = part.case.model.field().fenced().expect("a fence");
    for depth_mm in [2.0, 8.0] {
        let request = request(RenderParameters {
            depth_mm,
            camera: Camera::named(NamedView::Right),
            look: clear(),
            ..parameters()
        });
        let hits = renderer.hits(&whole, &request);
        let (of_whole, of_part) = (
            renderer.draw(&whole, &request),
            renderer.draw(&part, &request),
        );
        let (mut shown, mut bare, mut wrong) = (0, 0, 0);
        for index in 0..96 * 96 {
            let (column, row) = (index % 96, index / 96);
            let Some(position) = hits.position_in_patient(column, row) else {
                continue;
            };
            let voxel = grid.voxel_from_patient().transform_point3(position);
            let is_bare = of_part.pixel(column, row).unwrap()[1] == 0;
            bare += u32::from(is_bare);
            shown += u32::from(of_part.pixel(column, row) == of_whole.pixel(column, row));
            wrong += u32::from(is_bare != fenced.covers(voxel.as_vec3().to_array()));
        }
        assert!(bare > 300 && shown > 600, "{depth_mm} mm: {bare} {shown}");
        // Where half of the depths around are unknown, rounding decides.
        assert!(wrong <= 40, "{depth_mm} mm: {wrong}");
    }
}

fn colours_are_those_of_the_map(renderer: &Renderer) {
    let case = bright();
    for (colormap, background, format) in [
        (ColorMap::Inverted, Background::Black, PixelFormat::Grey8),
        (ColorMap::Hot, Background::Black, PixelFormat::Rgb8),
        (ColorMap::Bone, Background::Transparent, PixelFormat::Rgba8),
    ] {
        let request = request(RenderParameters {
            look: Look {
                colormap,
                background,
                ..lit()
            },
            ..parameters()
        });
        let frame = renderer.draw(&case, &request);
        let color = colormap.table()[200];
        let bytes = format.bytes_per_pixel();
        let expected = [color[0], color[1], color[2], 255];
        assert_eq!(frame.format(), format);
        assert_eq!(frame.pixel(48, 48).unwrap(), &expected[..bytes]);
        assert!(frame.pixel(0, 0).unwrap().iter().all(|&byte| byte == 0));
    }
}

fn deeper_than_the_deepest_there_is_nothing(renderer: &Renderer) {
    let case = bright();
    let depth_mm = f64::from(case.distance.max_depth_mm()) + 1.0;
    let request = request(RenderParameters {
        depth_mm,
        ..parameters()
    });
    let frame = renderer.draw(&case, &request);
    assert!(frame.bytes().iter().all(|&byte| byte == 0));
}

fn a_slab_averages_over_depth_but_not_beyond_the_envelope(renderer: &Renderer) {
    // Bright outside of the ellipsoid: 0 inside.
    let case = Phantom::new(aligned(), |position| {
        if ((position - CENTRE) / (HALF_AXES + 3.0)).length() > 1.0 {
            60_000
        } else {
            100
        }
    });
    let request = request(RenderParameters {
        look: Look {
            slab_mm: 5.0,
            ..lit()
        },
        ..parameters()
    });
    let frame = renderer.draw(&case, &request);
    assert_eq!(frame.pixel(48, 48), Some(&[100][..]));
}

fn one_pixel_and_extreme_zooms_are_drawn(renderer: &Renderer) {
    let case = bright();
    for (side, zoom) in [(1, 1.0), (1, 0.01), (2, 100.0), (96, 100.0), (96, 0.01)] {
        let camera = Camera::named(NamedView::Left).with_zoom(zoom).unwrap();
        let size = FrameSize::new(side, side).unwrap();
        let request = request(RenderParameters {
            camera,
            size,
            look: clear(),
            ..parameters()
        });
        let frame = renderer.draw(&case, &request);
        let pixel = frame.pixel(side / 2, side / 2).unwrap();
        // The colour of a pixel that is covered in part was rounded twice.
        let is_bright = pixel[0].abs_diff(200) <= 1 && pixel[1] > 0;
        assert!(zoom < 1.0 || is_bright, "{side} {zoom}: {pixel:?}");
    }
}
