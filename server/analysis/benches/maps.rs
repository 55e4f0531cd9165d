//! The plane between the hemispheres and the maps, on a made-up head of 1 mm, one thread.

use analysis::{Head, MapParameters, maps, midsagittal_plane};
use criterion::{Criterion, criterion_group, criterion_main};
use geometry::{BrainMask, DepthField, distance_map, envelope, phantom};

fn analysis(criterion: &mut Criterion) {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .use_current_thread();
    pool.build_global().expect("the first pool of this program");
    let head = phantom::head(1.0);
    let volume = &head.volume;
    let brain = BrainMask::from_mask(&head.brain, volume.grid()).expect("a brain");
    let envelope = envelope(&brain, 10.0).expect("an envelope");
    let depth = &DepthField::new(&distance_map(&envelope));
    let plane = &midsagittal_plane(&envelope, volume);
    let mut group = criterion.benchmark_group("analysis");
    group.sample_size(10);
    group.bench_function("midsagittal plane", |b| {
        b.iter(|| midsagittal_plane(&envelope, volume));
    });
    let head = Head {
        volume,
        depth,
        plane,
    };
    group.bench_function("maps", |b| b.iter(|| maps(head, &MapParameters::STANDARD)));
    group.finish();
}

criterion_group!(benches, analysis);
criterion_main!(benches);
