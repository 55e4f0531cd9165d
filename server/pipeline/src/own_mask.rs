//! Recognises skull-stripped volumes, which are their own masks.

use geometry::{Grid, Mask, Volume};

use case::Failure;

/// The greatest volume inside a skull, in ml. A whole head with its scalp has more than 2,400 even if parts are cut
/// off; the largest brains with their surroundings have less than 2,100.
const LARGEST_BRAIN_ML: f64 = 2200.0;

/// The greatest fraction of the voxels on the faces of the volume that may belong to the brain: a brain stem, not a
/// neck or a cut head.
const MOST_ON_FACES: f64 = 0.05;

/// The voxels with an intensity, if the volume is skull-stripped.
///
/// It is if the background is exactly 0 in all eight corners and in at least 95 % of the voxels on the faces, and if
/// the rest encloses at most 2,200 ml; otherwise `None`.
pub(super) fn own_mask(volume: &Volume) -> Result<Option<Mask>, Failure> {
    let half_a_step = volume.rescale().slope.abs() / 2.0;
    let is_brain = |&stored: &u16| volume.intensity(f32::from(stored)).abs() > half_a_step;
    let voxels: Vec<bool> = volume.voxels().iter().map(is_brain).collect();
    let grid = volume.grid();
    if has_background_around(grid, &voxels) && enclosed_ml(grid, &voxels) <= LARGEST_BRAIN_ML {
        let mask = Mask::new(grid.clone(), voxels).map_err(super::failure::from_geometry)?;
        return Ok(Some(mask));
    }
    Ok(None)
}

fn has_background_around(grid: &Grid, voxels: &[bool]) -> bool {
    let [nx, ny, nz] = grid.size();
    let is_end = |place: usize, side: usize| place == 0 || place + 1 == side;
    let [mut faces, mut brain] = [0usize; 2];
    for (index, row) in voxels.chunks_exact(nx).enumerate() {
        let sides = [is_end(index % ny, ny), is_end(index / ny, nz)];
        let ends = &[row[0], row[nx - 1]][..nx.min(2)];
        if sides == [true; 2] && ends.contains(&true) {
            return false;
        }
        // Within the volume only the ends of a row are on a face.
        let on_face = if sides.contains(&true) { row } else { ends };
        faces += on_face.len();
        brain += on_face.iter().filter(|&&is_brain| is_brain).count();
    }
    brain as f64 <= MOST_ON_FACES * faces as f64
}

fn enclosed_ml(grid: &Grid, voxels: &[bool]) -> f64 {
    let count = voxels.iter().filter(|&&is_brain| is_brain).count();
    let voxel_mm3 = grid.patient_from_voxel().matrix3.determinant().abs();
    count as f64 * voxel_mm3 / 1000.0
}

#[cfg(test)]
mod tests {
    use geometry::Rescale;
    use glam::DVec3;

    use super::*;

    /// A ball of the given radius in a box of 40³ voxels of `spacing_mm`, over a background.
    fn ball(radius: f64, spacing_mm: f64, background: u16, rescale: Rescale) -> Volume {
        let grid = Grid::aligned([40; 3], [spacing_mm; 3], DVec3::ZERO).unwrap();
        let distance = |index| {
            let voxel = grid.voxel(index).map(|at| at as f64 - 19.5);
            DVec3::from_array(voxel).length()
        };
        let voxels = (0..grid.voxel_count()).map(|index| {
            if distance(index) < radius {
                900
            } else {
                background
            }
        });
        let voxels = voxels.collect();
        Volume::new(grid, voxels, rescale).unwrap()
    }

    const PLAIN: Rescale = Rescale {
        slope: 1.0,
        intercept: 0.0,
    };

    #[test]
    fn a_brain_over_zeros_is_its_own_mask() {
        let mask = own_mask(&ball(14.0, 5.0, 0, PLAIN)).unwrap().unwrap();
        let brain = mask.voxels().iter().filter(|&&voxel| voxel).count();
        assert!(
            (brain as f64 / (4.0 / 3.0 * std::f64::consts::PI * 14f64.powi(3)) - 1.0).abs() < 0.02
        );
    }

    #[test]
    fn zero_is_an_intensity_not_a_stored_value() {
        let shifted = Rescale {
            slope: 0.1,
            intercept: -50.0,
        };
        assert!(own_mask(&ball(14.0, 5.0, 500, shifted)).unwrap().is_some());
        assert_eq!(own_mask(&ball(14.0, 5.0, 0, shifted)), Ok(None));
    }

    /// The same by looking at every voxel.
    fn plainly(grid: &Grid, voxels: &[bool]) -> bool {
        let [mut faces, mut brain] = [0usize; 2];
        for (index, &is_brain) in voxels.iter().enumerate() {
            let voxel = grid.voxel(index);
            let is_end = |&axis: &usize| voxel[axis] == 0 || voxel[axis] + 1 == grid.size()[axis];
            let sides = (0..3).filter(is_end).count();
            if sides == 3 && is_brain {
                return false;
            }
            faces += usize::from(sides > 0);
            brain += usize::from(sides > 0 && is_brain);
        }
        brain as f64 <= MOST_ON_FACES * faces as f64
    }

    #[test]
    fn the_background_is_judged_by_the_faces_and_the_corners() {
        let mut found = [0; 2];
        for size in [[6, 5, 4], [1, 9, 9], [7, 1, 8], [2, 2, 12], [9, 9, 9]] {
            let grid = Grid::aligned(size, [1.0; 3], DVec3::ZERO).unwrap();
            for number in 0..300usize {
                // Few to many marked voxels, at places that differ from number to number.
                let one_in = 5 + number;
                let mark = |index: usize| {
                    ((index * 7919 + number * 104_729) % 1013).is_multiple_of(one_in)
                };
                let voxels: Vec<bool> = (0..grid.voxel_count()).map(mark).collect();
                let has = has_background_around(&grid, &voxels);
                assert_eq!(has, plainly(&grid, &voxels), "{size:?} {number}");
                found[usize::from(has)] += 1;
            }
        }
        assert!(found.iter().all(|&count| count > 50), "{found:?}");
    }

    #[test]
    fn a_head_or_a_noisy_background_is_no_mask() {
        for volume in [
            ball(17.0, 5.0, 0, PLAIN),
            ball(14.0, 5.0, 3, PLAIN),
            ball(24.0, 2.0, 0, PLAIN),
        ] {
            assert_eq!(own_mask(&volume), Ok(None));
        }
    }
}
