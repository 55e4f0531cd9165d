//! How far the renderers' pictures of a real head are apart.

use bench::agreement::Agreement;
use geometry::PathTable;
use render::{Frame, Hits, NamedView, RenderBackend, RenderRequest};

use crate::scenes::{Head, device};

const DEPTHS_MM: [f64; 5] = [0.0, 5.0, 10.0, 20.0, 30.0];

/// The requests of a depth, from six sides, and their exact pictures.
fn exact(head: &Head, depth_mm: f64, side: u32) -> Vec<(RenderRequest, Frame)> {
    let requests = NamedView::ALL.map(|view| head.request(view, depth_mm, side));
    requests
        .map(|request| (request, head.draw(&RenderBackend::Trace, &request)))
        .to_vec()
}

/// The mesh of a table, drawn on the CPU, against exact pictures; the pixels of all pictures count alike.
fn mesh_against_exact(
    head: &Head,
    table: &PathTable,
    exact: &[(RenderRequest, Frame)],
) -> Agreement {
    let mut sum = Agreement::default();
    for (request, exact) in exact {
        let found = head.draw_mesh(&RenderBackend::Mesh, table, request);
        sum += &Agreement::of(&found, exact);
    }
    sum
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
    let size = hits.projection().size();
    let towards_viewer = hits.projection().towards_viewer_in_patient();
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

#[test]
fn splats_of_colin27_agree_with_the_exact_pictures() {
    let Some(head) = Head::colin27() else { return };
    for depth_mm in DEPTHS_MM {
        for (request, exact) in exact(&head, depth_mm, 512) {
            let agreement = Agreement::of(&head.draw(&RenderBackend::Splat, &request), &exact);
            let mean = agreement.mean_difference();
            assert!(mean <= 3.0, "{depth_mm} mm: {mean} levels apart");
        }
    }
}

#[test]
fn a_fine_mesh_of_colin27_agrees_with_the_exact_pictures() {
    let Some(head) = Head::colin27() else { return };
    let table = head.table([200, 200]);
    for depth_mm in DEPTHS_MM {
        let exact = exact(&head, depth_mm, 512);
        let all = mesh_against_exact(&head, &table, &exact);
        let mean = all.mean_difference();
        assert!(mean <= 3.0, "{depth_mm} mm: {mean} levels apart");
        for exact in &exact {
            let one = std::slice::from_ref(exact);
            let one = mesh_against_exact(&head, &table, one);
            // Deep down its facets cut the corners of the isosurface's edges.
            let mean = one.mean_difference();
            assert!(mean <= 4.0, "{depth_mm} mm: {mean} levels apart");
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
