//! From probabilities to the brain mask on the working grid.

use geometry::{BrainMask, GeometryError, Grid, Mask};
use glam::DVec3;
use rayon::prelude::*;

/// The probability of belonging to the brain, on a grid.
#[derive(Debug)]
pub struct Probability {
    grid: Grid,
    values: Vec<f32>,
}

impl Probability {
    /// A map with one value per voxel of a grid.
    pub(crate) fn new(grid: Grid, values: Vec<f32>) -> Self {
        assert_eq!(values.len(), grid.voxel_count(), "one value for each voxel");
        Self { grid, values }
    }

    /// The grid of the values.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Values from 0 to 1, x-fastest.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// The voxels above a threshold, on the grid of the probabilities.
    pub(crate) fn above(&self, threshold: f32) -> Result<Mask, GeometryError> {
        let voxels = self.values.iter().map(|&value| value > threshold).collect();
        Mask::new(self.grid.clone(), voxels)
    }

    /// The brain on the working grid of a volume: the voxels with a probability above a threshold.
    ///
    /// # Errors
    /// If there are none.
    pub fn brain(&self, volume_grid: &Grid, threshold: f32) -> Result<BrainMask, GeometryError> {
        let working = self
            .above(threshold)?
            .largest_component()
            .working_grid(volume_grid)?;
        BrainMask::from_mask(&self.above_on(&working, threshold)?, volume_grid)
    }

    /// The voxels of another grid with a probability above a threshold: trilinear between voxel centres, 0 outside.
    pub(crate) fn above_on(&self, grid: &Grid, threshold: f32) -> Result<Mask, GeometryError> {
        let [nx, ny, _] = grid.size();
        let here_from_there = self.grid.voxel_from_patient() * grid.patient_from_voxel();
        let step = here_from_there.matrix3.x_axis;
        let mut voxels = vec![false; grid.voxel_count()];
        let rows = voxels.par_chunks_mut(nx).enumerate();
        rows.for_each(|(row, voxels)| {
            let start = DVec3::new(0.0, (row % ny) as f64, (row / ny) as f64);
            let start = here_from_there.transform_point3(start);
            for (x, voxel) in voxels.iter_mut().enumerate() {
                *voxel = self.at(start + step * x as f64) > threshold;
            }
        });
        Mask::new(grid.clone(), voxels)
    }

    /// The value at a position in voxel coordinates, trilinear between centres; 0 outside every voxel.
    fn at(&self, position: DVec3) -> f32 {
        if !self.grid.contains(position) {
            return 0.0;
        }
        let size = self.grid.size();
        let last = DVec3::from_array(size.map(|side| (side - 1) as f64));
        let position = position.clamp(DVec3::ZERO, last);
        let base = position.floor().min((last - 1.0).max(DVec3::ZERO));
        let fraction = (position - base).as_vec3();
        let [x, y, z] = base.to_array().map(|place| place as usize);
        let step = size.map(|side| usize::from(side > 1));
        let pair = |y: usize, z: usize| {
            let start = self.grid.index([x, y, z]);
            between(self.values[start], self.values[start + step[0]], fraction.x)
        };
        let plane = |z: usize| between(pair(y, z), pair(y + step[1], z), fraction.y);
        between(plane(z), plane(z + step[2]), fraction.z)
    }
}

fn between(low: f32, high: f32, fraction: f32) -> f32 {
    low + (high - low) * fraction
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_surface_between_voxels_lands_where_it_is() {
        // A half-space with a probability that falls by 0.1 per mm and is ½ at x = 3.2 mm.
        let coarse = Grid::aligned([8, 3, 3], [1.0; 3], DVec3::ZERO).unwrap();
        let value = |index| 0.5 + 0.1 * (3.2 - coarse.voxel(index)[0] as f32);
        let values = (0..coarse.voxel_count()).map(value).collect();
        let probability = Probability::new(coarse, values);
        let fine = Grid::aligned([40, 1, 1], [0.1, 1.0, 1.0], DVec3::new(1.05, 1.0, 1.0)).unwrap();
        let mask = probability.above_on(&fine, 0.5).unwrap();
        let marked = mask.voxels().iter().filter(|&&voxel| voxel).count();
        assert_eq!(marked, 22);
    }

    #[test]
    fn outside_there_is_nothing_and_in_the_outer_half_the_borders_own() {
        let grid = Grid::aligned([2, 1, 1], [1.0; 3], DVec3::ZERO).unwrap();
        let probability = Probability::new(grid, vec![0.75, 0.25]);
        assert_eq!(probability.at(DVec3::new(-0.4, 0.3, 0.0)), 0.75);
        assert_eq!(probability.at(DVec3::new(0.5, 0.0, 0.0)), 0.5);
        assert_eq!(probability.at(DVec3::new(1.4, 0.0, 0.0)), 0.25);
        assert_eq!(probability.at(DVec3::new(1.6, 0.0, 0.0)), 0.0);
        assert_eq!(probability.at(DVec3::new(0.0, 0.6, 0.0)), 0.0);
    }
}
