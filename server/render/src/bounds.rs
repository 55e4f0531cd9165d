//! What the camera looks at.

use geometry::{ShellIndex, ShellVoxel};
use glam::DVec3;

/// The sphere around an envelope that zoom 1 fits into the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoundingSphere {
    /// Centre of the box around the envelope, LPS mm.
    pub centre_in_patient: DVec3,
    /// Distance of the envelope's farthest point from the centre, in mm.
    pub radius_mm: f64,
}

impl BoundingSphere {
    /// The sphere around the envelope whose voxels `shell` holds.
    ///
    /// Its centre is that of the box around the border voxels' centres; its radius reaches half a voxel beyond the
    /// farthest of them. Of an empty index it is a voxel-sized sphere at the grid's origin.
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
}
