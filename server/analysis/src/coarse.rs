//! Sums over cells of several voxels, for wide smoothing at a matching resolution.

use glam::{DAffine3, DMat3, DVec3, Vec3};

use crate::convolve::{Kernel, smooth};

/// A grid of cells, each of several voxels of a block.
#[derive(Debug, Clone)]
pub(crate) struct Coarse {
    fine: [usize; 3],
    /// Voxels per cell along each axis.
    pub(crate) factor: [usize; 3],
    /// The centre of the first cell, in voxels.
    centre: [f32; 3],
    pub(crate) size: [usize; 3],
    /// Edges of a cell, in mm.
    pub(crate) spacing_mm: [f64; 3],
}

/// The sums of a cell: weighted values of one or more measures, and weights.
pub(crate) type Sums<const N: usize> = [f32; N];
/// Weighted values of one measure, and weights.
pub(crate) type Pair = Sums<2>;

impl Coarse {
    /// Cells of about `step_mm`, and no smaller than a voxel.
    pub(crate) fn new(fine: [usize; 3], spacing_mm: [f64; 3], step_mm: f64) -> Self {
        let factor = spacing_mm.map(|spacing| (step_mm / spacing).round().max(1.0) as usize);
        Self {
            fine,
            factor,
            centre: factor.map(|factor| (factor as f32 - 1.0) / 2.0),
            size: [0, 1, 2].map(|axis| fine[axis].div_ceil(factor[axis])),
            spacing_mm: [0, 1, 2].map(|axis| spacing_mm[axis] * factor[axis] as f64),
        }
    }

    /// The same cells on a grid of which this one has only every few voxels, from the first on.
    pub(crate) fn refined(&self, fine: [usize; 3], strides: [usize; 3]) -> Self {
        Self {
            fine,
            factor: [0, 1, 2].map(|axis| self.factor[axis] * strides[axis]),
            centre: [0, 1, 2].map(|axis| self.centre[axis] * strides[axis] as f32),
            ..*self
        }
    }

    fn voxels_of_a_cell(&self) -> f32 {
        self.factor.iter().product::<usize>() as f32
    }

    /// The mean of `sums_at` over the voxels of each cell, by index in the block, separately for each number.
    pub(crate) fn means<const N: usize>(
        &self,
        mut sums_at: impl FnMut(usize) -> Sums<N>,
    ) -> [Vec<f32>; N] {
        let [nx, ny, _] = self.fine;
        let [cx, cy, _] = self.size;
        let mut means = [0; N].map(|_| vec![0.0; self.size.iter().product()]);
        let share = 1.0 / self.voxels_of_a_cell();
        for number in 0..ny * self.fine[2] {
            let cell_row =
                cx * (number % ny / self.factor[1] + cy * (number / ny / self.factor[2]));
            for first in (0..nx).step_by(self.factor[0]) {
                let last = (first + self.factor[0]).min(nx);
                let mut total = [0.0; N];
                for x in first..last {
                    let sums = sums_at(number * nx + x);
                    for (total, sum) in total.iter_mut().zip(sums) {
                        *total += sum;
                    }
                }
                let cell = cell_row + first / self.factor[0];
                for (means, total) in means.iter_mut().zip(total) {
                    means[cell] += total * share;
                }
            }
        }
        means
    }

    /// The numbers smoothed by a Gaussian, which includes the width of the cells, and interleaved.
    pub(crate) fn smoothed<const N: usize>(
        &self,
        means: &[Vec<f32>; N],
        sigma_mm: f64,
    ) -> Vec<Sums<N>> {
        let kernels = [0, 1, 2].map(|axis| {
            let factor = self.factor[axis] as f64;
            // The variance of the voxels of a cell, and of the interpolation between two cells.
            let cell = (1.0 - factor.powi(-2)) / 12.0;
            let between = if self.factor[axis] > 1 {
                1.0 / 6.0
            } else {
                0.0
            };
            let wanted = (sigma_mm / self.spacing_mm[axis]).powi(2) - cell - between;
            Kernel::gaussian(wanted.max(0.0).sqrt())
        });
        let mut smoothed = means.clone();
        for numbers in &mut smoothed {
            smooth(numbers, self.size, &kernels);
        }
        let cells = 0..smoothed[0].len();
        cells
            .map(|cell| smoothed.each_ref().map(|numbers| numbers[cell]))
            .collect()
    }

    /// Converts an affine to voxels of the block into one to cells.
    pub(crate) fn through(&self, voxel_from_other: DAffine3) -> DAffine3 {
        let factor = DVec3::from_array(self.factor.map(|factor| factor as f64));
        let cell_from_voxel = DAffine3 {
            matrix3: DMat3::from_diagonal(factor.recip()),
            translation: (1.0 - factor) / 2.0 / factor,
        };
        cell_from_voxel * voxel_from_other
    }

    /// The sums at a position in cells, trilinear; 0 beyond the outermost cells.
    #[inline]
    pub(crate) fn sample<const N: usize>(&self, cells: &[Sums<N>], place: Vec3) -> Sums<N> {
        let [nx, ny, nz] = self.size;
        let last = Vec3::new(nx as f32 - 1.0, ny as f32 - 1.0, nz as f32 - 1.0);
        // Also false for NaN.
        if !(place.cmpge(Vec3::splat(-0.5)).all() && place.cmple(last + 0.5).all()) {
            return [0.0; N];
        }
        let [x, y, z] = [
            Between::of(place.x, nx, 1),
            Between::of(place.y, ny, nx),
            Between::of(place.z, nz, nx * ny),
        ];
        let start = x.start + y.start + z.start;
        let row = |at: usize| x.mix(cells[at], cells[at + x.step]);
        let slice = |at: usize| y.mix(row(at), row(at + y.step));
        z.mix(slice(start), slice(start + z.step))
    }

    /// A row of cells, interpolated from the rows of cells around a row of voxels of the block.
    pub(crate) fn mixed_row<const N: usize>(
        &self,
        cells: &[Sums<N>],
        number: usize,
        mixed: &mut Vec<Sums<N>>,
    ) {
        let [nx, ny, nz] = self.size;
        let place = |axis: usize, voxel: usize| {
            let factor = self.factor[axis] as f32;
            (voxel as f32 - self.centre[axis]) / factor
        };
        let y = Between::of(place(1, number % self.fine[1]), ny, nx);
        let z = Between::of(place(2, number / self.fine[1]), nz, nx * ny);
        let row = |at: usize| &cells[at..at + nx];
        let start = y.start + z.start;
        let low = row(start).iter().zip(row(start + y.step));
        let high = row(start + z.step).iter().zip(row(start + y.step + z.step));
        mixed.clear();
        mixed.extend(
            low.zip(high)
                .map(|((a, b), (c, d))| z.mix(y.mix(*a, *b), y.mix(*c, *d))),
        );
    }

    /// The positions of the voxels of a row between cells.
    pub(crate) fn along_row(&self) -> Vec<Between> {
        let factor = self.factor[0] as f32;
        let place = |x: usize| (x as f32 - self.centre[0]) / factor;
        (0..self.fine[0])
            .map(|x| Between::of(place(x), self.size[0], 1))
            .collect()
    }
}

/// A position between two cells of one axis.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Between {
    start: usize,
    step: usize,
    part: f32,
}

impl Between {
    /// Beyond the outermost cells, only those count.
    #[inline]
    fn of(place: f32, side: usize, stride: usize) -> Self {
        let place = place.clamp(0.0, side as f32 - 1.0);
        let base = (place as usize).min(side.saturating_sub(2));
        Self {
            start: base * stride,
            step: if side > 1 { stride } else { 0 },
            part: place - base as f32,
        }
    }

    #[inline(always)]
    fn mix<const N: usize>(self, low: Sums<N>, high: Sums<N>) -> Sums<N> {
        std::array::from_fn(|place| low[place] + (high[place] - low[place]) * self.part)
    }

    /// The sums in an interpolated row.
    #[inline]
    pub(crate) fn of_row<const N: usize>(self, row: &[Sums<N>]) -> Sums<N> {
        self.mix(row[self.start], row[self.start + self.step])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wide_gaussian_of_cells_is_nearly_that_of_voxels() {
        let size = [48, 44, 40];
        let at = |index: usize| {
            let [x, y, z] = [index % 48, index / 48 % 44, index / 48 / 44].map(|p| p as f32);
            [(x / 7.0).sin() + (y / 9.0).cos() * (z / 6.0).sin(), 1.0]
        };
        let coarse = Coarse::new(size, [1.0; 3], 2.0);
        let pairs = coarse.smoothed(&coarse.means(at), 3.0);
        let mut fine: Vec<f32> = (0..size.iter().product())
            .map(|index| at(index)[0])
            .collect();
        smooth(&mut fine, size, &[3.0; 3].map(Kernel::gaussian));
        for voxel in [[24, 22, 20], [19, 25, 18], [30, 17, 23]] {
            let index = voxel[0] + 48 * (voxel[1] + 44 * voxel[2]);
            let cell_from_voxel = coarse.through(DAffine3::IDENTITY);
            let place =
                cell_from_voxel.transform_point3(DVec3::from_array(voxel.map(|p| p as f64)));
            let [sum, weight] = coarse.sample(&pairs, place.as_vec3());
            assert!((sum / weight - fine[index]).abs() < 0.01, "{voxel:?}");
        }
    }
}
