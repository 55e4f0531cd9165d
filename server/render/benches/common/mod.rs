//! A case as large as an adult head at 0.9 mm: 2.5 million voxels inside of the envelope.

use geometry::{DepthField, DistanceMap, Envelope, Grid, Mask, Rescale, ShellIndex, Volume};
use glam::DVec3;
use render::{BoundingSphere, Scene};

/// All that a scene borrows.
pub(crate) struct Case {
    volume: Volume,
    #[allow(dead_code, reason = "not every bench needs it")]
    distance: DistanceMap,
    field: DepthField,
    normals: DepthField,
    shell: ShellIndex,
    bounds: BoundingSphere,
}

impl Case {
    /// An ellipsoid of 140 × 176 × 144 mm with shallow waves, filled with stripes of grey.
    pub(crate) fn head_sized() -> Self {
        let spacing_mm = 0.896;
        let size = [180, 222, 186];
        let centre = DVec3::from(size.map(|side| (side - 1) as f64)) * spacing_mm / 2.0;
        let grid = Grid::aligned(size, [spacing_mm; 3], DVec3::ZERO).expect("a grid");
        let position = |index: usize| {
            let voxel = DVec3::from(grid.voxel(index).map(|coordinate| coordinate as f64));
            voxel * spacing_mm - centre
        };
        let inside = |index: usize| {
            let at = position(index);
            let waves = 0.03 * ((at.x / 9.0).sin() + (at.y / 11.0).sin() + (at.z / 8.0).sin());
            (at / DVec3::new(70.0, 88.0, 72.0)).length() < 1.0 + waves
        };
        let mask: Vec<bool> = (0..grid.voxel_count()).map(inside).collect();
        let stripes =
            |index: usize| (100.0 + 60.0 * (position(index).element_sum() / 3.0).sin()) as u16;
        let voxels = (0..grid.voxel_count()).map(stripes).collect();
        let rescale = Rescale {
            slope: 1.0,
            intercept: 0.0,
        };
        let volume = Volume::new(grid.clone(), voxels, rescale).expect("a value for each voxel");
        let mask = Mask::new(grid, mask).expect("a value for each voxel");
        let envelope = Envelope::from_stored(mask).expect("an ellipsoid inside of its grid");
        let distance = geometry::distance_map(&envelope);
        let field = DepthField::new(&distance);
        let shell = ShellIndex::new(&distance);
        Self {
            volume,
            normals: field.smoothed(1.5),
            field,
            distance,
            bounds: BoundingSphere::of_envelope(&shell),
            shell,
        }
    }

    #[allow(dead_code, reason = "not every bench needs it")]
    pub(crate) fn distance(&self) -> &DistanceMap {
        &self.distance
    }

    pub(crate) fn scene(&self) -> Scene<'_> {
        Scene {
            volume: &self.volume,
            field: &self.field,
            normals: &self.normals,
            shell: &self.shell,
            bounds: self.bounds,
        }
    }
}
