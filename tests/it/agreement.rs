//! How far the renderers' pictures of a real head are apart.

use std::path::Path;
use std::sync::Arc;

use render::agreement::{
    Agreement, DepthLine, MESH_SIZES, markdown_table, mesh_against_exact, svg_plot,
};
use render::gpu::{GpuCase, GpuJob, GpuPool, GpuSurface};
use render::{Frame, NamedView, RenderRequest, draw_splat, draw_trace};

use crate::scenes::{Head, device};

const DEPTHS_MM: [f64; 5] = [0.0, 5.0, 10.0, 20.0, 30.0];

/// The requests of a depth, from six sides, and their exact pictures.
fn exact(head: &Head, depth_mm: f64, side: u32) -> Vec<(RenderRequest, Frame)> {
    let requests = NamedView::ALL.map(|view| head.request(view, depth_mm, side));
    requests
        .map(|request| (request, draw_trace(&head.scene(), &request)))
        .to_vec()
}

fn traced_on(pool: &GpuPool, case: &Arc<dyn GpuCase>, request: &RenderRequest) -> Frame {
    let job = GpuJob {
        case: Arc::clone(case),
        request: *request,
        surface: GpuSurface::Trace,
    };
    pool.draw(job).expect("a picture").frame
}

#[test]
fn the_device_traces_colin27_as_the_processor_does() {
    let (Some(head), Some(pool)) = (Head::colin27(), device()) else {
        return;
    };
    let case = Arc::clone(&head) as Arc<dyn GpuCase>;
    for depth_mm in DEPTHS_MM {
        for (request, exact) in exact(&head, depth_mm, 512) {
            let agreement = Agreement::of(&traced_on(&pool, &case, &request), &exact);
            let within = agreement.share_within(2);
            let what = format!("{depth_mm} mm, {:?}", request.parameters().camera);
            assert!(within >= 0.995, "{what}: {within} within 2 levels");
            assert_eq!(agreement.beyond_edge(), 0, "{what}");
        }
    }
}

#[test]
fn splats_of_colin27_agree_with_the_exact_pictures() {
    let Some(head) = Head::colin27() else { return };
    for depth_mm in DEPTHS_MM {
        for (request, exact) in exact(&head, depth_mm, 512) {
            let agreement = Agreement::of(&draw_splat(&head.scene(), &request), &exact);
            let mean = agreement.mean_difference();
            assert!(mean <= 3.0, "{depth_mm} mm: {mean} levels apart");
        }
    }
}

#[test]
fn a_fine_mesh_of_colin27_agrees_with_the_exact_pictures() {
    let (Some(head), Some(pool)) = (Head::colin27(), device()) else {
        return;
    };
    let case = Arc::clone(&head) as Arc<dyn GpuCase>;
    let table = head.table([200, 200]);
    for depth_mm in DEPTHS_MM {
        let exact = exact(&head, depth_mm, 512);
        let all = mesh_against_exact(&pool, &case, &table, &exact).expect("pictures");
        let mean = all.mean_difference();
        assert!(mean <= 3.0, "{depth_mm} mm: {mean} levels apart");
        for exact in &exact {
            let one = std::slice::from_ref(exact);
            let one = mesh_against_exact(&pool, &case, &table, one).expect("a picture");
            // Deep down its facets cut the corners of the isosurface's edges.
            let mean = one.mean_difference();
            assert!(mean <= 4.0, "{depth_mm} mm: {mean} levels apart");
        }
    }
}

/// Writes `docs/agreement.svg` and prints the table of `docs/renderers.md`.
#[test]
#[ignore = "it makes a figure of the documentation"]
fn ten_meshes_of_colin27_against_the_exact_pictures() {
    let (Some(head), Some(pool)) = (Head::colin27(), device()) else {
        return;
    };
    let case = Arc::clone(&head) as Arc<dyn GpuCase>;
    let tables = MESH_SIZES.map(|size| head.table(size));
    let lines = DEPTHS_MM.map(|depth_mm| {
        let exact = exact(&head, depth_mm, 512);
        let meshes = tables.iter().map(|table| {
            let agreement = mesh_against_exact(&pool, &case, table, &exact).expect("pictures");
            (table.size.triangle_count(), agreement)
        });
        let meshes = meshes.collect();
        DepthLine { depth_mm, meshes }
    });
    println!("{}", markdown_table(&lines));
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs");
    std::fs::create_dir_all(&docs).expect("a folder");
    std::fs::write(docs.join("agreement.svg"), svg_plot(&lines)).expect("a written plot");
}
