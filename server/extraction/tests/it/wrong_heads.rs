//! Volumes that are no T1-weighted heads, or none as they say, and what they are made with.

use geometry::{Grid, Volume, phantom};
use glam::{DAffine3, DMat3, DVec3};

/// What is not a T1-weighted head, or not as its axes say, and must not end as ok.
pub(crate) fn wrong_heads() -> Vec<(&'static str, Volume)> {
    let head = phantom::head(2.0).volume;
    let brightest = f64::from(*head.voxels().iter().max().expect("voxels"));
    let inverted = |stored: u16| brightest - f64::from(stored);
    let swapped = DMat3::from_cols(DVec3::Y, DVec3::X, DVec3::Z);
    vec![
        ("zeros", with_values(&head, |_, _| 0.0)),
        (
            "noise",
            with_values(&head, |_, voxel| 500.0 + 400.0 * noise(voxel)),
        ),
        ("inverted", with_values(&head, |stored, _| inverted(stored))),
        (
            "inverted but for the air",
            with_values(&head, |stored, _| match stored {
                0 => 0.0,
                stored => inverted(stored),
            }),
        ),
        ("left taken for the front", with_axes(&head, swapped)),
        ("a melon", melon()),
    ]
}

/// A volume with other stored values: a function of the value and the voxel.
pub(crate) fn with_values(volume: &Volume, value: impl Fn(u16, [usize; 3]) -> f64) -> Volume {
    let grid = volume.grid();
    let voxels = volume.voxels().iter().enumerate();
    let voxels = voxels.map(|(index, &stored)| {
        value(stored, grid.voxel(index)).round().clamp(0.0, 65535.0) as u16
    });
    Volume::new(grid.clone(), voxels.collect(), volume.rescale()).expect("the same grid")
}

/// A volume whose patient is turned, mirrored or pitched about its middle: the voxels stay, the affine changes.
pub(crate) fn with_axes(volume: &Volume, turn: DMat3) -> Volume {
    let grid = volume.grid();
    let affine = grid.patient_from_voxel();
    let middle = DVec3::from_array(grid.size().map(|side| (side - 1) as f64 / 2.0));
    let middle = affine.transform_point3(middle);
    let about = DAffine3 {
        matrix3: turn,
        translation: middle - turn * middle,
    };
    let grid = Grid::new(grid.size(), about * affine).expect("a grid");
    Volume::new(grid, volume.voxels().to_vec(), volume.rescale()).expect("the same voxels")
}

/// A number from -1 to 1 for a voxel; the same one at each call.
pub(crate) fn noise([x, y, z]: [usize; 3]) -> f64 {
    let mut state = (x as u64) << 42 ^ (y as u64) << 21 ^ z as u64;
    // One step of SplitMix64.
    state = state
        .wrapping_mul(0x9e37_79b9_7f4a_7c15)
        .wrapping_add(0x9e37_79b9_7f4a_7c15);
    state = (state ^ state >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    state = (state ^ state >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((state ^ state >> 31) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

/// A melon: a rind, flesh that is brighter towards the middle, and seeds around a hollow; as large as a head.
pub(crate) fn melon() -> Volume {
    let grid = Grid::aligned([96; 3], [2.0; 3], DVec3::splat(-95.0)).expect("a grid");
    let value = |index: usize| {
        let voxel = grid.voxel(index);
        let place = DVec3::from_array(voxel.map(|along| along as f64 * 2.0 - 95.0));
        let radius = (place / DVec3::new(1.0, 1.15, 1.0)).length();
        let flesh = match radius {
            r if r > 72.0 => 0.0,
            r if r > 66.0 => 300.0,
            r if r > 28.0 => 900.0 - 4.0 * r,
            r if r > 20.0 => 500.0,
            _ => 150.0,
        };
        (flesh + 15.0 * noise(voxel)).max(0.0) as u16
    };
    let voxels = (0..grid.voxel_count()).map(value).collect();
    let rescale = geometry::Rescale {
        slope: 1.0,
        intercept: 0.0,
    };
    Volume::new(grid, voxels, rescale).expect("one value for each voxel")
}
