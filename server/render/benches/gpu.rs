//! Pictures of 512 × 512 pixels by the graphics device, there and back, and its start.
//!
//! Run with one of `LP_NUM_THREADS=1` to see what software Vulkan takes on one thread.

mod common;

use std::sync::Arc;

use common::Case;
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use geometry::{MeshSize, Paths, envelope_mesh, path_table};
use render::gpu::{CaseKey, GpuCase, GpuJob, GpuOptions, GpuPool, GpuSurface};
use render::{RenderParameters, RenderRequest, Scene, Window};

struct Head(Case);

impl GpuCase for Head {
    fn key(&self) -> CaseKey {
        CaseKey(1)
    }

    fn scene(&self) -> Scene<'_> {
        self.0.scene()
    }
}

fn pictures(criterion: &mut Criterion) {
    let pool = match GpuPool::start(GpuOptions::default()) {
        Ok(pool) => pool,
        Err(error) => {
            eprintln!("SKIPPED: the graphics device: {error}");
            return;
        }
    };
    eprintln!("{:?}", pool.adapter());
    let head = Arc::new(Head(Case::head_sized()));
    let job = |depth_mm: f64, surface| GpuJob {
        case: Arc::clone(&head) as Arc<dyn GpuCase>,
        request: RenderRequest::new(RenderParameters {
            depth_mm,
            ..RenderParameters::new(Window::between(40.0, 160.0))
        })
        .expect("a request"),
        surface,
    };
    let mut group = criterion.benchmark_group("gpu");
    group.sample_size(20);
    for (contours, points) in [(30, 30), (80, 50), (100, 100)] {
        let size = MeshSize::new(contours, points).expect("a size");
        let distance = head.0.distance();
        let mesh = envelope_mesh(head.scene().field, size).expect("a mesh");
        let table = path_table(&mesh, distance, head.scene().field, Paths::Flow);
        let mesh = table.shrink(15.0);
        let id = BenchmarkId::new("mesh at 15 mm", size.triangle_count());
        group.bench_with_input(id, &mesh, |bencher, mesh| {
            bencher.iter(|| {
                let mesh = mesh.clone();
                pool.draw(job(15.0, GpuSurface::Mesh { size, mesh }))
            });
        });
    }
    for depth_mm in [0.5, 15.0, 40.0] {
        group.bench_function(BenchmarkId::new("trace at mm", depth_mm), |bencher| {
            bencher.iter(|| pool.draw(job(depth_mm, GpuSurface::Trace)));
        });
    }
    group.sample_size(10);
    group.bench_function("start", |bencher| {
        bencher.iter(|| GpuPool::start(GpuOptions::default()));
    });
}

criterion_group!(benches, pictures);
criterion_main!(benches);
