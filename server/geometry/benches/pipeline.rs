//! The steps from a mask to a mesh at a depth, one thread each.
//!
//! The head is Colin27 at 256³, the case of the paper (2.5 million voxels inside), if the folder `ISOCORTEX_TEST_DATA`
//! contains `colin27/ch2bet.nii.gz`; otherwise an ellipsoid of the same size.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use geometry::{
    BrainMask, DepthField, Grid, Mask, MeshSize, Paths, ShellIndex, core, distance_map, envelope,
    envelope_mesh, forest, path_table, phantom,
};
use glam::DVec3;

/// Colin27's 181 × 217 × 181 mm in 256³ voxels fill 15 % of them with brain, as in the paper.
const SPACING_MM: f64 = 0.896;

fn head() -> (Mask, Grid) {
    let folder =
        std::env::var_os("ISOCORTEX_TEST_DATA").unwrap_or_else(|| "../../../shared/data".into());
    let path = std::path::Path::new(&folder).join("colin27/ch2bet.nii.gz");
    let Ok(bytes) = std::fs::read(path) else {
        eprintln!("Colin27 is not in ISOCORTEX_TEST_DATA; an ellipsoid is used instead");
        let brain = phantom::ellipsoid([75.0, 95.0, 80.0], SPACING_MM);
        return (brain.mask().clone(), brain.mask().grid().clone());
    };
    let mask =
        imaging::nifti::read_mask(&bytes, &imaging::Limits::default()).expect("a sound file");
    let native = mask
        .grid()
        .reordered_to_patient_axes()
        .expect("axes along the patient's");
    let size = native
        .size()
        .map(|side| (side as f64 / SPACING_MM) as usize);
    let origin = native.patient_from_voxel().transform_point3(DVec3::ZERO);
    (
        mask,
        Grid::aligned(size, [SPACING_MM; 3], origin).expect("a small grid"),
    )
}

fn pipeline(criterion: &mut Criterion) {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .use_current_thread();
    pool.build_global().expect("the first pool of this program");
    let (mask, volume_grid) = head();
    let mut group = criterion.benchmark_group("pipeline");
    group.sample_size(10);
    group.bench_function("mask", |b| {
        b.iter(|| BrainMask::from_mask(&mask, &volume_grid));
    });
    let brain = BrainMask::from_mask(&mask, &volume_grid).expect("a brain");
    group.bench_function("closing by 10 mm", |b| b.iter(|| envelope(&brain, 10.0)));
    let envelope = envelope(&brain, 10.0).expect("an envelope");
    group.bench_function("distance map", |b| b.iter(|| distance_map(&envelope)));
    let distance = distance_map(&envelope);
    group.bench_function("core", |b| b.iter(|| core(&distance)));
    let core = core(&distance);
    group.bench_function("forest", |b| b.iter(|| forest(&distance, &core)));
    let forest = forest(&distance, &core);
    group.bench_function("depth field", |b| b.iter(|| DepthField::new(&distance)));
    let field = DepthField::new(&distance);
    group.bench_function("smoothed depth field", |b| b.iter(|| field.smoothed(1.5)));
    group.bench_function("shell index", |b| b.iter(|| ShellIndex::new(&distance)));
    for (contours, points) in [(30, 30), (80, 50)] {
        let size = MeshSize::new(contours, points).expect("a size within range");
        let name = |step: &str| format!("{step}, {} vertices", size.vertex_count());
        group.bench_function(name("envelope mesh"), |b| {
            b.iter(|| envelope_mesh(&field, size));
        });
        let mesh = envelope_mesh(&field, size).expect("a mesh");
        for (kind, paths) in [("forest", Paths::Forest(&forest)), ("flow", Paths::Flow)] {
            group.bench_function(name(&format!("table of paths, {kind}")), |b| {
                b.iter(|| path_table(&mesh, &distance, &field, paths));
            });
        }
        let table = path_table(&mesh, &distance, &field, Paths::Forest(&forest));
        let mut depth = 0.0;
        group.bench_function(name("a new depth"), |b| {
            b.iter(|| {
                depth = (depth + 0.37) % 40.0;
                black_box(table.shrink(depth))
            });
        });
    }
    group.finish();
}

criterion_group!(benches, pipeline);
criterion_main!(benches);
