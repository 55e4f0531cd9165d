//! How far the renderers' pictures of a real head are apart.

use glam::{DMat3, DQuat, DVec3};
use render::conformance::Agreement;
use render::{Camera, Frame, Hits, NamedView, RenderBackend, RenderRequest};

use crate::scenes::{Head, device};

const DEPTHS_MM: [f64; 5] = [0.0, 5.0, 10.0, 20.0, 30.0];

/// The greatest mean differences from the exact pictures of a depth, in levels: of all pictures together, and of the worst one.
const SPLAT: [f64; 2] = [1.0, 1.2];
const ALONG_GRADIENT: [f64; 2] = [3.2, 5.0];
/// Deep down the paths of the forest gather where the brain's envelope is hollow, and the facets between them tear.
const ALONG_FOREST: [f64; 2] = [6.5, 10.5];

/// The requests of a depth, from six sides, and their exact pictures.
fn exact(head: &Head, depth_mm: f64, side: u32) -> Vec<(RenderRequest, Frame)> {
    let requests = NamedView::ALL.map(|view| head.request(view, depth_mm, side));
    requests
        .map(|request| (request, head.draw(&RenderBackend::Trace, &request)))
        .to_vec()
}

#[test]
fn the_device_traces_colin27_as_the_processor_does() {
    let (Some(head), Some(pool)) = (Head::colin27(), device()) else {
        return;
    };
    let device = RenderBackend::GpuTrace(pool);
    for depth_mm in DEPTHS_MM {
        for (request, exact) in exact(&head, depth_mm, 512) {
            let traced = head.draw(&device, &request);
            let agreement = Agreement::of(&traced, &exact);
            let within = agreement.share_within(2);
            let what = format!("{depth_mm} mm, {:?}", request.parameters().camera);
            assert!(within >= 0.995, "{what}: {within} within 2 levels");
            assert_eq!(agreement.beyond_edge(), 0, "{what}");
        }
    }
}

/// How far each point that a picture shows is from its depth, in mm, where the surface does not graze the line of sight.
fn off_depth(head: &Head, hits: &Hits, depth_mm: f64) -> Vec<f64> {
    let field = head.model().field();
    let size = hits.projection().unwrap().size();
    let towards_viewer = hits.projection().unwrap().towards_viewer_in_patient();
    let pixels = (0..size.height()).flat_map(|y| (0..size.width()).map(move |x| [x, y]));
    let off = |[x, y]: [u32; 2]| {
        let position = hits.position_in_patient(x, y)?;
        let place = field.grid().voxel_from_patient().transform_point3(position);
        let outward = -field
            .gradient(place.as_vec3())
            .as_dvec3()
            .normalize_or_zero();
        let off = (f64::from(field.depth_mm(place.as_vec3())) - depth_mm).abs();
        (outward.dot(towards_viewer) > 0.1).then_some(off)
    };
    pixels.filter_map(off).collect()
}

#[test]
fn points_of_colin27_are_at_their_depth() {
    let Some(head) = Head::colin27() else { return };
    let mut backends = vec![
        ("splat", 1.0, RenderBackend::Splat),
        ("trace", 0.02, RenderBackend::Trace),
    ];
    if let Some(pool) = device() {
        backends.push(("trace on the device", 0.02, RenderBackend::GpuTrace(pool)));
    }
    for depth_mm in [5.0, 10.0, 20.0, 30.0] {
        for view in NamedView::ALL {
            let request = head.request(view, depth_mm, 512);
            for (name, allowed, backend) in &backends {
                let hits = head.hits(backend, &request);
                let off = off_depth(&head, &hits, depth_mm);
                assert!(off.len() > 10_000, "{name}: {} pixels", off.len());
                let most = off.into_iter().fold(0.0, f64::max);
                assert!(
                    most <= *allowed,
                    "{name}, {view:?}, {depth_mm} mm: {most} mm off"
                );
            }
        }
    }
}

/// The six sides and the eight corners between them.
fn cameras() -> Vec<Camera> {
    let mut cameras = NamedView::ALL.map(Camera::named).to_vec();
    for towards_viewer in [
        [1.0, 1.0, 1.0],
        [1.0, 1.0, -1.0],
        [1.0, -1.0, 1.0],
        [1.0, -1.0, -1.0],
        [-1.0, 1.0, 1.0],
        [-1.0, 1.0, -1.0],
        [-1.0, -1.0, 1.0],
        [-1.0, -1.0, -1.0],
    ] {
        let towards_viewer = DVec3::from_array(towards_viewer).normalize();
        let right = DVec3::Z.cross(towards_viewer).normalize();
        let axes = DMat3::from_cols(right, towards_viewer.cross(right), towards_viewer);
        let orientation = DQuat::from_mat3(&axes.transpose());
        cameras.push(Camera::new(orientation.to_array(), 1.0, [0.0; 2]).expect("a rotation"));
    }
    cameras
}

/// The agreement of a backend's pictures of a depth with the exact ones: of all together, and the mean difference of the worst.
fn against_exact(
    exact: &[(RenderRequest, Frame)],
    draw: impl Fn(&RenderRequest) -> Frame,
) -> (Agreement, f64) {
    let mut sum = Agreement::default();
    let mut worst = 0.0_f64;
    for (request, exact) in exact {
        let one = Agreement::of(&draw(request), exact);
        worst = worst.max(one.mean_difference());
        sum += &one;
    }
    (sum, worst)
}

#[test]
fn splats_and_fine_meshes_of_four_heads_agree_with_the_exact_pictures() {
    for name in Head::names() {
        let head = Head::named(name);
        let [flow, forest] = [head.table([200, 200]), head.forest_table([200, 200])];
        for depth_mm in [10.0, 30.0] {
            let exact: Vec<(RenderRequest, Frame)> = cameras()
                .into_iter()
                .map(|camera| head.seen_by(camera, depth_mm, 256))
                .map(|request| (request, head.draw(&RenderBackend::Trace, &request)))
                .collect();
            let mesh = |table| {
                against_exact(&exact, |request| {
                    head.draw_mesh(&RenderBackend::Mesh, table, request)
                })
            };
            let splat = against_exact(&exact, |request| head.draw(&RenderBackend::Splat, request));
            for (drawn, limit, (all, worst)) in [
                ("splat", SPLAT, splat),
                ("mesh along the gradient", ALONG_GRADIENT, mesh(&flow)),
                ("mesh along the forest", ALONG_FOREST, mesh(&forest)),
            ] {
                let mean = all.mean_difference();
                println!("{name} | {depth_mm} mm | {drawn} | {mean:.1} | {worst:.1}");
                let what = format!("{name}, {depth_mm} mm, {drawn}: {mean:.2}, worst {worst:.2}");
                assert!(mean <= limit[0] && worst <= limit[1], "{what} levels apart");
            }
        }
    }
}

#[test]
fn the_device_draws_the_mesh_of_colin27_as_the_processor_does() {
    let (Some(head), Some(pool)) = (Head::colin27(), device()) else {
        return;
    };
    let table = head.table([200, 200]);
    let device = RenderBackend::GpuMesh(pool);
    for depth_mm in DEPTHS_MM {
        for view in NamedView::ALL {
            let request = head.request(view, depth_mm, 512);
            let [on_device, on_cpu] = [&device, &RenderBackend::Mesh]
                .map(|backend| head.draw_mesh(backend, &table, &request));
            let agreement = Agreement::of(&on_device, &on_cpu);
            let within = agreement.share_within(2);
            let what = format!("{depth_mm} mm, {view:?}");
            assert!(within >= 0.99, "{what}: {within} within 2 levels");
            assert_eq!(agreement.beyond_edge(), 0, "{what}");
        }
    }
}
