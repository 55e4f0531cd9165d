//! Measurements of a mask.

use glam::DVec3;
use strum::IntoStaticStr;

use crate::runs::{Connectivity, largest_component_share};
use crate::{BrainMask, Grid, Mask};

/// A side of the patient, and the face of a volume at that side.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
pub enum Face {
    /// The left side.
    Left,
    /// The right side.
    Right,
    /// The back.
    Posterior,
    /// The front.
    Anterior,
    /// The top.
    Superior,
    /// The bottom.
    Inferior,
}

impl Face {
    /// All of them: towards +L, −L, +P, −P, +S and −S.
    pub const ALL: [Self; 6] = [
        Self::Left,
        Self::Right,
        Self::Posterior,
        Self::Anterior,
        Self::Superior,
        Self::Inferior,
    ];

    /// Its name in the interfaces: `left` …
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// The face nearest to a direction.
    pub(crate) fn towards(direction: DVec3) -> Self {
        Self::ALL[Self::number_towards(direction)]
    }

    /// The index in [`Face::ALL`] of the face nearest to a direction.
    fn number_towards(direction: DVec3) -> usize {
        let axis = direction.abs().max_position();
        2 * axis + usize::from(direction[axis] < 0.0)
    }
}

impl Mask {
    /// The fraction of the set in its largest component (26-neighbourhood), 0 to 1; 1 for an empty set.
    pub fn largest_component_share(&self) -> f64 {
        largest_component_share(self.grid().size(), self.voxels(), Connectivity::Corners)
    }
}

impl BrainMask {
    /// Extents along the patient axes L, P and S, in mm.
    pub fn extents_mm(&self) -> [f64; 3] {
        let edge = self.mask().grid().spacing_mm()[0];
        let Some([first, last]) = self.mask().bounds() else {
            return [0.0; 3];
        };
        [0, 1, 2].map(|axis| (last[axis] - first[axis] + 1) as f64 * edge)
    }

    /// The area over which the brain touches the faces of a volume, in cm², in the order of [`Face::ALL`].
    ///
    /// It is the volume of the brain within the outermost voxels, divided by their thickness. Each face of an oblique
    /// volume counts for the side of the patient to which it points most.
    pub fn cut_area_cm2(&self, volume_grid: &Grid) -> [f64; 6] {
        let voxels = self.touched_voxels(volume_grid);
        let voxel_mm3 = self.mask().grid().spacing_mm()[0].powi(3);
        let mut areas = [0.0; 6];
        for (axis, [first, last]) in voxels.into_iter().enumerate() {
            let column = volume_grid.patient_from_voxel().matrix3.col(axis);
            let area_cm2 = |count: u64| count as f64 * voxel_mm3 / column.length() / 100.0;
            areas[Face::number_towards(-column)] += area_cm2(first);
            areas[Face::number_towards(column)] += area_cm2(last);
        }
        areas
    }

    /// The number of brain voxels within the first and the last voxels of a volume along each axis. What a mask marks beyond the
    /// volume does not count.
    pub(crate) fn touched_voxels(&self, volume_grid: &Grid) -> [[u64; 2]; 3] {
        let grid = self.mask().grid();
        let volume_from_brain = volume_grid.voxel_from_patient() * grid.patient_from_voxel();
        let sides = volume_grid.size().map(|side| side as f64);
        let mut voxels = [[0u64; 2]; 3];
        let marked = self.mask().voxels().iter().enumerate();
        for (index, _) in marked.filter(|(_, belongs)| **belongs) {
            let centre = DVec3::from_array(grid.voxel(index).map(|place| place as f64));
            let place = volume_from_brain.transform_point3(centre);
            for (axis, [first, last]) in voxels.iter_mut().enumerate() {
                *first += u64::from((-0.5..0.5).contains(&place[axis]));
                let from_last = sides[axis] - 1.0 - place[axis];
                *last += u64::from((-0.5..0.5).contains(&from_last));
            }
        }
        voxels
    }
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DMat3};

    use super::*;

    /// A block of voxels in a volume of 20 × 24 × 28 voxels of 2 mm; x points to the right and y to the head.
    fn block(first: [usize; 3], last: [usize; 3]) -> (BrainMask, Grid) {
        let axes = DMat3::from_cols(DVec3::X * -2.0, DVec3::Z * 2.0, DVec3::Y * 2.0);
        let grid = Grid::new([20, 24, 28], DAffine3::from_mat3(axes)).unwrap();
        let inside = |index| {
            let voxel = grid.voxel(index);
            (0..3).all(|axis| (first[axis]..=last[axis]).contains(&voxel[axis]))
        };
        let voxels = (0..grid.voxel_count()).map(inside).collect();
        let mask = Mask::new(grid.clone(), voxels).unwrap();
        (BrainMask::from_mask(&mask, &grid).unwrap(), grid)
    }

    #[test]
    fn extents_and_volume_are_those_of_the_block() {
        let (brain, _) = block([5, 6, 7], [14, 9, 7]);
        assert_eq!(brain.extents_mm(), [20.0, 2.0, 8.0]);
        assert!((brain.volume_ml() - 0.32).abs() < 1e-9);
    }

    #[test]
    fn the_faces_that_a_brain_touches_are_told_by_the_patients_sides() {
        let (inside, grid) = block([1, 1, 1], [18, 22, 26]);
        assert_eq!(inside.cut_area_cm2(&grid), [0.0; 6]);
        let (cut, grid) = block([0, 0, 5], [9, 9, 14]);
        let areas = cut.cut_area_cm2(&grid);
        // The first x is at the left, the first y at the bottom: 10 × 10 voxels of 4 mm² each.
        for (face, area) in Face::ALL.into_iter().zip(areas) {
            let touched = matches!(face, Face::Left | Face::Inferior);
            let expected = if touched { 4.0 } else { 0.0 };
            assert!((area - expected).abs() < 1e-9, "{}: {area}", face.name());
        }
    }

    #[test]
    fn what_a_mask_marks_beyond_the_volume_does_not_touch_its_face() {
        let (brain, grid) = block([0, 5, 5], [9, 14, 14]);
        let inwards = DAffine3::from_translation(DVec3::X * 4.0);
        let smaller = Grid::new([16, 24, 28], grid.patient_from_voxel() * inwards).unwrap();
        let areas = brain.cut_area_cm2(&smaller);
        assert!((areas[Face::Left as usize] - 4.0).abs() < 1e-9, "{areas:?}");
        assert!((areas.iter().sum::<f64>() - 4.0).abs() < 1e-9, "{areas:?}");
    }

    #[test]
    fn the_share_of_the_largest_component_is_counted() {
        let grid = Grid::aligned([10, 1, 1], [1.0; 3], DVec3::ZERO).unwrap();
        let voxels = [1, 1, 1, 0, 1, 0, 0, 0, 0, 0].map(|voxel| voxel == 1);
        let mask = Mask::new(grid.clone(), voxels.to_vec()).unwrap();
        assert_eq!(mask.largest_component_share(), 0.75);
        let empty = Mask::new(grid, vec![false; 10]).unwrap();
        assert_eq!(empty.largest_component_share(), 1.0);
    }
}
