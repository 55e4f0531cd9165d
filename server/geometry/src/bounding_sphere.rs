//! The sphere around an envelope.

use glam::DVec3;

use crate::grid::bounds_through;
use crate::{Grid, ShellIndex, ShellVoxel};

/// The sphere around an envelope, which a camera at zoom 1 fits into the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoundingSphere {
    /// Centre of the box around the envelope, LPS mm.
    pub centre_in_patient: DVec3,
    /// Distance of the farthest point of the envelope from the centre, in mm.
    pub radius_mm: f64,
}

impl BoundingSphere {
    /// The sphere around the envelope of a shell index.
    ///
    /// Its centre is the centre of the box around the centres of the border voxels; its radius extends half a voxel
    /// beyond the farthest one. An empty index gives a sphere of half a voxel at the origin of the grid.
    pub fn of_envelope(shell: &ShellIndex) -> Self {
        let patient_from_voxel = shell.grid().patient_from_voxel();
        let spacing_mm = shell.grid().spacing_mm()[0];
        // Depths are distances between voxel centres: none lies between 0 and 1 voxel.
        let border = shell.shell(0.0, (0.5 * spacing_mm) as f32);
        let centre_of = |voxel: &ShellVoxel| DVec3::from(voxel.position().map(f64::from));
        let first = border.first().map(centre_of).unwrap_or_default();
        let (low, high) = border
            .iter()
            .map(centre_of)
            .fold((first, first), |(low, high), voxel| {
                (low.min(voxel), high.max(voxel))
            });
        let centre_in_patient = patient_from_voxel.transform_point3((low + high) / 2.0);
        let farthest_squared = border
            .iter()
            .map(centre_of)
            .map(|voxel| {
                (patient_from_voxel.transform_point3(voxel) - centre_in_patient).length_squared()
            })
            .fold(0.0, f64::max);
        Self {
            centre_in_patient,
            radius_mm: farthest_squared.sqrt() + 0.5 * spacing_mm,
        }
    }

    /// The sphere in the middle of a grid, as wide as the longest side of the box around it along the patient axes.
    ///
    /// Its corners lie outside, but each slice along the patient axes fits into a square of its width.
    pub fn of_grid(grid: &Grid) -> Self {
        let last = DVec3::from_array(grid.size().map(|side| side as f64 - 0.5));
        let [low, high] = bounds_through(grid.patient_from_voxel(), [DVec3::splat(-0.5), last]);
        Self {
            centre_in_patient: (low + high) / 2.0,
            radius_mm: (high - low).max_element() / 2.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{distance_map, envelope, phantom};

    #[test]
    fn the_sphere_of_an_ellipsoid_has_its_centre_and_its_longest_half_axis() {
        let brain = phantom::ellipsoid([20.0, 12.0, 9.0], 1.5);
        let distance = distance_map(&envelope(&brain, 0.0).unwrap());
        let sphere = BoundingSphere::of_envelope(&ShellIndex::new(&distance));
        assert!(sphere.centre_in_patient.length() < 1e-9, "{sphere:?}");
        assert!((sphere.radius_mm - 20.5 * 1.5).abs() < 1e-9, "{sphere:?}");
    }

    #[test]
    fn the_sphere_of_a_grid_is_as_wide_as_its_longest_side() {
        let grid = Grid::aligned([10, 30, 20], [2.0, 1.0, 1.0], DVec3::new(4.0, 5.0, 6.0)).unwrap();
        let sphere = BoundingSphere::of_grid(&grid);
        assert_eq!(sphere.centre_in_patient, DVec3::new(13.0, 19.5, 15.5));
        assert_eq!(sphere.radius_mm, 15.0);
    }
}
