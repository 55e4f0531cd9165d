//! PNG of a grey frame of 512 × 512 pixels.

mod common;

use common::head_sized;
use criterion::{Criterion, criterion_group, criterion_main};
use render::{RenderParameters, RenderRequest, Scene, Window, draw_splat, encode_png};

fn png(criterion: &mut Criterion) {
    let head = head_sized();
    let scene = Scene::from(&head.model);
    let parameters = RenderParameters::new(Window::between(40.0, 160.0));
    let frame = draw_splat(&scene, &RenderRequest::new(parameters).expect("a request"));
    criterion.bench_function("png of a grey frame 512x512", |bencher| {
        bencher.iter(|| encode_png(&frame, &[("renderer", "splat".to_owned())]));
    });
}

criterion_group!(benches, png);
criterion_main!(benches);
