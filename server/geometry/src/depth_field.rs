//! Depth as a continuous function of position.

use std::sync::Arc;

use glam::{DVec3, Vec3};
use multiversion::multiversion;
use rayon::prelude::*;

use crate::grid::as_position;
use crate::{Cut, DistanceMap, Fenced, Grid};

/// The distance of the last sampled position before the centre of the last voxel, so that a voxel follows it.
const LAST_CELL: f32 = 1e-3;

/// Signed depth on the working grid, sampled between voxel centres: positive inside, negative outside.
///
/// Stored in units of 1/128 voxel, two bytes per voxel; the rounding error is at most 1/256 voxel. The working grid is
/// along the patient axes, so directions in voxel space and patient space are the same.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthField {
    grid: Grid,
    spacing_mm: f32,
    mm_per_step: f32,
    /// The distance in `values` to the next voxel along y and z.
    strides: [usize; 2],
    /// The last sampled position, just before the centre of the last voxel.
    last: Vec3,
    values: Vec<i16>,
    cuts: Vec<Cut>,
    fenced: Option<Arc<Fenced>>,
}

impl DepthField {
    /// Steps of the stored values per voxel.
    pub const STEPS_PER_VOXEL: f32 = 128.0;

    /// The greatest `sigma_voxels` of [`DepthField::smoothed`].
    pub const MAX_SIGMA_VOXELS: f32 = 1.87;

    /// The field of a distance map: exact at voxel centres, except for rounding.
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
        Self {
            cuts: distance.envelope().cuts().to_vec(),
            fenced: distance.fenced().cloned(),
            ..Self::on(distance.grid().clone(), values)
        }
    }

    fn on(grid: Grid, values: Vec<i16>) -> Self {
        let [nx, ny, _] = grid.size();
        let spacing_mm = grid.spacing_mm()[0] as f32;
        Self {
            spacing_mm,
            mm_per_step: spacing_mm / Self::STEPS_PER_VOXEL,
            strides: [nx, nx * ny],
            last: Vec3::from_array(grid.size().map(|side| (side - 1) as f32 - LAST_CELL)),
            grid,
            values,
            cuts: Vec::new(),
            fenced: None,
        }
    }

    /// The field smoothed by approximately a Gaussian of `sigma_voxels`, for normals without the voxel staircase.
    ///
    /// The kernel is the binomial one with the nearest variance, n/2 for 2n + 1 taps, up to
    /// [`DepthField::MAX_SIGMA_VOXELS`]. It uses integers, so the result is the same on every machine.
    pub fn smoothed(&self, sigma_voxels: f32) -> Self {
        let sigma = sigma_voxels.clamp(0.0, Self::MAX_SIGMA_VOXELS);
        let kernel = binomial_kernel((2.0 * sigma * sigma).round() as usize);
        let [nx, ny, nz] = self.grid.size();
        let mut values = self.values.clone();
        for (stride, side) in [(1, nx), (nx, ny), (nx * ny, nz)] {
            values = convolved(&values, &kernel, nx, stride, side);
        }
        Self {
            cuts: self.cuts.clone(),
            fenced: self.fenced.clone(),
            ..Self::on(self.grid.clone(), values)
        }
    }

    /// The working grid.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// The faces of the volume that cut the brain. Near them the values are distances to a cut, not depths.
    pub fn cuts(&self) -> &[Cut] {
        &self.cuts
    }

    /// Where a fence makes the depth unknown; `None` if nowhere. There the values are distances to the fence.
    pub fn fenced(&self) -> Option<&Fenced> {
        self.fenced.as_deref()
    }

    /// Whether a depth at a position (LPS mm) is known: no cut and no fence may be nearer than the dura.
    pub fn is_known(&self, position_in_patient: DVec3, depth_mm: f32) -> bool {
        let voxel_mm = f64::from(self.spacing_mm);
        let is_fenced = |fenced: &Fenced| {
            let voxel_from_patient = self.grid.voxel_from_patient();
            let voxel = voxel_from_patient.transform_point3(position_in_patient);
            fenced.covers(voxel.as_vec3().to_array())
        };
        Cut::all_leave(&self.cuts, position_in_patient, depth_mm, voxel_mm)
            && !self.fenced().is_some_and(is_fenced)
    }

    /// Edge of a voxel, in mm.
    pub fn spacing_mm(&self) -> f32 {
        self.spacing_mm
    }

    /// Signed depths in 1/128 of a voxel, x-fastest.
    pub fn values(&self) -> &[i16] {
        &self.values
    }

    /// Signed depth in mm at a position in voxel coordinates, trilinear; beyond the grid, the value at its nearest
    /// face.
    #[inline]
    pub fn depth_mm(&self, position_in_voxel: Vec3) -> f32 {
        let [y_stride, z_stride] = self.strides;
        let (x, y, z) = self.cell(position_in_voxel, 0.0);
        let start = x.first + y_stride * y.first + z_stride * z.first;
        let row = |start: usize| {
            let pair = &self.values[start..start + 2];
            x.between(f32::from(pair[0]), f32::from(pair[1]))
        };
        let slice = |start: usize| y.between(row(start), row(start + y_stride));
        z.between(slice(start), slice(start + z_stride)) * self.mm_per_step
    }

    /// Signed depth in mm at the centre of each voxel of another grid, x-fastest.
    pub fn resampled(&self, grid: &Grid) -> Vec<f32> {
        let [nx, ny, _] = grid.size();
        let own_from_other = self.grid.voxel_from_patient() * grid.patient_from_voxel();
        let mut depths = vec![0.0; grid.voxel_count()];
        depths
            .par_chunks_mut(nx)
            .enumerate()
            .for_each(|(row, depths)| {
                for (x, depth) in depths.iter_mut().enumerate() {
                    let centre = as_position([x, row % ny, row / ny]);
                    *depth = self.depth_mm(own_from_other.transform_point3(centre).as_vec3());
                }
            });
        depths
    }

    /// Gradient of the depth at a position in voxel coordinates: trilinear between central differences at voxel
    /// centres.
    ///
    /// Dimensionless (mm per mm), along L, P and S, pointing inwards; its length is close to 1, except on ridges.
    pub fn gradient(&self, position_in_voxel: Vec3) -> Vec3 {
        let [y_stride, z_stride] = self.strides;
        // Slightly more than a voxel, because an integer coordinate may count as the end of the cell before it.
        let (x, y, z) = self.cell(position_in_voxel, 1.0 + 1.0 / 1024.0);
        let start = x.first + y_stride * y.first + z_stride * z.first;
        let value = |index: usize| f32::from(self.values[index]);
        let difference = |index: usize| {
            Vec3::new(
                value(index + 1) - value(index - 1),
                value(index + y_stride) - value(index - y_stride),
                value(index + z_stride) - value(index - z_stride),
            )
        };
        let row = |start: usize| difference(start).lerp(difference(start + 1), x.fraction);
        let slice = |start: usize| row(start).lerp(row(start + y_stride), y.fraction);
        slice(start).lerp(slice(start + z_stride), z.fraction) / (2.0 * Self::STEPS_PER_VOXEL)
    }

    /// The cell of a position along each axis, at least `margin` voxels from the faces.
    #[inline]
    fn cell(&self, position_in_voxel: Vec3, margin: f32) -> (Place, Place, Place) {
        // NaN goes to the first cell.
        let position = position_in_voxel
            .max(Vec3::splat(margin))
            .min(self.last - margin);
        (
            Place::of(position.x),
            Place::of(position.y),
            Place::of(position.z),
        )
    }
}

/// The voxel before a coordinate, and the fraction of a voxel beyond it, 0 to 1.
#[derive(Clone, Copy)]
struct Place {
    first: usize,
    fraction: f32,
}

impl Place {
    /// Splits a coordinate of 0 to 2²¹.
    ///
    /// Adding a large number to the coordinate minus ½ rounds it to an integer, which is then in the lowest bits. This
    /// takes three instructions; a saturating conversion takes many. An integer coordinate may count as the end of the
    /// cell before it, which makes no difference.
    #[inline]
    fn of(coordinate: f32) -> Self {
        const ROUNDING: f32 = (3u32 << 22) as f32;
        let rounded = (coordinate - 0.5) + ROUNDING;
        let first = (rounded.to_bits() - ROUNDING.to_bits()) as usize;
        Self {
            first,
            fraction: coordinate - (rounded - ROUNDING),
        }
    }

    #[inline]
    fn between(self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.fraction
    }
}

/// The 2n + 1 binomial coefficients of order 2n, with the sum 4ⁿ and the variance n/2.
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

/// Values convolved along one axis, given by its stride and side; beyond a face, the values of the face are repeated.
fn convolved(values: &[i16], kernel: &[i32], nx: usize, stride: usize, side: usize) -> Vec<i16> {
    let reach = kernel.len() / 2;
    let mut out = vec![0; values.len()];
    out.par_chunks_mut(nx)
        .enumerate()
        .for_each_init(Vec::new, |padded, (row, out)| {
            let start = row * nx;
            let place = start / stride % side;
            if stride == 1 {
                pad_row(&values[start..start + nx], reach, padded);
                let rows: Vec<_> = (0..kernel.len())
                    .map(|tap| &padded[tap..tap + nx])
                    .collect();
                weighted_sum(&rows, kernel, out);
            } else {
                let neighbour = |tap: usize| (place + tap).saturating_sub(reach).min(side - 1);
                let first = |tap: usize| start - place * stride + neighbour(tap) * stride;
                let rows: Vec<_> = (0..kernel.len())
                    .map(|tap| &values[first(tap)..][..nx])
                    .collect();
                weighted_sum(&rows, kernel, out);
            }
        });
    out
}

/// A row with its end values repeated `reach` times before and after it.
fn pad_row(row: &[i16], reach: usize, padded: &mut Vec<i16>) {
    padded.clear();
    padded.extend(std::iter::repeat_n(row[0], reach));
    padded.extend_from_slice(row);
    padded.extend(std::iter::repeat_n(row[row.len() - 1], reach));
}

/// The weighted mean of rows, rounded to an integer; the sum of the kernel is a power of two.
#[multiversion(targets("x86_64+avx2", "x86_64+sse4.1"))]
fn weighted_sum(rows: &[&[i16]], kernel: &[i32], out: &mut [i16]) {
    const LANES: usize = 32;
    let total: i32 = kernel.iter().sum();
    let shift = total.trailing_zeros();
    let taps = || rows.iter().zip(kernel);
    let Some(last) = out.len().checked_sub(LANES) else {
        for (place, out) in out.iter_mut().enumerate() {
            let sum: i32 = taps()
                .map(|(row, weight)| weight * i32::from(row[place]))
                .sum();
            *out = ((sum + total / 2) >> shift) as i16;
        }
        return;
    };
    for start in (0..out.len()).step_by(LANES) {
        // The last lanes may be computed twice. Their number is fixed, so the sums stay in registers.
        let start = start.min(last);
        let mut sums = [total / 2; LANES];
        for (row, &weight) in taps() {
            let values: &[i16; LANES] = row[start..].first_chunk().expect("as many as of out");
            for (sum, &value) in sums.iter_mut().zip(values) {
                *sum += weight * i32::from(value);
            }
        }
        for (out, sum) in out[start..].iter_mut().zip(sums) {
            *out = (sum >> shift) as i16;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{distance_map, envelope, phantom};

    fn ball_field(radius: f64) -> DepthField {
        DepthField::new(&distance_map(
            &envelope(&phantom::ball(radius), 0.0).unwrap(),
        ))
    }

    fn centre(field: &DepthField) -> Vec3 {
        Vec3::from_array(field.grid().size().map(|side| (side / 2) as f32))
    }

    #[test]
    fn depth_falls_from_the_centre_of_a_ball_to_below_zero_outside() {
        let field = ball_field(20.0);
        let at = |radius: f32| field.depth_mm(centre(&field) + Vec3::X * radius);
        // Depth counts from the centres of border voxels, which lie up to a voxel inside the ball.
        assert!((19.0..=20.0).contains(&at(0.0)), "{}", at(0.0));
        assert!((8.5..=9.5).contains(&at(10.5)), "{}", at(10.5));
        assert!(at(22.0) < -1.5);
        assert_eq!(
            field.depth_mm(Vec3::splat(-1e9)),
            field.depth_mm(Vec3::ZERO)
        );
        assert!(field.depth_mm(Vec3::splat(f32::NAN)).is_finite());
    }

    #[test]
    fn the_gradient_points_inwards_with_length_one() {
        let field = ball_field(20.0);
        for direction in [Vec3::X, -Vec3::Y, Vec3::ONE.normalize()] {
            let gradient = field.gradient(centre(&field) + direction * 10.0);
            assert!(gradient.normalize().dot(-direction) > 0.97, "{gradient}");
            assert!((gradient.length() - 1.0).abs() < 0.15, "{gradient}");
        }
    }

    #[test]
    fn smoothing_keeps_a_plane_and_softens_the_staircase() {
        let field = ball_field(20.0);
        let smooth = field.smoothed(1.5);
        let surface = |direction: Vec3| centre(&field) + direction * 19.5;
        let mut worst = [1.0f32; 2];
        for i in 0..200 {
            let angle = i as f32 * 0.37;
            let direction = Vec3::new(angle.cos(), angle.sin(), (angle * 0.31).sin()).normalize();
            for (worst, field) in worst.iter_mut().zip([&field, &smooth]) {
                let normal = -field.gradient(surface(direction)).normalize();
                *worst = worst.min(normal.dot(direction));
            }
        }
        assert!(worst[1] > 0.99 && worst[1] > worst[0], "{worst:?}");
        assert_eq!(binomial_kernel(2), [1, 4, 6, 4, 1]);
        assert_eq!(field.smoothed(0.0), field);
    }

    #[test]
    fn a_convolution_is_that_of_its_definition() {
        let field = ball_field(9.0);
        let kernel = binomial_kernel(3);
        let [nx, ny, nz] = field.grid().size();
        for (stride, side) in [(1, nx), (nx, ny), (nx * ny, nz)] {
            let fast = convolved(field.values(), &kernel, nx, stride, side);
            for index in (0..fast.len()).step_by(11) {
                let place = index / stride % side;
                let value = |tap: usize| {
                    let neighbour = (place + tap).saturating_sub(3).min(side - 1);
                    i32::from(field.values()[index - place * stride + neighbour * stride])
                };
                let sum: i32 = kernel
                    .iter()
                    .enumerate()
                    .map(|(tap, weight)| weight * value(tap))
                    .sum();
                assert_eq!(i32::from(fast[index]), (sum + 32).div_euclid(64));
            }
        }
    }
}
