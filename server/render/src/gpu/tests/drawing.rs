//! Pictures of the device, compared with results known on paper and with the software renderer.

use geometry::PathTable;
use glam::DVec3;

use super::super::renderer::GpuLimits;
use super::super::worker::GpuWorker;
use super::super::{GpuError, GpuJob, GpuSurface};
use super::support::{Case, LIMITS, parameters, trace, worker};
use crate::conformance::is_beside_black;
use crate::{
    Background, Camera, ColorMap, Facets, Frame, FrameSize, Hemisphere, Look, MapDisc, MapSides,
    NamedView, PixelFormat, RenderParameters, RenderRequest, Window, draw_mesh, draw_splat,
    draw_trace, trace_hits,
};

fn frame(worker: &mut GpuWorker, job: &GpuJob) -> Frame {
    worker.attempt(|renderer| renderer.draw(job)).unwrap().frame
}

fn splat(job: &GpuJob) -> Frame {
    draw_splat(&job.case.scene(), &job.request, &|| true).unwrap()
}

/// The same picture of the mesh.
fn mesh(job: &GpuJob, table: &PathTable) -> GpuJob {
    GpuJob {
        surface: GpuSurface::Mesh {
            size: table.size,
            mesh: table.shrink(job.request.parameters().depth_mm as f32),
        },
        ..job.clone()
    }
}

/// The mean difference of two grey pictures over the pixels that both cover.
fn mean_difference(a: &Frame, b: &Frame) -> f64 {
    let both = inner_pixels(a, b).filter(|(a, b)| *a > 0 && *b > 0);
    let differences: Vec<f64> = both.map(|(a, b)| f64::from(a.abs_diff(b))).collect();
    differences.iter().sum::<f64>() / differences.len() as f64
}

/// The levels of two grey pictures but at the edges of the second.
fn inner_pixels(a: &Frame, b: &Frame) -> impl Iterator<Item = (u8, u8)> {
    let width = b.size().width() as usize;
    let pixels = a.bytes().iter().zip(b.bytes()).enumerate();
    pixels
        .filter(move |(index, _)| !is_beside_black(b, index % width, index / width))
        .map(|(_, (a, b))| (*a, *b))
}

/// The fraction of a picture that differs from another by more than 2 levels.
fn share_apart(a: &Frame, b: &Frame) -> f64 {
    assert_eq!((a.format(), a.size()), (b.format(), b.size()));
    let apart = a
        .bytes()
        .iter()
        .zip(b.bytes())
        .filter(|(a, b)| a.abs_diff(**b) > 2);
    apart.count() as f64 / a.bytes().len() as f64
}

#[test]
fn a_ball_is_seen_from_six_sides() {
    let Some(mut worker) = worker(LIMITS) else {
        return;
    };
    let case = Case::ball(1);
    let table = case.table(60, 60);
    let nearest = [
        (NamedView::Left, 1.5),
        (NamedView::Right, -1.5),
        (NamedView::Posterior, 0.75),
        (NamedView::Anterior, -0.75),
        (NamedView::Superior, 0.4),
        (NamedView::Inferior, -0.4),
    ];
    for (view, per_mm) in nearest {
        for depth_mm in [0.0, 6.0, 14.0] {
            let job = trace(&case, parameters(view, depth_mm));
            for (name, job) in [("trace", job.clone()), ("mesh", mesh(&job, &table))] {
                let picture = frame(&mut worker, &job);
                let radius_mm = 30.0 - depth_mm;
                let found = f64::from(picture.pixel(64, 64).unwrap()[0]);
                let expected = 110.0 + per_mm * radius_mm;
                let what = format!("{name} {view:?} {depth_mm}");
                assert!(
                    (found - expected).abs() < 4.0,
                    "{what}: {found} for {expected}"
                );
                // The picture's side is the diameter of the bounding sphere, 61 mm.
                let lit = picture.bytes().iter().filter(|byte| **byte > 0).count() as f64;
                // Depth 0 passes through the centres of the border voxels, up to a voxel inside the ball.
                let radius_px = (radius_mm - 0.5) * 128.0 / 61.0;
                let disc = std::f64::consts::PI * radius_px * radius_px;
                assert!(
                    (lit / disc - 1.0).abs() < 0.06,
                    "{what}: {lit} pixels for {disc}"
                );
            }
        }
    }
}

#[test]
fn left_is_left() {
    let Some(mut worker) = worker(LIMITS) else {
        return;
    };
    let case = Case::ball(2);
    let table = case.table(40, 40);
    // Facing the patient, the left is at the right; it is the brighter side. Superior is up, and brighter, too.
    for (view, is_left_at_right) in [
        (NamedView::Anterior, true),
        (NamedView::Posterior, false),
        (NamedView::Superior, false),
        (NamedView::Inferior, true),
    ] {
        let job = trace(&case, parameters(view, 5.0));
        for job in [job.clone(), mesh(&job, &table)] {
            let picture = frame(&mut worker, &job);
            let [left, right] = [40, 87].map(|x| picture.pixel(x, 64).unwrap()[0]);
            assert_eq!(right > left, is_left_at_right, "{view:?}: {left} {right}");
        }
    }
    let picture = frame(&mut worker, &trace(&case, parameters(NamedView::Left, 5.0)));
    assert!(picture.pixel(64, 40).unwrap()[0] > picture.pixel(64, 87).unwrap()[0]);
}

/// Two balls side by side, and a wavy surface, which are hard for a ray.
fn lumpy(key: u128) -> Case {
    let is_inside = |position: DVec3| {
        let waves = ((position.y / 4.0).sin() + (position.z / 5.0).cos()) * 1.5;
        let [left, right] = [-13.0, 15.0].map(|x| position.distance(DVec3::X * x));
        left < 19.0 + waves || right < 17.0 + waves
    };
    let intensity = |position: DVec3| {
        (130.0 + 50.0 * (position.element_sum() / 6.0).sin() + 40.0 * (position.z / 4.0).cos())
            as u16
    };
    Case::new(key, 81, is_inside, intensity)
}

#[test]
fn the_traced_isosurface_is_at_its_depth() {
    let Some(mut worker) = worker(LIMITS) else {
        return;
    };
    let case = lumpy(3);
    let voxel_from_patient = case.model().field().grid().voxel_from_patient();
    let mut covered = 0;
    for view in NamedView::ALL {
        for depth_mm in [0.0, 2.5, 5.0, 7.0, 12.0] {
            let job = trace(&case, parameters(view, depth_mm));
            let hits = worker.attempt(|renderer| renderer.hits(&job)).unwrap();
            let towards_viewer = hits.projection().unwrap().towards_viewer_in_patient();
            for (x, y) in (0..128).flat_map(|y| (0..128).map(move |x| (x, y))) {
                let Some(position) = hits.position_in_patient(x, y) else {
                    continue;
                };
                let position = voxel_from_patient.transform_point3(position).as_vec3();
                // Down to 3 voxels the smoothed field is drawn, from 5 voxels the field itself.
                let field = if depth_mm < 3.0 {
                    case.model().normals()
                } else {
                    case.model().field()
                };
                let outward = -field.gradient(position).as_dvec3();
                if outward.normalize_or_zero().dot(towards_viewer) > 0.1 {
                    let off = (f64::from(field.depth_mm(position)) - depth_mm).abs();
                    assert!(off <= 0.02, "{view:?} {depth_mm} {x} {y}: {off} mm off");
                    covered += 1;
                }
            }
        }
    }
    assert!(covered > 40_000, "{covered} pixels");
}

/// The picture of the isosurface by small steps and plain formulas: slow; the traced one is compared with it.
fn by_small_steps(case: &Case, parameters: &RenderParameters) -> Frame {
    let scene = case.scene();
    let projection = parameters.camera.projection(&scene.bounds, parameters.size);
    let patient_from_frame = projection.patient_from_frame();
    let voxel_from_patient = case.model().field().grid().voxel_from_patient();
    let towards_viewer = projection.towards_viewer_in_patient();
    let colors = parameters.look.colormap.table();
    let mut bytes = Vec::new();
    for (x, y) in (0..128).flat_map(|y| (0..128).map(move |x| (x, y))) {
        let at = |height: f64| {
            let frame = DVec3::new(f64::from(x) + 0.5, f64::from(y) + 0.5, height);
            voxel_from_patient.transform_point3(patient_from_frame.transform_point3(frame))
        };
        let field = if parameters.depth_mm < 3.0 {
            scene.normals
        } else {
            scene.field
        };
        let is_below =
            |height| f64::from(field.depth_mm(at(height).as_vec3())) >= parameters.depth_mm;
        let mut heights = (-1200..1200).rev().map(|step| f64::from(step) * 0.05);
        let Some(mut low) = heights.find(|&height| is_below(height)) else {
            bytes.push(0);
            continue;
        };
        let mut high = low + 0.05;
        for _ in 0..20 {
            let middle = 0.5 * (low + high);
            *(if is_below(middle) {
                &mut low
            } else {
                &mut high
            }) = middle;
        }
        let position = at(low).as_vec3();
        let inward = scene.normals.gradient(position).normalize_or_zero();
        let facing = -inward.as_dvec3().dot(towards_viewer);
        let stored = scene.volume.sample(position).unwrap();
        let brightness = 255.0 * parameters.window.apply(f64::from(stored));
        let [color, ..] = colors[(brightness + 0.5) as usize];
        bytes.push((f32::from(color) * parameters.look.light_on(facing as f32) + 0.5) as u8);
    }
    Frame::new(parameters.size, PixelFormat::Grey8, bytes)
}

#[test]
fn the_traced_picture_is_that_of_small_steps() {
    let Some(mut worker) = worker(LIMITS) else {
        return;
    };
    // A plate of 4 mm, seen from the side, must not be stepped over.
    let flat = |position: DVec3| (position / DVec3::new(22.0, 46.0, 40.0)).length() <= 1.0;
    let flat = Case::new(16, 97, flat, |position| (130.0 + position.y) as u16);
    for (case, view, depth_mm) in [
        (lumpy(15), NamedView::Left, 0.0),
        (lumpy(15), NamedView::Anterior, 5.0),
        (lumpy(15), NamedView::Superior, 11.0),
        (flat.clone(), NamedView::Anterior, 19.5),
        (flat.clone(), NamedView::Inferior, 17.0),
        (flat, NamedView::Left, 19.5),
    ] {
        let parameters = parameters(view, depth_mm);
        let traced = frame(&mut worker, &trace(&case, parameters));
        let steps = by_small_steps(&case, &parameters);
        let apart = inner_pixels(&traced, &steps).filter(|(a, b)| a.abs_diff(*b) > 2);
        let apart = apart.count() as f64 / steps.bytes().len() as f64;
        assert!(apart <= 0.005, "{view:?} {depth_mm}: {apart}");
    }
}

#[test]
fn the_traced_picture_is_that_of_the_software() {
    let Some(mut worker) = worker(LIMITS) else {
        return;
    };
    let case = lumpy(17);
    for view in NamedView::ALL {
        for depth_mm in [0.0, 4.0, 8.0, 12.0] {
            let job = trace(&case, parameters(view, depth_mm));
            let software = draw_trace(&case.scene(), &job.request, &|| true).unwrap();
            let apart = share_apart(&frame(&mut worker, &job), &software);
            assert!(apart <= 0.007, "{view:?} {depth_mm}: {apart}");
        }
    }
}

#[test]
fn the_mesh_is_that_of_the_processor() {
    let Some(mut worker) = worker(LIMITS) else {
        return;
    };
    let case = lumpy(23);
    for (contours, points) in [(12, 10), (40, 40), (90, 80)] {
        let table = case.table(contours, points);
        for (view, depth_mm, slab_mm) in [
            (NamedView::Anterior, 0.0, 0.0),
            (NamedView::Left, 4.0, 1.5),
            (NamedView::Superior, 11.0, 0.0),
        ] {
            let parameters = RenderParameters {
                look: Look {
                    slab_mm,
                    ..Background::Transparent.into()
                },
                ..parameters(view, depth_mm)
            };
            let shrunk = table.shrink(depth_mm as f32);
            let job = mesh(&trace(&case, parameters), &table);
            let found = frame(&mut worker, &job);
            let facets = Facets::new(table.size, &shrunk);
            let expected = draw_mesh(&case.scene(), &job.request, facets, &|| true).unwrap();
            let apart = share_apart(&found, &expected);
            assert!(
                apart < 0.01,
                "{contours} × {points} {view:?} {depth_mm} mm: {apart}"
            );
        }
    }
}

#[test]
fn mesh_trace_and_splat_agree() {
    let Some(mut worker) = worker(LIMITS) else {
        return;
    };
    let case = lumpy(4);
    let table = case.table(120, 200);
    for view in NamedView::ALL {
        for depth_mm in [5.0, 9.0] {
            let job = trace(&case, parameters(view, depth_mm));
            let (splat, traced) = (splat(&job), frame(&mut worker, &job));
            let what = format!("{view:?} {depth_mm}");
            let apart = share_apart(&splat, &traced);
            assert!(apart < 0.03, "{what}: {apart} of trace and splat apart");
            let facets = frame(&mut worker, &mesh(&job, &table));
            let difference = mean_difference(&facets, &traced);
            assert!(
                difference <= 3.0,
                "{what}: mesh and trace {difference} apart"
            );
        }
    }
}

#[test]
fn every_window_color_light_background_and_slab_is_that_of_the_splat() {
    let Some(mut worker) = worker(LIMITS) else {
        return;
    };
    let case = lumpy(5);
    let usual = Look::default();
    let plain = RenderParameters {
        camera: Camera::new([0.3, -0.5, 0.1, 0.8], 1.3, [4.0, -7.0]).unwrap(),
        size: FrameSize::new(150, 101).unwrap(),
        ..parameters(NamedView::Left, 6.0)
    };
    let mut variants = vec![
        RenderParameters {
            window: Window::new(140.0, 61.0).unwrap(),
            ..plain
        },
        RenderParameters {
            window: Window::sigmoid(140.0, 61.0).unwrap(),
            ..plain
        },
        RenderParameters {
            depth_mm: 4.2,
            look: Look {
                slab_mm: 5.0,
                ..usual
            },
            ..plain
        },
    ];
    let mut looks = vec![
        Look {
            ambient: 1.0,
            ..usual
        },
        Look {
            slab_mm: 2.5,
            ..usual
        },
    ];
    // The colours of labels change by leaps, so that intensities which differ by a rounding look unlike.
    let smooth = |colormap: &ColorMap| *colormap != ColorMap::Labels;
    for colormap in ColorMap::ALL.into_iter().filter(smooth) {
        for background in [Background::Black, Background::Transparent] {
            looks.push(Look {
                colormap,
                background,
                ..usual
            });
        }
    }
    let looks = looks.into_iter();
    variants.extend(looks.map(|look| RenderParameters { look, ..plain }));
    for parameters in variants {
        let job = trace(&case, parameters);
        let apart = share_apart(&splat(&job), &frame(&mut worker, &job));
        assert!(apart < 0.03, "{parameters:?}: {apart}");
    }
}

#[test]
fn a_transparent_mesh_has_soft_edges_in_the_colors_of_the_opaque() {
    let Some(mut worker) = worker(LIMITS) else {
        return;
    };
    let case = Case::ball(6);
    let table = case.table(40, 40);
    let opaque = mesh(&trace(&case, parameters(NamedView::Left, 3.0)), &table);
    let clear = RenderParameters {
        look: Background::Transparent.into(),
        ..*opaque.request.parameters()
    };
    let clear = GpuJob {
        request: RenderRequest::new(clear).unwrap(),
        ..opaque.clone()
    };
    let (opaque, clear) = (frame(&mut worker, &opaque), frame(&mut worker, &clear));
    assert_eq!(
        (opaque.format(), clear.format()),
        (PixelFormat::Grey8, PixelFormat::GreyAlpha8)
    );
    let mut soft = 0;
    for (on_black, pixel) in opaque.bytes().iter().zip(clear.bytes().chunks_exact(2)) {
        let blended = f64::from(pixel[0]) * f64::from(pixel[1]) / 255.0;
        assert!(
            (blended - f64::from(*on_black)).abs() <= 1.0,
            "{pixel:?} {on_black}"
        );
        soft += usize::from(!matches!(pixel[1], 0 | 255));
    }
    assert!(soft > 50, "{soft} pixels are covered in part");
}

#[test]
fn the_mesh_tells_where_its_facets_are() {
    let Some(mut worker) = worker(LIMITS) else {
        return;
    };
    let case = Case::ball(7);
    let table = case.table(80, 80);
    let job = mesh(&trace(&case, parameters(NamedView::Superior, 4.0)), &table);
    let hits = worker.attempt(|renderer| renderer.hits(&job)).unwrap();
    let pixels = (0..128).flat_map(|y| (0..128).map(move |x| (x, y)));
    let positions = pixels.filter_map(|(x, y)| hits.position_in_patient(x, y));
    let voxel_from_patient = case.model().field().grid().voxel_from_patient();
    let depths = positions.map(|position| {
        let position = voxel_from_patient.transform_point3(position);
        f64::from(case.model().field().depth_mm(position.as_vec3()))
    });
    let off: Vec<f64> = depths.map(|depth_mm| (depth_mm - 4.0).abs()).collect();
    assert!(off.len() > 8_000, "{}", off.len());
    let mean = off.iter().sum::<f64>() / off.len() as f64;
    assert!(mean < 0.3, "{mean} mm off on average");
    assert_eq!(hits.position_in_patient(0, 0), None);
}

#[test]
fn beyond_the_deepest_point_there_is_nothing() {
    let Some(mut worker) = worker(LIMITS) else {
        return;
    };
    let case = Case::ball(8);
    let picture = frame(
        &mut worker,
        &trace(&case, parameters(NamedView::Left, 200.0)),
    );
    assert!(picture.bytes().iter().all(|byte| *byte == 0));
}

#[test]
fn a_volume_that_is_too_large_is_drawn_from_fewer_voxels_and_the_answer_says_so() {
    let Some(mut whole) = worker(LIMITS) else {
        return;
    };
    let case = Case::ball(9);
    let job = trace(&case, parameters(NamedView::Left, 6.0));
    let drawn = whole.attempt(|renderer| renderer.draw(&job)).unwrap();
    assert_eq!(drawn.reduction, None);
    let fields = 8 * 71_u64.pow(3);
    let some = GpuLimits {
        case_bytes: fields + 200_000,
        ..LIMITS
    };
    let mut small = worker(some).unwrap();
    let reduced = small.attempt(|renderer| renderer.draw(&job)).unwrap();
    assert_eq!(reduced.reduction, Some([1, 2, 2]));
    // Brightness rises linearly, so that means can be compared.
    let apart = share_apart(&drawn.frame, &reduced.frame);
    assert!(apart < 0.01, "{apart}");
    let mut tiny = worker(GpuLimits {
        case_bytes: fields - 1,
        ..LIMITS
    })
    .unwrap();
    let refused = tiny.attempt(|renderer| renderer.draw(&job));
    assert_eq!(
        refused,
        Err(GpuError::CaseTooLarge {
            needed: fields,
            limit: fields - 1
        })
    );
    let mut short = worker(GpuLimits {
        max_side_3d: Some(64),
        ..LIMITS
    })
    .unwrap();
    let refused = short.attempt(|renderer| renderer.draw(&job));
    assert!(
        matches!(refused, Err(GpuError::CaseTooLarge { .. })),
        "{refused:?}"
    );
}

#[test]
fn cases_come_and_go_within_their_bytes() {
    let bytes = 10 * 71_u64.pow(3);
    let two_cases = GpuLimits {
        case_bytes: 2 * bytes,
        ..LIMITS
    };
    let Some(mut worker) = worker(two_cases) else {
        return;
    };
    let cases = [10, 11, 12].map(Case::ball);
    let first = frame(
        &mut worker,
        &trace(&cases[0], parameters(NamedView::Left, 6.0)),
    );
    for case in cases.iter().chain(&cases) {
        let again = frame(&mut worker, &trace(case, parameters(NamedView::Left, 6.0)));
        assert_eq!(first, again);
    }
}

#[test]
fn the_same_request_gives_the_same_bytes() {
    let Some(mut worker) = worker(LIMITS) else {
        return;
    };
    let case = lumpy(13);
    let table = case.table(40, 40);
    let job = trace(&case, parameters(NamedView::Anterior, 3.0));
    for job in [job.clone(), mesh(&job, &table)] {
        let first = frame(&mut worker, &job);
        for _ in 0..5 {
            assert_eq!(frame(&mut worker, &job), first);
        }
    }
}

#[test]
fn a_mesh_of_other_vertices_is_refused() {
    let Some(mut worker) = worker(LIMITS) else {
        return;
    };
    let case = Case::ball(14);
    let table = case.table(20, 20);
    let mut job = mesh(&trace(&case, parameters(NamedView::Left, 3.0)), &table);
    if let GpuSurface::Mesh { mesh, .. } = &mut job.surface {
        mesh.positions_in_patient.pop();
    }
    let refused = worker.attempt(|renderer| renderer.draw(&job));
    assert_eq!(
        refused,
        Err(GpuError::Mesh {
            found: 401,
            expected: 402
        })
    );
    assert_eq!(job.case.key, case.keyed.key);
}

#[test]
fn a_map_is_that_of_the_cpu_and_so_are_its_positions() {
    let Some(mut worker) = worker(LIMITS) else {
        return;
    };
    let case = lumpy(29);
    let centre = |hemisphere: Hemisphere| {
        let is_part = |position: DVec3| hemisphere.has(position.x);
        case.model().shell().centroid(is_part)
    };
    let discs = MapDisc::of_map(&Hemisphere::ALL, MapSides::Both, DVec3::X, centre).unwrap();
    for disc in discs {
        for depth_mm in [0.0, 5.0] {
            let job = trace(
                &case,
                RenderParameters {
                    map: Some(disc),
                    ..parameters(NamedView::Left, depth_mm)
                },
            );
            let exact = draw_trace(&case.scene(), &job.request, &|| true).unwrap();
            let apart = share_apart(&exact, &frame(&mut worker, &job));
            assert!(apart < 0.03, "{disc:?} {depth_mm}: {apart}");
            let hits = worker.attempt(|renderer| renderer.hits(&job)).unwrap();
            let expected = trace_hits(&case.scene(), &job.request);
            let places = (0..128).flat_map(|y| (0..128).map(move |x| (x, y)));
            let both =
                places.map(|(x, y)| [&hits, &expected].map(|hits| hits.position_in_patient(x, y)));
            let mut far = 0;
            let mut found = 0;
            for [here, there] in both {
                let off = match (here, there) {
                    (None, None) => continue,
                    (Some(here), Some(there)) => here.distance(there),
                    _ => f64::INFINITY,
                };
                found += 1;
                far += usize::from(off > 0.05);
            }
            // At folds and at the edge of the disc.
            assert!(found > 2000 && far < found / 100, "{far} of {found}");
        }
    }
}
