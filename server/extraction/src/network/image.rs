//! Normalises intensities for the network.

use geometry::Volume;
use rayon::prelude::*;

use super::tensor::Tensor;
use crate::ExtractionError;

/// The quantiles of the small cube that become black and white.
const FRACTIONS: [f64; 2] = [0.005, 0.995];

/// Mean and standard deviation of the training data.
const MEAN: f64 = 0.449;
const DEVIATION: f64 = 0.226;

/// How far the widest kernel reaches beyond the image.
const BORDER: usize = 3;

/// The intensities for black and white.
#[derive(Debug, Clone, Copy)]
pub(super) struct Quantiles {
    low: f32,
    high: f32,
}

impl Quantiles {
    /// Computes them from stored values of a volume.
    pub(super) fn of(volume: &Volume, stored: &[u16]) -> Result<Self, ExtractionError> {
        let mut values: Vec<f32> = stored
            .iter()
            .map(|&stored| volume.intensity(f32::from(stored)))
            .collect();
        values.par_sort_unstable_by(f32::total_cmp);
        let [low, high] = FRACTIONS.map(|fraction| {
            let rank = fraction * (values.len() - 1) as f64;
            let (below, above) = (values[rank.floor() as usize], values[rank.ceil() as usize]);
            (f64::from(below) + (f64::from(above) - f64::from(below)) * rank.fract()) as f32
        });
        if low < high {
            Ok(Self { low, high })
        } else {
            Err(ExtractionError::NoBrain {
                what: "nearly all voxels have the same intensity",
            })
        }
    }
}

/// A cube of stored values as the input of the network: clipped at the quantiles, with the mean and deviation of the
/// training data.
pub(super) fn image(
    volume: &Volume,
    stored: &[u16],
    side: usize,
    Quantiles { low, high }: Quantiles,
) -> Result<Tensor, ExtractionError> {
    let value = |stored: u16| {
        let intensity = volume.intensity(f32::from(stored));
        ((intensity - low) / (high - low)).clamp(0.0, 1.0)
    };
    // Every stored value occurs many times, so a look-up table replaces the arithmetic.
    let mut occurrences = vec![0u64; 1 << 16];
    for &stored in stored {
        occurrences[usize::from(stored)] += 1;
    }
    let sum = |of: &dyn Fn(f64) -> f64| -> f64 {
        let values = occurrences
            .iter()
            .zip(0..=u16::MAX)
            .filter(|&(&count, _)| count > 0);
        values
            .map(|(&count, stored)| count as f64 * of(f64::from(value(stored))))
            .sum()
    };
    let count = stored.len() as f64;
    let mean = sum(&|value| value) / count;
    let deviation = (sum(&|value| (value - mean).powi(2)) / (count - 1.0)).sqrt();
    if deviation.is_nan() || deviation <= 0.0 {
        return Err(ExtractionError::NoBrain {
            what: "all voxels where it should be have the same intensity",
        });
    }
    let table: Vec<f32> = (0..=u16::MAX)
        .map(|stored| ((f64::from(value(stored)) - mean) / deviation * DEVIATION + MEAN) as f32)
        .collect();
    let mut image = Tensor::zeros([side; 3], 1, BORDER);
    let (rows, plane) = (image.rows_in_plane(), image.plane_length());
    let planes = image.planes_mut().par_chunks_mut(plane);
    let slices = stored.par_chunks(side * side);
    planes.zip(slices).for_each(|(plane, slice)| {
        for (row, stored) in rows.iter().zip(slice.chunks_exact(side)) {
            for (value, &stored) in plane[row.clone()].iter_mut().zip(stored) {
                *value = table[usize::from(stored)];
            }
        }
    });
    Ok(image)
}
