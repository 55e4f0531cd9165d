//! A volume with the axes of the training data: nearest to right, anterior and superior.

use std::ops::Range;

use geometry::{GeometryError, Grid, Volume};
use glam::{DAffine3, DMat3, DVec3};
use rayon::prelude::*;

/// A view of a volume with its axes in the order right, anterior, superior; nothing is resampled.
#[derive(Debug)]
pub(crate) struct Canonical<'a> {
    volume: &'a Volume,
    size: [usize; 3],
    /// For each axis, the axis of the volume and whether it is reversed.
    axes: [Axis; 3],
}

#[derive(Debug, Clone, Copy)]
struct Axis {
    native: usize,
    is_flipped: bool,
}

/// A block of voxels along the canonical axes.
pub(crate) type Box3 = [Range<usize>; 3];

impl<'a> Canonical<'a> {
    /// Orders the axes by their main direction.
    pub(crate) fn new(volume: &'a Volume) -> Self {
        let axes = axes_of(volume.grid());
        let native_size = volume.grid().size();
        Self {
            volume,
            size: axes.map(|axis| native_size[axis.native]),
            axes,
        }
    }

    /// Voxels along the right, anterior and superior axes.
    pub(crate) fn size(&self) -> [usize; 3] {
        self.size
    }

    /// Its voxels in this order.
    ///
    /// # Errors
    /// Never: the grid is valid already.
    pub(crate) fn grid(&self) -> Result<Grid, GeometryError> {
        Grid::new(self.size, self.patient_from_canonical())
    }

    /// The whole volume as a block.
    pub(crate) fn whole(&self) -> Box3 {
        self.size.map(|side| 0..side)
    }

    /// The grid of a cube of `side` voxels over a block: the positions of the values of [`Canonical::cube`].
    ///
    /// # Errors
    /// If its voxels are too small or too large for a scan.
    pub(crate) fn cube_grid(&self, block: &Box3, side: usize) -> Result<Grid, GeometryError> {
        let scale = DVec3::from_array([0, 1, 2].map(|axis| block[axis].len() as f64 / side as f64));
        let first = DVec3::from_array([0, 1, 2].map(|axis| block[axis].start as f64));
        let canonical_from_cube = DAffine3 {
            matrix3: DMat3::from_diagonal(scale),
            translation: first - 0.5 + scale / 2.0,
        };
        Grid::new(
            [side; 3],
            self.patient_from_canonical() * canonical_from_cube,
        )
    }

    fn patient_from_canonical(&self) -> DAffine3 {
        let mut native_from_canonical = DAffine3::from_mat3(DMat3::ZERO);
        for (here, axis) in self.axes.iter().enumerate() {
            let direction = if axis.is_flipped { -1.0 } else { 1.0 };
            native_from_canonical.matrix3.col_mut(here)[axis.native] = direction;
            if axis.is_flipped {
                native_from_canonical.translation[axis.native] = (self.size[here] - 1) as f64;
            }
        }
        self.volume.grid().patient_from_voxel() * native_from_canonical
    }

    /// The stored values of a block, resampled to a cube of `side` voxels by nearest neighbour; x-fastest.
    pub(crate) fn cube(&self, block: &Box3, side: usize) -> Vec<u16> {
        let size = self.volume.grid().size();
        let strides = [1, size[0], size[0] * size[1]];
        let offsets = [0, 1, 2].map(|here| {
            let axis = self.axes[here];
            let at = |place: usize| {
                let place = nearest(place, side, &block[here]);
                let place = if axis.is_flipped {
                    self.size[here] - 1 - place
                } else {
                    place
                };
                place * strides[axis.native]
            };
            (0..side).map(at).collect::<Vec<usize>>()
        });
        let [x, y, z] = &offsets;
        let voxels = self.volume.voxels();
        let mut cube = vec![0; side * side * side];
        let rows = cube.par_chunks_mut(side).enumerate();
        rows.for_each(|(row, values)| {
            let start = y[row % side] + z[row / side];
            for (value, offset) in values.iter_mut().zip(x) {
                *value = voxels[start + offset];
            }
        });
        cube
    }
}

/// The voxel of a block that is nearest to a voxel of the cube, in single precision as in the training of the network.
fn nearest(place: usize, side: usize, block: &Range<usize>) -> usize {
    let scale = block.len() as f32 / side as f32;
    let place = ((place as f32 + 0.5) * scale).floor() as usize;
    block.start + place.min(block.len() - 1)
}

/// For each of the axes right, anterior and superior: the axis of a grid that is nearest to it, and whether that is reversed.
pub fn canonical_axes(grid: &Grid) -> [(usize, bool); 3] {
    axes_of(grid).map(|axis| (axis.native, axis.is_flipped))
}

/// Assigns each axis of the grid, in turn, to the free canonical axis along which it points most.
fn axes_of(grid: &Grid) -> [Axis; 3] {
    let matrix = grid.patient_from_voxel().matrix3;
    let mut axes = [None; 3];
    for native in 0..3 {
        // From left and posterior to right and anterior.
        let direction = matrix.col(native) * DVec3::new(-1.0, -1.0, 1.0);
        let free = (0..3).filter(|&here| axes[here].is_none());
        let most = free.max_by(|&a, &b| direction[a].abs().total_cmp(&direction[b].abs()));
        if let Some(here) = most {
            axes[here] = Some(Axis {
                native,
                is_flipped: direction[here] < 0.0,
            });
        }
    }
    axes.map(|axis| axis.expect("three axes for three"))
}

#[cfg(test)]
mod tests {
    use geometry::Rescale;

    use super::*;

    const AS_STORED: Rescale = Rescale {
        slope: 1.0,
        intercept: 0.0,
    };

    /// A volume of 3×4×5 voxels with the patient axes in some order and direction. Its values encode the position:
    /// hundreds to the right, tens to the front, ones upwards.
    fn turned(order: [usize; 3], signs: usize) -> Volume {
        let sense = |axis: usize| if signs >> axis & 1 == 0 { 1.0 } else { -1.0 };
        let axes = [0, 1, 2].map(|axis| DVec3::AXES[order[axis]] * sense(axis) * 2.0);
        let matrix3 = DMat3::from_cols(axes[0], axes[1], axes[2]);
        let size = order.map(|axis| [3, 4, 5][axis]);
        let middle = DVec3::from_array(size.map(|side| (side - 1) as f64 / 2.0));
        let affine = DAffine3 {
            matrix3,
            translation: matrix3 * -middle,
        };
        let grid = Grid::new(size, affine).unwrap();
        let value = |index: usize| {
            let voxel = DVec3::from_array(grid.voxel(index).map(|place| place as f64));
            let lps = affine.transform_point3(voxel) / 2.0;
            (100.0 * (1.0 - lps.x) + 10.0 * (1.5 - lps.y) + lps.z + 2.0).round() as u16
        };
        let voxels = (0..60).map(value).collect();
        Volume::new(grid, voxels, AS_STORED).unwrap()
    }

    #[test]
    fn every_order_and_sense_of_axes_looks_the_same() {
        for order in geometry::AXIS_ORDERS {
            for signs in 0..8 {
                let volume = turned(order, signs);
                let canonical = Canonical::new(&volume);
                assert_eq!(canonical.size(), [3, 4, 5]);
                // 60 voxels per side: each voxel appears equally often.
                let cube = canonical.cube(&canonical.whole(), 60);
                let grid = canonical.cube_grid(&canonical.whole(), 60).unwrap();
                for (index, &value) in cube.iter().enumerate().step_by(97) {
                    let [x, y, z] = grid.voxel(index);
                    let expected = 100 * (x / 20) + 10 * (y / 15) + z / 12;
                    assert_eq!(
                        usize::from(value),
                        expected,
                        "{order:?} {signs} at {x} {y} {z}"
                    );
                    // The grid has the matching position.
                    let place = DVec3::from_array([x, y, z].map(|place| place as f64));
                    let patient = grid.patient_from_voxel().transform_point3(place);
                    let native = volume.grid().voxel_from_patient().transform_point3(patient);
                    let native = native.round().to_array().map(|place| place as usize);
                    assert_eq!(volume.voxels()[volume.grid().index(native)], value);
                }
            }
        }
    }

    #[test]
    fn a_block_is_brought_to_a_cube() {
        let volume = turned([0, 1, 2], 0);
        let canonical = Canonical::new(&volume);
        assert_eq!(
            canonical.cube(&[1..3, 2..4, 0..5], 2),
            [121, 221, 131, 231, 123, 223, 133, 233]
        );
        let grid = canonical.cube_grid(&[1..3, 2..4, 0..5], 2).unwrap();
        assert_eq!(grid.spacing_mm(), [2.0, 2.0, 5.0]);
    }
}
