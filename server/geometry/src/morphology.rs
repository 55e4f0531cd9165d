//! Dilation, erosion, closing and opening of a set of voxels by Euclidean balls.
//!
//! All are exact: thresholds of the distance transform.

use rayon::prelude::*;

use crate::envelope::close;
use crate::transform::{MAX_DISTANCE, exchanged, transformed};
use crate::{GeometryError, Mask};

impl Mask {
    /// The voxels of the grid within `radius_mm` of the set.
    ///
    /// # Errors
    /// If the grid is not isotropic, or if the radius is negative or at least 255 voxels.
    pub fn dilated(&self, radius_mm: f64) -> Result<Self, GeometryError> {
        let radius = self.radius_in_voxels(radius_mm)?;
        self.with_voxels(within(self.grid().size(), self.voxels(), radius))
    }

    /// The voxels of the set further than `radius_mm` from every voxel outside it; everything beyond the grid is
    /// outside.
    ///
    /// # Errors
    /// As [`Mask::dilated`].
    pub fn eroded(&self, radius_mm: f64) -> Result<Self, GeometryError> {
        let radius = self.radius_in_voxels(radius_mm)?;
        let size = self.grid().size();
        let mut rest = self.voxels().to_vec();
        rest.par_iter_mut().for_each(|voxel| *voxel = !*voxel);
        let mut far = within(size, &rest, radius);
        let [nx, ny, nz] = size.map(|side| side as f64);
        far.par_iter_mut().enumerate().for_each(|(index, voxel)| {
            let place = self.grid().voxel(index).map(|along| along as f64);
            // The first voxel outside a face is one voxel further away than the face.
            let to_face = [(place[0], nx), (place[1], ny), (place[2], nz)]
                .map(|(along, side)| (along + 1.0).min(side - along));
            *voxel = !*voxel && to_face.into_iter().fold(f64::INFINITY, f64::min) > radius;
        });
        self.with_voxels(far)
    }

    /// The closing by a ball: the voxels that no ball of `radius_mm` outside the set can reach. The faces of the grid
    /// do not cut it.
    ///
    /// # Errors
    /// As [`Mask::dilated`].
    pub fn closed(&self, radius_mm: f64) -> Result<Self, GeometryError> {
        let radius = self.radius_in_voxels(radius_mm)?;
        self.with_voxels(close(self.grid().size(), self.voxels(), radius))
    }

    /// The opening by a ball: the voxels that balls of `radius_mm` inside the set can reach.
    ///
    /// # Errors
    /// As [`Mask::dilated`].
    pub fn opened(&self, radius_mm: f64) -> Result<Self, GeometryError> {
        self.eroded(radius_mm)?.dilated(radius_mm)
    }

    fn with_voxels(&self, voxels: Vec<bool>) -> Result<Self, GeometryError> {
        Self::new(self.grid().clone(), voxels)
    }

    fn radius_in_voxels(&self, radius_mm: f64) -> Result<f64, GeometryError> {
        let radius = radius_mm / self.grid().spacing_mm()[0];
        let is_possible = (0.0..f64::from(MAX_DISTANCE)).contains(&radius);
        if self.grid().is_isotropic() && is_possible {
            Ok(radius)
        } else {
            Err(GeometryError::Parameter {
                name: "radius_mm",
                value: radius_mm,
                range: "less than 255 voxels of an isotropic grid",
            })
        }
    }
}

/// The voxels within a distance of a set.
fn within(size @ [nx, ny, nz]: [usize; 3], voxels: &[bool], radius: f64) -> Vec<bool> {
    if radius < 1.0 {
        return voxels.to_vec();
    }
    // Only distances up to the radius matter; the bound exceeds it.
    let bound = radius.floor() as u8 + 1;
    let mut bounds = exchanged(size, voxels, |voxel| if voxel { 0 } else { bound });
    let square = (radius * radius).floor() as u16;
    transformed([nx, nz, ny], &mut bounds, 0, |squared| squared <= square)
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::Grid;

    const SIZE: [usize; 3] = [9, 8, 7];

    fn scattered(one_in: u32) -> Mask {
        let mut state = 5u32;
        let voxels = (0..SIZE.iter().product()).map(|_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8).is_multiple_of(one_in)
        });
        let grid = Grid::aligned(SIZE, [0.5; 3], DVec3::ZERO).unwrap();
        Mask::new(grid, voxels.collect()).unwrap()
    }

    /// Whether a voxel within the radius equals the given value; voxels outside the grid are not marked.
    fn any_near(mask: &Mask, index: usize, radius: f64, value: bool) -> bool {
        let centre = mask.grid().voxel(index).map(|along| along as isize);
        let reach = radius as isize;
        let side = 2 * reach + 1;
        (0..side.pow(3)).any(|number| {
            let offset = [number % side, number / side % side, number / side.pow(2)];
            let offset = offset.map(|along| along - reach);
            let place = [0, 1, 2].map(|axis| centre[axis] + offset[axis]);
            let is_inside = (0..3).all(|axis| (0..SIZE[axis] as isize).contains(&place[axis]));
            let is_marked =
                is_inside && mask.voxels()[mask.grid().index(place.map(|along| along as usize))];
            let squared: isize = offset.iter().map(|along| along * along).sum();
            squared as f64 <= radius * radius && is_marked == value
        })
    }

    #[test]
    fn dilation_and_erosion_are_their_definitions() {
        for (radius, one_in) in [(1.0, 9), (2.0, 40), (2.3, 60)] {
            let sparse = scattered(one_in);
            let dilated = sparse.dilated(radius / 2.0).unwrap();
            let dense = sparse.with_voxels(sparse.voxels().iter().map(|voxel| !voxel).collect());
            let dense = dense.unwrap();
            let eroded = dense.eroded(radius / 2.0).unwrap();
            for index in 0..sparse.voxels().len() {
                assert_eq!(
                    dilated.voxels()[index],
                    any_near(&sparse, index, radius, true)
                );
                assert_eq!(
                    eroded.voxels()[index],
                    !any_near(&dense, index, radius, false)
                );
            }
        }
    }

    #[test]
    fn an_opening_is_within_the_set_and_a_closing_around_it() {
        let mask = scattered(2);
        let (opened, closed) = (mask.opened(0.5).unwrap(), mask.closed(0.5).unwrap());
        for index in 0..mask.voxels().len() {
            let [opened, voxel, closed] =
                [&opened, &mask, &closed].map(|mask| mask.voxels()[index]);
            assert!(opened <= voxel && voxel <= closed);
        }
        assert_eq!(opened.opened(0.5).unwrap(), opened);
        assert_eq!(closed.closed(0.5).unwrap(), closed);
    }

    #[test]
    fn a_radius_that_makes_no_sense_is_refused() {
        for radius_mm in [-1.0, 128.0, f64::NAN] {
            assert!(scattered(2).dilated(radius_mm).is_err());
        }
        let oblong = Grid::aligned([2; 3], [1.0, 1.0, 2.0], DVec3::ZERO).unwrap();
        assert!(
            Mask::new(oblong, vec![true; 8])
                .unwrap()
                .eroded(1.0)
                .is_err()
        );
    }
}
