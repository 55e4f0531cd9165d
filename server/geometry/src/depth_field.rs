//! Depth as a continuous function of position.

use glam::Vec3;
use rayon::prelude::*;

use crate::{DistanceMap, Grid};

/// Signed depth on the working grid, to be sampled between voxel centres: positive inside, negative outside.
///
/// Stored in 1/128 of a voxel, so that a case takes two bytes a voxel; rounding is at most 1/256 voxel.
/// Since the working grid lies along the patient axes, directions in voxel and patient space are the same.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthField {
    grid: Grid,
    spacing_mm: f32,
    values: Vec<i16>,
}

impl DepthField {
    /// Steps of the stored values in a voxel.
    pub const STEPS_PER_VOXEL: f32 = 128.0;

    /// The greatest `sigma_voxels` of [`DepthField::smoothed`].
    pub const MAX_SIGMA_VOXELS: f32 = 1.87;

    /// The field of a distance map: exact at voxel centres but for rounding.
    pub fn new(distance: &DistanceMap) -> Self {
        let steps =
            |squared: u16| (f32::from(squared).sqrt() * Self::STEPS_PER_VOXEL).round() as i16;
        let table: Vec<i16> = (0..=u16::MAX).map(steps).collect();
        let depths = distance.squared().par_iter().zip(distance.inside());
        let values = depths
            .map(|(&squared, &is_inside)| {
                let steps = table[usize::from(squared)];
                if is_inside { steps } else { -steps }
            })
            .collect();
        Self::on(distance.grid().clone(), values)
    }

    fn on(grid: Grid, values: Vec<i16>) -> Self {
        let spacing_mm = grid.spacing_mm()[0] as f32;
        Self {
            grid,
            spacing_mm,
            values,
        }
    }

    /// The field smoothed by about a Gaussian of `sigma_voxels`, for normals in which the voxel staircase does not show.
    ///
    /// The kernel is the binomial one of nearest variance, n/2 for 2n + 1 taps, up to
    /// [`DepthField::MAX_SIGMA_VOXELS`]; in whole numbers, so that every machine gets the same values.
    pub fn smoothed(&self, sigma_voxels: f32) -> Self {
        let sigma = sigma_voxels.clamp(0.0, Self::MAX_SIGMA_VOXELS);
        let kernel = binomial_kernel((2.0 * sigma * sigma).round() as usize);
        let [nx, ny, nz] = self.grid.size();
        let mut values = self.values.clone();
        for (stride, side) in [(1, nx), (nx, ny), (nx * ny, nz)] {
            values = convolve(&values, &kernel, nx, stride, side);
        }
        Self::on(self.grid.clone(), values)
    }

    /// The working grid.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Edge of a voxel, in mm.
    pub fn spacing_mm(&self) -> f32 {
        self.spacing_mm
    }

    /// Signed depths in 1/128 of a voxel, x-fastest.
    pub fn values(&self) -> &[i16] {
        &self.values
    }

    /// Signed depth in mm at a position in voxel coordinates, trilinear; beyond the grid, that of its nearest face.
    #[inline]
    pub fn depth_mm(&self, position_in_voxel: Vec3) -> f32 {
        let [nx, ny, _] = self.grid.size();
        let (base, fraction) = self.cell(position_in_voxel, 0);
        let start = base[0] + nx * (base[1] + ny * base[2]);
        let row = |start: usize| {
            let pair = &self.values[start..start + 2];
            between(f32::from(pair[0]), f32::from(pair[1]), fraction.x)
        };
        let slice = |start: usize| between(row(start), row(start + nx), fraction.y);
        let steps = between(slice(start), slice(start + nx * ny), fraction.z);
        steps * (self.spacing_mm / Self::STEPS_PER_VOXEL)
    }

    /// Gradient of the depth at a position in voxel coordinates: trilinear between central differences at voxel centres.
    ///
    /// Without unit (mm per mm), along L, P and S, pointing inwards; its length is near 1 but on ridges.
    pub fn gradient(&self, position_in_voxel: Vec3) -> Vec3 {
        let (base, fraction) = self.cell(position_in_voxel, 1);
        let [nx, ny, _] = self.grid.size();
        let [x_stride, y_stride, z_stride] = [1, nx, nx * ny];
        let start = base[0] + nx * (base[1] + ny * base[2]);
        let value = |index: usize| f32::from(self.values[index]);
        let difference = |index: usize| {
            Vec3::new(
                value(index + x_stride) - value(index - x_stride),
                value(index + y_stride) - value(index - y_stride),
                value(index + z_stride) - value(index - z_stride),
            )
        };
        let row = |start: usize| difference(start).lerp(difference(start + x_stride), fraction.x);
        let slice = |start: usize| row(start).lerp(row(start + y_stride), fraction.y);
        slice(start).lerp(slice(start + z_stride), fraction.z) / (2.0 * Self::STEPS_PER_VOXEL)
    }

    /// The first voxel of the cell that holds a position, at least `margin` from the faces, and the place in that cell.
    #[inline]
    fn cell(&self, position_in_voxel: Vec3, margin: usize) -> ([usize; 3], Vec3) {
        let size = self.grid.size();
        let mut base = [0; 3];
        let mut fraction = Vec3::ZERO;
        for axis in 0..3 {
            let low = margin as f32;
            let high = (size[axis] - 1 - margin) as f32;
            // Not `clamp`: a position that is not a number goes to the first cell.
            let position = position_in_voxel[axis].max(low).min(high);
            base[axis] = (position as usize).min(size[axis] - 2 - margin);
            fraction[axis] = position - base[axis] as f32;
        }
        (base, fraction)
    }
}

#[inline]
fn between(low: f32, high: f32, fraction: f32) -> f32 {
    low + (high - low) * fraction
}

/// The 2n + 1 binomial coefficients of order 2n; their sum is 4ⁿ, their variance n/2.
fn binomial_kernel(n: usize) -> Vec<i32> {
    let mut kernel = vec![1];
    for _ in 0..2 * n {
        let shifted = kernel.iter().copied().chain([0]);
        kernel = shifted
            .zip([0].into_iter().chain(kernel.clone()))
            .map(|(a, b)| a + b)
            .collect();
    }
    kernel
}

/// Convolves along one axis, given by its stride and side; beyond a face, values are those of the face.
fn convolve(values: &[i16], kernel: &[i32], nx: usize, stride: usize, side: usize) -> Vec<i16> {
    let reach = kernel.len() / 2;
    let total: i32 = kernel.iter().sum();
    let mut out = vec![0; values.len()];
    out.par_chunks_mut(nx).enumerate().for_each(|(row, out)| {
        let start = row * nx;
        let mut sums = vec![total / 2; nx];
        let place = start / stride % side;
        for (tap, &weight) in kernel.iter().enumerate() {
            if stride == 1 {
                let source = &values[start..start + nx];
                add_shifted(&mut sums, source, weight, tap, reach);
            } else {
                let neighbour = (place + tap).saturating_sub(reach).min(side - 1);
                let source = start - place * stride + neighbour * stride;
                for (sum, &value) in sums.iter_mut().zip(&values[source..source + nx]) {
                    *sum += weight * i32::from(value);
                }
            }
        }
        let shift = total.trailing_zeros();
        for (out, sum) in out.iter_mut().zip(sums) {
            *out = (sum >> shift) as i16;
        }
    });
    out
}

/// Adds the weighted values of a row to sums that lie `tap - reach` voxels before them.
fn add_shifted(sums: &mut [i32], row: &[i16], weight: i32, tap: usize, reach: usize) {
    let last = row.len() - 1;
    for (x, sum) in sums.iter_mut().enumerate().take(reach.min(last + 1)) {
        *sum += weight * i32::from(row[(x + tap).saturating_sub(reach).min(last)]);
    }
    let middle = reach.min(last + 1)..(last + 1).saturating_sub(reach).max(reach.min(last + 1));
    if !middle.is_empty() {
        let source = &row[middle.start + tap - reach..middle.end + tap - reach];
        for (sum, &value) in sums[middle.clone()].iter_mut().zip(source) {
            *sum += weight * i32::from(value);
        }
    }
    for (x, sum) in sums.iter_mut().enumerate().skip(middle.end) {
        *sum += weight * i32::from(row[(x + tap).saturating_sub(reach).min(last)]);
    }
}
