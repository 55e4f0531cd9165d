//! Pictures of 512 × 512 pixels by the graphics device, there and back, and its start.
//!
//! Run with one of `LP_NUM_THREADS=1` to see what software Vulkan takes on one thread.

mod common;

use std::sync::Arc;

use common::head_sized;
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use geometry::{MeshSize, Paths};
use render::gpu::{CaseKey, GpuOptions, GpuPool, KeyedModel};
use render::{
    KeyedLayers, RenderBackend, RenderJob, RenderParameters, RenderRequest, SizedMesh, Window,
};

fn pictures(criterion: &mut Criterion) {
    let pool = match GpuPool::start(GpuOptions::default()) {
        Ok(pool) => pool,
        Err(error) => {
            eprintln!("SKIPPED: the graphics device: {error}");
            return;
        }
    };
    eprintln!("{:?}", pool.adapter());
    let pool = Arc::new(pool);
    let head = head_sized();
    let case = KeyedModel {
        key: CaseKey(1),
        model: Arc::new(head.model.clone()),
    };
    let job = |depth_mm: f64, mesh| RenderJob {
        case: case.clone(),
        request: RenderRequest::new(RenderParameters {
            depth_mm,
            ..RenderParameters::new(Window::between(40.0, 160.0))
        })
        .expect("a request"),
        mesh,
        layers: KeyedLayers::default(),
    };
    let mut group = criterion.benchmark_group("gpu");
    group.sample_size(20);
    let mesh_backend = RenderBackend::GpuMesh(Arc::clone(&pool));
    for (contours, points) in [(30, 30), (80, 50), (100, 100)] {
        let size = MeshSize::new(contours, points).expect("a size");
        let table = head.model.path_table(size, &head.distance, Paths::Flow);
        let mesh = table.expect("a mesh").shrink(15.0);
        let id = BenchmarkId::new("mesh at 15 mm", size.triangle_count());
        let job = job(15.0, Some(SizedMesh { size, mesh }));
        group.bench_with_input(id, &job, |bencher, job| {
            bencher.iter(|| mesh_backend.draw(job));
        });
    }
    let trace_backend = RenderBackend::GpuTrace(pool);
    for depth_mm in [0.5, 15.0, 40.0] {
        let job = job(depth_mm, None);
        group.bench_function(BenchmarkId::new("trace at mm", depth_mm), |bencher| {
            bencher.iter(|| trace_backend.draw(&job));
        });
    }
    group.sample_size(10);
    group.bench_function("start", |bencher| {
        bencher.iter(|| GpuPool::start(GpuOptions::default()));
    });
}

criterion_group!(benches, pictures);
criterion_main!(benches);
