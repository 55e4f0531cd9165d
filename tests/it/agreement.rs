//! How far the renderers' pictures of a real head are apart.

use std::path::{Path, PathBuf};

use render::agreement::{
    Agreement, DepthLine, MESH_SIZES, markdown_table, mesh_against_exact, svg_plot,
};
use render::{
    Background, Frame, FrameSize, Hits, NamedView, PixelFormat, RenderBackend, RenderParameters,
    RenderRequest, SheetPlan, encode_png,
};

use crate::scenes::{Head, device};

const DEPTHS_MM: [f64; 5] = [0.0, 5.0, 10.0, 20.0, 30.0];

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
        let all = mesh_against_exact(&head.scene(), &table, &exact);
        let mean = all.mean_difference();
        assert!(mean <= 3.0, "{depth_mm} mm: {mean} levels apart");
        for exact in &exact {
            let one = std::slice::from_ref(exact);
            let one = mesh_against_exact(&head.scene(), &table, one);
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

/// Writes `docs/renderers.png`: all five back ends side by side.
#[test]
#[ignore = "it makes a picture of the documentation"]
fn five_back_ends_side_by_side() {
    let (Some(head), Some(pool)) = (Head::colin27(), device()) else {
        return;
    };
    let table = head.table([200, 200]);
    let depths_mm = [0.0, 8.0];
    let columns = ["splat", "mesh", "trace", "mesh, device", "trace, device"].map(str::to_owned);
    let rows = depths_mm.map(|depth_mm| format!("{depth_mm} mm"));
    let cell = FrameSize::new(224, 224).expect("a size within range");
    let plan = SheetPlan::new(cell, rows.to_vec(), columns.to_vec()).expect("a sheet");
    let mut sheet = plan.begin(PixelFormat::Grey8);
    for (row, depth_mm) in depths_mm.into_iter().enumerate() {
        let request = head.request(NamedView::Left, depth_mm, cell.width());
        let request = RenderParameters {
            background: Background::Black,
            ..*request.parameters()
        };
        let request = RenderRequest::new(request).expect("a checked request");
        let backends = [
            RenderBackend::Splat,
            RenderBackend::Mesh,
            RenderBackend::Trace,
            RenderBackend::GpuMesh(pool.clone()),
            RenderBackend::GpuTrace(pool.clone()),
        ];
        let frames = backends.map(|backend| head.draw_mesh(&backend, &table, &request));
        for (column, frame) in frames.iter().enumerate() {
            sheet.put(frame, row, column);
        }
    }
    let png = encode_png(&sheet.finish(), &[]).expect("a PNG");
    std::fs::write(docs().join("renderers.png"), png).expect("a written picture");
}

fn docs() -> PathBuf {
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs");
    std::fs::create_dir_all(&docs).expect("a folder");
    docs
}

/// Writes `docs/agreement.svg` and prints the table of `docs/renderers.md`.
#[test]
#[ignore = "it makes a figure of the documentation"]
fn ten_meshes_of_colin27_against_the_exact_pictures() {
    let Some(head) = Head::colin27() else { return };
    let tables = MESH_SIZES.map(|size| head.table(size));
    let lines = DEPTHS_MM.map(|depth_mm| {
        let exact = exact(&head, depth_mm, 512);
        let meshes = tables.iter().map(|table| {
            let agreement = mesh_against_exact(&head.scene(), table, &exact);
            (table.size.triangle_count(), agreement)
        });
        let meshes = meshes.collect();
        DepthLine { depth_mm, meshes }
    });
    println!("{}", markdown_table(&lines));
    std::fs::write(docs().join("agreement.svg"), svg_plot(&lines)).expect("a written plot");
}
