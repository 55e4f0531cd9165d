//! Instance normalisation, the activation after it, and pooling.

use rayon::prelude::*;

use super::tensor::Tensor;

/// Added to the variance before the square root.
const EPSILON: f64 = 1e-5;

/// The sums for the mean and the variance of a channel.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Sums {
    /// The sum of the values.
    pub(crate) values: f64,
    /// The sum of their squares.
    pub(crate) squares: f64,
}

impl Sums {
    /// The sums of each channel over all planes, in the order of the planes.
    pub(crate) fn total(planes: &[Vec<Self>]) -> Vec<Self> {
        let channels = planes.first().map_or(0, Vec::len);
        let mut total = vec![Self::default(); channels];
        for sums in planes {
            for (total, sums) in total.iter_mut().zip(sums) {
                total.values += sums.values;
                total.squares += sums.squares;
            }
        }
        total
    }
}

/// The affine map of each channel to mean 0 and variance 1.
#[derive(Debug, Clone)]
pub(crate) struct Standardisation {
    scale: Vec<f32>,
    offset: Vec<f32>,
}

impl Standardisation {
    /// Computes it from the sums over `voxels` voxels.
    pub(crate) fn new(sums: &[Sums], voxels: usize) -> Self {
        let count = voxels as f64;
        let (scale, offset) = sums
            .iter()
            .map(|sums| {
                let mean = sums.values / count;
                let variance = (sums.squares / count - mean * mean).max(0.0);
                let scale = 1.0 / (variance + EPSILON).sqrt();
                (scale as f32, (-mean * scale) as f32)
            })
            .unzip();
        Self { scale, offset }
    }

    /// Replaces every value of a tensor by `change` of its standardised value.
    pub(crate) fn apply(&self, tensor: &mut Tensor, change: impl Fn(f32) -> f32 + Sync) {
        let (rows, plane) = (tensor.rows_in_plane(), tensor.plane_length());
        let width = tensor.size()[0];
        let [scale, offset] = [&self.scale, &self.offset].map(|values| values.repeat(width));
        let planes = tensor.planes_mut().par_chunks_mut(plane);
        planes.for_each(|values| {
            for row in &rows {
                let maps = scale.iter().zip(&offset);
                for (value, (scale, offset)) in values[row.clone()].iter_mut().zip(maps) {
                    *value = change(*value * scale + offset);
                }
            }
        });
    }

    /// Replaces every value of a tensor by `change` of its standardised value and the corresponding value of another
    /// tensor.
    ///
    /// # Panics
    /// If the shapes differ.
    pub(crate) fn apply_with(
        &self,
        tensor: &mut Tensor,
        other: &Tensor,
        change: impl Fn(f32, f32) -> f32 + Sync,
    ) {
        assert_eq!(tensor.values().len(), other.values().len(), "one shape");
        let (rows, plane) = (tensor.rows_in_plane(), tensor.plane_length());
        let width = tensor.size()[0];
        let [scale, offset] = [&self.scale, &self.offset].map(|values| values.repeat(width));
        let planes = tensor.planes_mut().par_chunks_mut(plane);
        planes
            .zip(other.planes().par_chunks(plane))
            .for_each(|(values, others)| {
                for row in &rows {
                    let maps = scale.iter().zip(&offset);
                    let pairs = values[row.clone()].iter_mut().zip(&others[row.clone()]);
                    for ((value, &other), (scale, offset)) in pairs.zip(maps) {
                        *value = change(*value * scale + offset, other);
                    }
                }
            });
    }
}

/// Sets negative values to 0.
pub(crate) fn rectified(value: f32) -> f32 {
    value.max(0.0)
}

/// Max pooling with blocks of three voxels and stride 2: half as many voxels along each axis.
pub(crate) fn max_pooled(input: &Tensor) -> Tensor {
    let size = input.size().map(|side| side / 2);
    let channels = input.channels();
    let mut output = Tensor::zeros(size, channels, 1);
    let (rows, plane) = (output.rows_in_plane(), output.plane_length());
    let planes = output.planes_mut().par_chunks_mut(plane);
    planes.enumerate().for_each(|(z, plane)| {
        let mut greatest = Vec::new();
        for (y, row) in rows.iter().enumerate() {
            greatest_of_rows(input, [y, z], &mut greatest);
            for (x, voxel) in plane[row.clone()].chunks_exact_mut(channels).enumerate() {
                let first = (2 * x).saturating_sub(1) * channels;
                voxel.copy_from_slice(&greatest[2 * x * channels..][..channels]);
                // The block has three voxels, except two at the beginning of a row.
                for neighbour in greatest[first..(2 * x + 2) * channels].chunks_exact(channels) {
                    raise(voxel, neighbour);
                }
            }
        }
    });
    output
}

/// The greatest values of the input rows around `2 y` and `2 z`, voxel by voxel.
fn greatest_of_rows(input: &Tensor, [y, z]: [usize; 2], greatest: &mut Vec<f32>) {
    greatest.clear();
    greatest.resize(input.size()[0] * input.channels(), f32::NEG_INFINITY);
    for z in (2 * z).saturating_sub(1)..2 * z + 2 {
        let plane = &input.planes()[z * input.plane_length()..];
        for y in (2 * y).saturating_sub(1)..2 * y + 2 {
            raise(greatest, &plane[input.row_in_plane(y)]);
        }
    }
}

fn raise(values: &mut [f32], others: &[f32]) {
    for (value, &other) in values.iter_mut().zip(others) {
        *value = value.max(other);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::testing::{random_tensor, value};

    #[test]
    fn a_standardised_channel_has_mean_0_and_variance_1() {
        let mut tensor = random_tensor([6, 5, 4], 3, 1, &mut 11);
        let of = |tensor: &Tensor, channel: usize| -> Vec<f64> {
            let voxels = (0..120).map(|i| [i % 6, i / 6 % 5, i / 30].map(|place| place as isize));
            voxels
                .map(|voxel| f64::from(value(tensor, voxel, channel)))
                .collect()
        };
        let sums: Vec<Sums> = (0..3)
            .map(|channel| {
                let values = of(&tensor, channel);
                Sums {
                    values: values.iter().sum(),
                    squares: values.iter().map(|value| value * value).sum(),
                }
            })
            .collect();
        Standardisation::new(&sums, 120).apply(&mut tensor, |value| value);
        for channel in 0..3 {
            let values = of(&tensor, channel);
            let mean = values.iter().sum::<f64>() / 120.0;
            let variance = values.iter().map(|value| value * value).sum::<f64>() / 120.0;
            assert!(
                mean.abs() < 1e-6 && (variance - 1.0).abs() < 1e-3,
                "{mean} {variance}"
            );
        }
        assert_eq!(value(&tensor, [-1, 2, 2], 0), 0.0);
    }

    #[test]
    fn a_constant_channel_becomes_zero() {
        let mut tensor = Tensor::zeros([2, 1, 1], 1, 1);
        let sums = [Sums::default()];
        Standardisation::new(&sums, 2).apply(&mut tensor, |value| value);
        assert!(tensor.values().iter().all(|&value| value == 0.0));
    }

    #[test]
    fn pooling_takes_the_greatest_of_three_voxels_along_each_axis() {
        let input = random_tensor([8, 6, 4], 2, 1, &mut 5);
        let pooled = max_pooled(&input);
        assert_eq!(pooled.size(), [4, 3, 2]);
        for index in 0..24 {
            let voxel = [index % 4, index / 4 % 3, index / 12];
            for channel in 0..2 {
                let mut greatest = f32::NEG_INFINITY;
                for tap in 0..27 {
                    let place = [tap % 3, tap / 3 % 3, tap / 9];
                    let place = [0, 1, 2].map(|axis| (2 * voxel[axis] + place[axis]) as isize - 1);
                    // Voxels outside are ignored, not zero.
                    if place.iter().all(|&along| along >= 0) {
                        greatest = greatest.max(value(&input, place, channel));
                    }
                }
                let found = value(&pooled, voxel.map(|place| place as isize), channel);
                assert_eq!(found, greatest);
            }
        }
    }
}
