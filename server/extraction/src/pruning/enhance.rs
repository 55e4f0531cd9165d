//! The enhanced image, in which the brain stands out, and its gradient.

use geometry::{GeometryError, Grid, Mask, Volume};
use glam::DVec3;
use rayon::prelude::*;

use crate::ExtractionError;

/// Steps between the darkest and the brightest value of an enhanced image: 12 bits.
const WHITE: f32 = 4095.0;

/// Bins of the histogram for the threshold.
const BINS: usize = 1024;

/// The quantile of the upper end of the histogram.
const BRIGHTEST: f64 = 0.999;

/// Intensities on a grid of cubes, in two classes.
#[derive(Debug)]
pub(super) struct Intensities {
    grid: Grid,
    values: Vec<f32>,
    classes: Classes,
}

impl Intensities {
    /// The intensities of a volume on another grid, trilinear.
    pub(super) fn of(volume: &Volume, grid: &Grid) -> Result<Self, ExtractionError> {
        let values = resampled(volume, grid);
        let classes = Classes::of(&values).ok_or(ExtractionError::NoBrain {
            what: "nearly all voxels have the same intensity",
        })?;
        Ok(Self {
            grid: grid.clone(),
            values,
            classes,
        })
    }

    /// The voxels of the bright class.
    pub(super) fn bright(&self) -> Result<Mask, GeometryError> {
        self.above(self.classes.threshold)
    }

    /// The head: all voxels brighter than half-way from the mean of the dark class to the mean of the bright one.
    pub(super) fn not_air(&self) -> Result<Mask, GeometryError> {
        let Classes { threshold, dark } = self.classes;
        self.above(dark + (threshold - dark) / 2.0)
    }

    fn above(&self, threshold: f32) -> Result<Mask, GeometryError> {
        let values = self.values.par_iter();
        let voxels = values.map(|&value| value > threshold).collect();
        Mask::new(self.grid.clone(), voxels)
    }

    /// The enhanced image: 0 to 4095 along an S-shaped curve from the mean of the dark class to `white_share` of the
    /// way to the median of the marker.
    pub(super) fn enhanced(
        self,
        marker: &Mask,
        white_share: f32,
    ) -> Result<Image, ExtractionError> {
        let pairs = self.values.iter().zip(marker.voxels());
        let mut marked: Vec<f32> = pairs
            .filter_map(|(&value, &is_marked)| is_marked.then_some(value))
            .collect();
        let rank = marked.len() / 2;
        let median = *marked.select_nth_unstable_by(rank, f32::total_cmp).1;
        let dark = self.classes.dark;
        let bright = dark + white_share * (median - dark);
        let enhance = |&value: &f32| (WHITE * weight(value, [dark, bright])) as u16;
        Ok(Image {
            values: self.values.par_iter().map(enhance).collect(),
            grid: self.grid,
        })
    }
}

/// Enhanced intensities on a grid of cubes.
#[derive(Debug)]
pub(super) struct Image {
    grid: Grid,
    values: Vec<u16>,
}

impl Image {
    /// The voxels of a set in the upper half of the curve: brain. Fluid, bone and air are dark.
    pub(super) fn tissue(&self, within: Mask) -> Result<Mask, GeometryError> {
        let pairs = self.values.par_iter().zip(within.voxels());
        let voxels = pairs.map(|(&value, &is_within)| is_within && value > WHITE as u16 / 2);
        Mask::new(self.grid.clone(), voxels.collect())
    }
}

fn resampled(volume: &Volume, grid: &Grid) -> Vec<f32> {
    let [nx, ny, _] = grid.size();
    let native_from_here = volume.grid().voxel_from_patient() * grid.patient_from_voxel();
    let step = native_from_here.matrix3.x_axis;
    let mut intensities = vec![0.0; grid.voxel_count()];
    let rows = intensities.par_chunks_mut(nx).enumerate();
    rows.for_each(|(row, intensities)| {
        let start = DVec3::new(0.0, (row % ny) as f64, (row / ny) as f64);
        let start = native_from_here.transform_point3(start);
        for (x, intensity) in intensities.iter_mut().enumerate() {
            let position = (start + step * x as f64).as_vec3();
            *intensity = volume.intensity(volume.sample(position).unwrap_or(0.0));
        }
    });
    intensities
}

/// Two classes of intensities.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Classes {
    pub(crate) threshold: f32,
    /// The mean of the dark class.
    dark: f32,
}

impl Classes {
    /// The classes with the greatest between-class variance (Otsu, 1979). `None` if there is a single intensity.
    pub(crate) fn of(intensities: &[f32]) -> Option<Self> {
        let mut sorted = intensities.to_vec();
        let rank = (BRIGHTEST * (sorted.len() - 1) as f64) as usize;
        let brightest = *sorted.select_nth_unstable_by(rank, f32::total_cmp).1;
        let darkest = intensities.iter().copied().fold(f32::INFINITY, f32::min);
        let range = brightest - darkest;
        if range.is_nan() || range <= 0.0 {
            return None;
        }
        let mut counts = vec![0.0f64; BINS];
        for &intensity in intensities {
            let bin = (intensity - darkest) / range * BINS as f32;
            counts[(bin as usize).min(BINS - 1)] += 1.0;
        }
        let middle =
            |bin: usize| f64::from(darkest) + (bin as f64 + 0.5) / BINS as f64 * f64::from(range);
        let (mut count, mut sum) = (0.0, 0.0);
        let all = counts.iter().sum::<f64>();
        let whole: f64 = (0..BINS).map(|bin| counts[bin] * middle(bin)).sum();
        let (mut best, mut classes) = (0.0, None);
        for (bin, &here) in counts.iter().enumerate() {
            count += here;
            sum += here * middle(bin);
            if count == 0.0 || count == all {
                continue;
            }
            let means = [sum / count, (whole - sum) / (all - count)];
            let between = count * (all - count) * (means[1] - means[0]).powi(2);
            if between > best {
                best = between;
                classes = Some(Self {
                    threshold: (middle(bin) + f64::from(range) / BINS as f64 / 2.0) as f32,
                    dark: means[0] as f32,
                });
            }
        }
        classes
    }
}

/// An S-shaped curve of two parabolas, from 0 at the dark intensity to 1 at the bright one.
fn weight(intensity: f32, [dark, bright]: [f32; 2]) -> f32 {
    let along = ((intensity - dark) / (bright - dark)).clamp(0.0, 1.0);
    if along < 0.5 {
        2.0 * along * along
    } else {
        1.0 - 2.0 * (1.0 - along) * (1.0 - along)
    }
}

/// The gradient of an image at each voxel, in 12 bits; x-fastest.
///
/// The features of a voxel are its value and the values of its six neighbours. Beyond the grid, the nearest voxel is
/// repeated.
pub(super) fn gradient(image: &Image) -> Vec<u16> {
    let [nx, ny, nz] = image.grid.size();
    let at = |x: usize, y: usize, z: usize| i32::from(image.values[x + nx * (y + ny * z)]);
    let mut stars = vec![0i32; image.values.len()];
    stars
        .par_chunks_mut(nx)
        .enumerate()
        .for_each(|(row, stars)| {
            let (y, z) = (row % ny, row / ny);
            let (before, after) = (
                [y.saturating_sub(1), z.saturating_sub(1)],
                [(y + 1).min(ny - 1), (z + 1).min(nz - 1)],
            );
            for (x, star) in stars.iter_mut().enumerate() {
                *star = at(x, y, z)
                    + at(x.saturating_sub(1), y, z)
                    + at((x + 1).min(nx - 1), y, z)
                    + at(x, before[0], z)
                    + at(x, after[0], z)
                    + at(x, y, before[1])
                    + at(x, y, after[1]);
            }
        });
    let star = |x: usize, y: usize, z: usize| stars[x + nx * (y + ny * z)] as f32;
    let mut gradient = vec![0; stars.len()];
    gradient
        .par_chunks_mut(nx)
        .enumerate()
        .for_each(|(row, gradient)| {
            let (y, z) = (row % ny, row / ny);
            for (x, gradient) in gradient.iter_mut().enumerate() {
                let along = [
                    star((x + 1).min(nx - 1), y, z) - star(x.saturating_sub(1), y, z),
                    star(x, (y + 1).min(ny - 1), z) - star(x, y.saturating_sub(1), z),
                    star(x, y, (z + 1).min(nz - 1)) - star(x, y, z.saturating_sub(1)),
                ];
                let length = along.iter().map(|along| along * along).sum::<f32>().sqrt();
                *gradient = (length / 7.0).min(WHITE) as u16;
            }
        });
    gradient
}
