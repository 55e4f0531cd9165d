//! The head that is measured on.

use geometry::{BrainMask, Grid, Mask, Volume};
use glam::{DAffine3, DVec3};
use imaging::nifti;
use rayon::prelude::*;

use crate::MeasureError;

/// A head and its brain mask, as files: reading them is a step that is measured too.
#[derive(Debug, Clone)]
pub struct Head {
    /// What it is called in the tables.
    pub name: String,
    /// The volume, NIfTI.
    pub volume: Vec<u8>,
    /// The brain mask, NIfTI.
    pub mask: Vec<u8>,
}

impl Head {
    /// The made-up head of the tests and the demonstration.
    ///
    /// # Errors
    /// None that is known; writing it may fail.
    ///
    /// # Panics
    /// When `spacing_mm` is not within 0.5 to 4.
    pub fn phantom(spacing_mm: f64) -> Result<Self, MeasureError> {
        let head = geometry::phantom::head(spacing_mm);
        Ok(Self {
            name: format!("phantom head at {spacing_mm} mm (not a real head)"),
            volume: nifti::write_volume(&head.volume)?,
            mask: nifti::write_mask(&head.brain)?,
        })
    }

    /// The volume and the mask.
    ///
    /// # Errors
    /// When a file is not sound.
    pub fn read(&self) -> Result<(Volume, Mask), MeasureError> {
        let limits = imaging::Limits::default();
        let volume = nifti::read_volume(&self.volume, &limits)?;
        let mask = nifti::read_mask(&self.mask, &limits)?;
        Ok((volume, mask))
    }
}

/// A volume and the mask of its brain.
#[derive(Debug, Clone)]
pub(crate) struct Scan {
    pub(crate) volume: Volume,
    pub(crate) mask: Mask,
}

impl Scan {
    /// The same head in another grid. Intensities are interpolated, as nothing but a measurement of growth may do.
    pub(crate) fn on_grid(&self, grid: Grid) -> Result<Self, MeasureError> {
        let source = &self.volume;
        let voxel_from_voxel = source.grid().voxel_from_patient() * grid.patient_from_voxel();
        let [nx, ny, _] = grid.size();
        let mut voxels = vec![0_u16; grid.voxel_count()];
        voxels
            .par_chunks_mut(nx)
            .enumerate()
            .for_each(|(row, voxels)| {
                let start = DVec3::new(0.0, (row % ny) as f64, (row / ny) as f64);
                fill_row(voxels, source, &voxel_from_voxel, start);
            });
        let mask = BrainMask::from_mask(&self.mask, &grid)?.mask().clone();
        Ok(Self {
            volume: Volume::new(grid, voxels, source.rescale())?,
            mask,
        })
    }

    /// A cube of `side` voxels along each axis about the head, in which the brain has the paper's share of the voxels.
    pub(crate) fn in_cube(&self, side: usize) -> Result<Self, MeasureError> {
        let brain = BrainMask::from_mask(&self.mask, self.volume.grid())?;
        let grid = brain.mask().grid();
        let middle = DVec3::from(grid.size().map(|side| (side - 1) as f64 / 2.0));
        let centre = grid.patient_from_voxel().transform_point3(middle);
        let inside = brain.mask().voxels().iter().filter(|inside| **inside);
        let brain_mm3 = inside.count() as f64 * grid.spacing_mm()[0].powi(3);
        // The closing adds about a twentieth to the brain; what counts is that every size has the same share.
        let edge_mm = (brain_mm3 * 1.05 / PAPER_SHARE_INSIDE).cbrt();
        let spacing_mm = edge_mm / side as f64;
        let origin = centre - DVec3::splat((side - 1) as f64 / 2.0 * spacing_mm);
        self.on_grid(Grid::aligned([side; 3], [spacing_mm; 3], origin)?)
    }
}

/// The share of the voxels that lies inside the envelope (section 3.3 of the paper).
const PAPER_SHARE_INSIDE: f64 = 0.15;

/// Fills a row of voxels that begins at `start` with the stored values of `source` there; with 0 outside of it.
fn fill_row(voxels: &mut [u16], source: &Volume, voxel_from_voxel: &DAffine3, start: DVec3) {
    for (x, voxel) in voxels.iter_mut().enumerate() {
        let position = voxel_from_voxel.transform_point3(start + DVec3::X * x as f64);
        *voxel = source.sample(position.as_vec3()).unwrap_or(0.0).round() as u16;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scan() -> Scan {
        let (volume, mask) = Head::phantom(4.0).unwrap().read().unwrap();
        Scan { volume, mask }
    }

    #[test]
    fn a_head_in_its_own_grid_is_itself() {
        let scan = scan();
        let again = scan.on_grid(scan.volume.grid().clone()).unwrap();
        assert_eq!(again.volume.voxels(), scan.volume.voxels());
    }

    #[test]
    fn the_brain_has_the_same_share_of_every_cube() {
        for side in [40, 64] {
            let cube = scan().in_cube(side).unwrap();
            assert_eq!(cube.volume.grid().size(), [side; 3]);
            let brain = BrainMask::from_mask(&cube.mask, cube.volume.grid()).unwrap();
            let inside = brain.mask().voxels().iter().filter(|inside| **inside);
            let share = inside.count() as f64 / side.pow(3) as f64;
            assert!((0.13..0.155).contains(&share), "{share}");
        }
    }
}
