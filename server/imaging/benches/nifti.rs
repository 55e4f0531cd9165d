//! Decoding a packed head of 256³ 16-bit voxels, beside unpacking the same bytes and nothing else.

use std::hint::black_box;
use std::io::Read;

use criterion::{Criterion, criterion_group, criterion_main};
use flate2::bufread::MultiGzDecoder;
use geometry::{Grid, Rescale, Volume};
use glam::DVec3;
use imaging::{Limits, nifti};

const SIDE: usize = 256;

/// Something as hard to unpack as a head: a ball with folds, and noise in it and around it.
fn stored_values() -> Vec<u16> {
    let mut state = 1u32;
    let mut noise = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        state >> 27
    };
    let voxel = |index: usize| [index % SIDE, index / SIDE % SIDE, index / (SIDE * SIDE)];
    let centre = SIDE as f64 / 2.0;
    (0..SIDE.pow(3))
        .map(|index| {
            let [x, y, z] = voxel(index).map(|position| position as f64 - centre);
            let inside = x * x + y * y + z * z < (0.4 * SIDE as f64).powi(2);
            let folds = (x / 5.0).sin() * (y / 7.0).cos() * (z / 6.0).sin();
            let tissue = if inside { 400.0 + 150.0 * folds } else { 0.0 };
            let amplitude = if inside { 1 } else { 4 };
            32768 + tissue as u16 + (noise() / amplitude) as u16
        })
        .collect()
}

/// The values as a packed file of signed 16-bit voxels.
fn packed_file() -> Vec<u8> {
    let grid = Grid::aligned([SIDE; 3], [1.0; 3], DVec3::ZERO).expect("a sound grid");
    let rescale = Rescale {
        slope: 1.0,
        intercept: 0.0,
    };
    let signed = stored_values().iter().map(|value| value ^ 0x8000).collect();
    let volume = Volume::new(grid, signed, rescale).expect("one value for each voxel");
    let mut file = unpack(&nifti::write_volume(&volume).expect("a writable volume"));
    file[70..72].copy_from_slice(&4i16.to_le_bytes());
    pack(&file)
}

fn unpack(packed: &[u8]) -> Vec<u8> {
    let mut file = Vec::new();
    MultiGzDecoder::new(packed)
        .read_to_end(&mut file)
        .expect("sound gzip");
    file
}

fn pack(file: &[u8]) -> Vec<u8> {
    let mut packed = Vec::new();
    flate2::bufread::GzEncoder::new(file, flate2::Compression::default())
        .read_to_end(&mut packed)
        .expect("reading from memory");
    packed
}

fn decoding(criterion: &mut Criterion) {
    let packed = packed_file();
    let plain = unpack(&packed);
    let limits = Limits::default();
    let mut group = criterion.benchmark_group("256³ int16");
    group.sample_size(10);
    group.bench_function("inflate alone", |bencher| {
        bencher.iter(|| black_box(unpack(black_box(&packed))));
    });
    group.bench_function("read_volume .nii.gz", |bencher| {
        bencher.iter(|| black_box(nifti::read_volume(black_box(&packed), &limits)));
    });
    group.bench_function("read_volume .nii", |bencher| {
        bencher.iter(|| black_box(nifti::read_volume(black_box(&plain), &limits)));
    });
    group.bench_function("read_mask .nii.gz", |bencher| {
        bencher.iter(|| black_box(nifti::read_mask(black_box(&packed), &limits)));
    });
    group.finish();
}

criterion_group!(benches, decoding);
criterion_main!(benches);
