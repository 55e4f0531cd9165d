//! A frame of 512 × 512 pixels, lit, on one thread; and a slice with contours.

mod common;

use common::head_sized;
use criterion::{Criterion, criterion_group, criterion_main};
use render::{
    RenderParameters, RenderRequest, Scene, SliceParameters, SlicePlane, SliceRequest, Window,
    draw_slice, draw_splat, draw_trace,
};

fn splat(criterion: &mut Criterion) {
    let head = head_sized();
    let scene = Scene::from(&head.model);
    let window = Window::between(40.0, 160.0);
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .expect("a thread");
    for depth_mm in [0.5, 15.0, 40.0] {
        let parameters = RenderParameters {
            depth_mm,
            ..RenderParameters::new(window)
        };
        let request = RenderRequest::new(parameters).expect("a request");
        criterion.bench_function(&format!("splat 512x512 at {depth_mm} mm"), |bencher| {
            pool.install(|| bencher.iter(|| draw_splat(&scene, &request)));
        });
        criterion.bench_function(&format!("trace 512x512 at {depth_mm} mm"), |bencher| {
            pool.install(|| bencher.iter(|| draw_trace(&scene, &request)));
        });
    }
    let middle_mm = SlicePlane::Axial.middle_mm(&scene.bounds);
    let parameters = SliceParameters {
        depths_mm: vec![5.0, 10.0, 20.0],
        ..SliceParameters::new(SlicePlane::Axial, middle_mm, window)
    };
    let request = SliceRequest::new(parameters).expect("a request");
    criterion.bench_function("slice 512x512 with three contours", |bencher| {
        pool.install(|| bencher.iter(|| draw_slice(&scene, &request)));
    });
}

criterion_group!(benches, splat);
criterion_main!(benches);
