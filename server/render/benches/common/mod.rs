//! A case as large as an adult head at 0.9 mm: 2.5 million voxels inside of the envelope.

use geometry::{BuiltModel, Grid, phantom};
use glam::DVec3;

/// An ellipsoid of 140 × 176 × 144 mm with shallow waves, filled with stripes of grey.
pub(crate) fn head_sized() -> BuiltModel {
    let spacing_mm = 0.896;
    let size = [180, 222, 186];
    let corner = DVec3::from(size.map(|side| (side - 1) as f64)) * spacing_mm / -2.0;
    let grid = Grid::aligned(size, [spacing_mm; 3], corner).expect("a grid");
    let is_inside = |at: DVec3| {
        let waves = 0.03 * ((at.x / 9.0).sin() + (at.y / 11.0).sin() + (at.z / 8.0).sin());
        (at / DVec3::new(70.0, 88.0, 72.0)).length() < 1.0 + waves
    };
    let envelope = phantom::envelope(&grid, is_inside);
    let stripes = |at: DVec3| (100.0 + 60.0 * (at.element_sum() / 3.0).sin()) as u16;
    phantom::model(phantom::volume(grid, stripes), envelope)
}
