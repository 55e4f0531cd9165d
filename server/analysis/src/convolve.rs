//! Separable convolutions of whole blocks, in place, one axis after the other.
//!
//! Sums have a fixed order and no fused multiplications, so the result is the same on every machine.

use multiversion::multiversion;

use crate::spans::Spans;

/// The extent of a Gaussian, in standard deviations.
const REACH: f64 = 3.3;
/// The number of values that are summed at once.
const LANES: usize = 32;

/// A symmetric or antisymmetric kernel: the middle tap, then the taps beside it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Kernel {
    taps: Vec<f32>,
    is_odd: bool,
}

impl Kernel {
    /// A Gaussian with a sum of 1.
    pub(crate) fn gaussian(sigma_voxels: f64) -> Self {
        let sum = |taps: &[f64]| taps[0] + 2.0 * taps[1..].iter().sum::<f64>();
        let taps = gaussian_taps(sigma_voxels);
        let total = sum(&taps);
        Self::even(taps.iter().map(|tap| tap / total))
    }

    /// The derivative of a Gaussian; it is 1 for a ramp that rises by 1 per voxel.
    pub(crate) fn derivative(sigma_voxels: f64) -> Self {
        let taps: Vec<f64> = gaussian_taps(sigma_voxels)
            .iter()
            .enumerate()
            .map(|(place, tap)| place as f64 * tap)
            .collect();
        let slope: f64 = taps.iter().enumerate().map(|(k, tap)| k as f64 * tap).sum();
        Self {
            taps: taps.iter().map(|tap| (tap / slope / 2.0) as f32).collect(),
            is_odd: true,
        }
    }

    /// A box of unit area that is `width_voxels` wide.
    pub(crate) fn mean(width_voxels: f64) -> Self {
        let half = (width_voxels / 2.0).max(0.5);
        let reach = (half - 0.5).ceil() as usize;
        let covered = |place: usize| (half - place as f64 + 0.5).clamp(0.0, 1.0);
        Self::even((0..=reach).map(|place| covered(place) / (2.0 * half)))
    }

    fn even(taps: impl Iterator<Item = f64>) -> Self {
        Self {
            taps: taps.map(|tap| tap as f32).collect(),
            is_odd: false,
        }
    }

    /// Voxels to either side of the middle tap.
    pub(crate) fn reach(&self) -> usize {
        self.taps.len() - 1
    }

    /// The sum of squares of all taps: the factor for the variance of white noise.
    pub(crate) fn noise_gain(&self) -> f64 {
        self.shared_noise(self)
    }

    /// The covariance of white noise after this and after another kernel, both symmetric, as a factor of its variance.
    pub(crate) fn shared_noise(&self, other: &Self) -> f64 {
        let products: Vec<f64> = (self.taps.iter().zip(&other.taps))
            .map(|(a, b)| f64::from(*a) * f64::from(*b))
            .collect();
        products[0] + 2.0 * products[1..].iter().sum::<f64>()
    }

    /// Convolves a row. `padded` begins [`Kernel::reach`] strides before it and ends as many after it, or later.
    pub(crate) fn apply(&self, padded: &[f32], stride: usize, out: &mut [f32]) {
        convolve(padded, stride, self, out);
    }
}

/// The right half of the samples of a Gaussian, from the middle on.
fn gaussian_taps(sigma_voxels: f64) -> Vec<f64> {
    let reach = (REACH * sigma_voxels).ceil() as usize;
    let tap = |place: usize| (-0.5 * (place as f64 / sigma_voxels.max(1e-6)).powi(2)).exp();
    (0..=reach).map(tap).collect()
}

/// Convolves a block along its three axes; beyond its faces it is 0.
pub(crate) fn smooth(values: &mut [f32], size: [usize; 3], kernels: &[Kernel; 3]) {
    smooth_within(values, &Spans::whole(size), kernels);
}

/// Convolves a block along its three axes; beyond its faces it is 0. The result is right within the spans, and has no
/// meaning elsewhere.
pub(crate) fn smooth_within(values: &mut [f32], spans: &Spans, kernels: &[Kernel; 3]) {
    let [nx, ny, nz] = spans.size;
    let [along_x, along_y, along_z] = kernels;
    // What each pass has to compute for the one after it.
    let after_y = spans.widened_along_z(along_z.reach());
    let after_x = after_y.widened_along_y(along_y.reach());
    let mut padded_row = vec![0.0; nx + 2 * along_x.reach()];
    let mut padded = vec![0.0; nx * (ny + 2 * along_y.reach())];
    let first = nx * along_y.reach();
    for (z, plane) in values.chunks_exact_mut(nx * ny).enumerate() {
        for (y, row) in plane.chunks_exact(nx).enumerate() {
            let span = after_x.row(y, z);
            padded_row[along_x.reach()..][..nx].copy_from_slice(row);
            let out = &mut padded[first + nx * y..][span.clone()];
            along_x.apply(&padded_row[span.start..], 1, out);
        }
        for (y, row) in plane.chunks_exact_mut(nx).enumerate() {
            let span = after_y.row(y, z);
            along_y.apply(&padded[nx * y + span.start..], nx, &mut row[span]);
        }
    }
    let mut padded = vec![0.0; nx * (nz + 2 * along_z.reach())];
    let first = nx * along_z.reach();
    let start = |y: usize, z: usize| nx * (y + ny * z);
    for y in 0..ny {
        for z in 0..nz {
            let span = after_y.row(y, z);
            let row = &values[start(y, z)..][span.clone()];
            padded[first + nx * z..][span].copy_from_slice(row);
        }
        for z in 0..nz {
            let span = spans.row(y, z);
            let out = &mut values[start(y, z)..][span.clone()];
            along_z.apply(&padded[nx * z + span.start..], nx, out);
        }
    }
}

/// `out[i]` becomes the weighted sum of `padded` around `i`, at every `stride`-th value.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "x86_64+sse4.1"))]
fn convolve(padded: &[f32], stride: usize, kernel: &Kernel, out: &mut [f32]) {
    let taps = &kernel.taps[..];
    let sign = if kernel.is_odd { -1.0f32 } else { 1.0 };
    let middle = (taps.len() - 1) * stride;
    let Some(last) = out.len().checked_sub(LANES) else {
        for (place, out) in out.iter_mut().enumerate() {
            let at = middle + place;
            let mut sum = taps[0] * padded[at];
            for (k, tap) in taps.iter().enumerate().skip(1) {
                sum += tap * (padded[at + k * stride] + sign * padded[at - k * stride]);
            }
            *out = sum;
        }
        return;
    };
    for start in (0..out.len()).step_by(LANES) {
        // The last lanes may be computed twice. Their number is fixed, so the sums stay in registers.
        let start = start.min(last);
        let at = middle + start;
        let mut sums = [0.0; LANES];
        for (sum, value) in sums.iter_mut().zip(lanes(padded, at)) {
            *sum = taps[0] * value;
        }
        for (k, &tap) in taps.iter().enumerate().skip(1) {
            let after = lanes(padded, at + k * stride);
            let before = lanes(padded, at - k * stride);
            for lane in 0..LANES {
                sums[lane] += tap * (after[lane] + sign * before[lane]);
            }
        }
        out[start..start + LANES].copy_from_slice(&sums);
    }
}

/// The values from a place on. Without inlining, the sums would leave the registers.
#[inline(always)]
fn lanes(padded: &[f32], at: usize) -> &[f32; LANES] {
    padded[at..].first_chunk().expect("padded")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(count: usize) -> Vec<f32> {
        let value = |index: usize| (index as u32).wrapping_mul(2_654_435_761) >> 16;
        (0..count)
            .map(|index| value(index) as f32 / 65536.0)
            .collect()
    }

    #[test]
    fn a_separable_convolution_is_that_of_its_definition() {
        for size in [[40, 9, 7], [5, 6, 70]] {
            let kernels = [1.4, 0.8, 1.1].map(Kernel::gaussian);
            let values = noise(size.iter().product());
            let mut fast = values.clone();
            smooth(&mut fast, size, &kernels);
            let at = |voxel: [i64; 3]| -> f64 {
                let is_inside = (0..3).all(|axis| (0..size[axis] as i64).contains(&voxel[axis]));
                let [x, y, z] = voxel.map(|place| place as usize);
                if is_inside {
                    f64::from(values[x + size[0] * (y + size[1] * z)])
                } else {
                    0.0
                }
            };
            let weight = |axis: usize, offset: i64| {
                f64::from(
                    *kernels[axis]
                        .taps
                        .get(offset.unsigned_abs() as usize)
                        .unwrap_or(&0.0),
                )
            };
            for index in (0..values.len()).step_by(13) {
                let voxel = [
                    index % size[0],
                    index / size[0] % size[1],
                    index / size[0] / size[1],
                ];
                let mut sum = 0.0;
                for z in -4..=4 {
                    for y in -4..=4 {
                        for x in -5..=5 {
                            let there = [x, y, z];
                            let place = [0, 1, 2].map(|axis| voxel[axis] as i64 + there[axis]);
                            sum += weight(0, x) * weight(1, y) * weight(2, z) * at(place);
                        }
                    }
                }
                assert!((f64::from(fast[index]) - sum).abs() < 1e-5, "{index}");
            }
        }
    }

    #[test]
    fn within_spans_a_convolution_is_that_of_the_whole_block() {
        let size = [70, 31, 26];
        let kernels = [1.4, 0.8, 1.1].map(Kernel::gaussian);
        let values = noise(size.iter().product());
        let is_in_ball = |index: usize| {
            let [x, y, z] = [index % 70, index / 70 % 31, index / 70 / 31].map(|p| p as f32);
            (x - 40.0).powi(2) + (y - 14.0).powi(2) + (z - 12.0).powi(2) < 150.0
        };
        let ball: Vec<bool> = (0..values.len()).map(is_in_ball).collect();
        let [mut whole, mut within] = [values.clone(), values];
        smooth(&mut whole, size, &kernels);
        let spans = Spans::around(size, &ball, |is_inside| *is_inside);
        smooth_within(&mut within, &spans, &kernels);
        let inside = (0..ball.len()).filter(|&index| ball[index]);
        assert!(inside.clone().count() > 5_000);
        for index in inside {
            assert_eq!(whole[index].to_bits(), within[index].to_bits(), "{index}");
        }
    }

    #[test]
    fn kernels_keep_a_constant_and_differentiate_a_ramp() {
        for kernel in [Kernel::gaussian(1.7), Kernel::mean(5.0), Kernel::mean(7.4)] {
            let sum = kernel.taps[0] + 2.0 * kernel.taps[1..].iter().sum::<f32>();
            assert!((sum - 1.0).abs() < 1e-5, "{kernel:?}");
        }
        let kernel = Kernel::derivative(0.65);
        let ramp: Vec<f32> = (0..60).map(|place| 0.3 * place as f32).collect();
        let mut slope = vec![0.0; ramp.len() - 2 * kernel.reach()];
        kernel.apply(&ramp, 1, &mut slope);
        assert!(
            slope.iter().all(|slope| (slope - 0.3).abs() < 1e-5),
            "{slope:?}"
        );
    }
}
