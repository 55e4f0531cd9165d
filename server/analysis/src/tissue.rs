//! The tissue scale: grey matter is 0, white matter is 1, and the bias of the coil is divided out.

use geometry::Volume;

use crate::block::{Block, Zone};
use crate::coarse::{Coarse, Pair};
use crate::head::Head;
use crate::undefined::MapsUndefined;

/// The largest voxel edge at which a blur of 1 to 2 mm is visible, in mm.
const MAX_SPACING_MM: f64 = 2.0;
/// The initial quantiles of the three classes (fluid, grey, white).
const STARTS: [f64; 3] = [0.10, 0.45, 0.80];
/// The greatest number of iterations.
const ROUNDS: usize = 30;
/// Bins of a histogram of corrected intensities.
const BINS: usize = 1 << 14;
/// The cell size of the bias field, in mm.
const BIAS_STEP_MM: f64 = 5.0;
/// The limits of one pass, relative to the mean of white matter.
const BIAS_RANGE: [f32; 2] = [0.7, 1.4];
/// The distance of the voxels from which the field is estimated, in mm; it is smooth, and one in eight is enough.
const BIAS_SAMPLE_MM: f64 = 2.0;
/// The least share of white matter under the Gaussian for an estimate of the field.
const LEAST_WHITE: f32 = 1e-3;
/// The least contrast between grey and white matter, in deviations of the noise.
const LEAST_CONTRAST: f32 = 5.0;
/// A voxel is deep white matter if its 26 neighbours are white, and everything within this many voxels and so many mm.
const DEEP_WHITE: (i64, f64) = (3, 3.9);
/// The distance of the voxels that are sampled for noise: at most so many voxels and so many mm.
const NOISE_STRIDE: (usize, f64) = (2, 2.6);
/// The fewest voxels of deep white matter for a noise estimate.
const LEAST_SAMPLES: usize = 200;

/// The intensities of the tissues of a head, after the bias is divided out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TissueScale {
    /// The mean of fluid, in tissue scale: below 0.
    pub fluid: f32,
    /// Mean intensity of grey matter.
    pub grey: f32,
    /// Mean intensity of white matter.
    pub white: f32,
    /// Standard deviation of grey matter, as a fraction of the contrast between grey and white.
    pub grey_sd: f32,
    /// Standard deviation of white matter, as a fraction of that contrast.
    pub white_sd: f32,
    /// Standard deviation of the noise, as a fraction of that contrast, from the residuals of deep white matter around
    /// its local mean.
    pub noise: f32,
}

/// How the bias of the coil is estimated from white matter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Bias {
    /// The Gaussian of each pass, in mm, and the least intensity of white matter, in tissue scale. Each pass starts from
    /// the intensities that the passes before it corrected.
    pub(crate) passes: &'static [(f64, f32)],
}

impl Bias {
    /// The standard passes. One pass is not enough if the bias is strong: white matter that is as dark as the middle
    /// between grey and white elsewhere is half left out, and looks like one large blurred junction.
    pub(crate) const STANDARD: Self = Self {
        passes: &[
            (20.0, 0.5),
            (20.0, 0.5),
            (20.0, 0.5),
            (20.0, 0.75),
            (15.0, 0.75),
            (15.0, 0.75),
        ],
    };
}

/// The block of a head that contains its brain, the tissue scale of each voxel of it (grey matter 0, white matter 1, without the
/// bias of the coil), and the parameters of that scale.
///
/// # Errors
/// If the voxels, the contrast or the envelope are unsuitable.
pub fn tissue_of(head: Head<'_>) -> Result<(Block, Vec<f32>, TissueScale), MapsUndefined> {
    let spacing_mm = head.volume.grid().spacing_mm();
    let largest_mm = spacing_mm.into_iter().fold(0.0, f64::max);
    if largest_mm > MAX_SPACING_MM + 1e-6 {
        return Err(MapsUndefined::CoarseVoxels { largest_mm });
    }
    let block = Block::new(head.volume, head.depth).ok_or(MapsUndefined::NothingDeep)?;
    match tissue_scale(head.volume, &block, &Bias::STANDARD) {
        Ok((values, tissue)) => Ok((block, values, tissue)),
        // The tissues are not seen because much of what is called brain is not in the volume.
        Err(reason) => Err(match empty_share(head.volume, &block) {
            share if share > MAX_EMPTY_SHARE => MapsUndefined::EmptyVolume { share },
            _ => reason,
        }),
    }
}

/// The share of the mask from which it is the reason why tissues are not seen that the volume is empty there.
const MAX_EMPTY_SHARE: f64 = 0.2;

/// The share of the voxels of tissue that have the least value of the volume.
fn empty_share(volume: &Volume, block: &Block) -> f64 {
    let least = volume.voxels().iter().copied().min().unwrap_or_default();
    let (mut all, mut empty) = (0u32, 0u32);
    for number in 0..block.size[1] * block.size[2] {
        let zones = block.zones[number * block.size[0]..].iter();
        for (&stored, _) in
            (block.row(volume, number).iter().zip(zones)).filter(|(_, zone)| **zone >= Zone::Tissue)
        {
            all += 1;
            empty += u32::from(stored == least);
        }
    }
    f64::from(empty) / f64::from(all.max(1))
}

/// The tissue scale of each voxel of a block, and its parameters.
///
/// # Errors
/// If the block does not have two tissues that differ by more than the noise.
pub(crate) fn tissue_scale(
    volume: &Volume,
    block: &Block,
    bias: &Bias,
) -> Result<(Vec<f32>, TissueScale), MapsUndefined> {
    let mut values = intensities(volume, block);
    divide_by_bias(&mut values, block, bias)?;
    let classes = classes(&values, &block.zones)?;
    let [fluid, grey, white] = classes.means;
    let contrast = white - grey;
    for value in &mut values {
        *value = (*value - grey) / contrast;
    }
    let noise = noise(&values, block)?;
    if noise * LEAST_CONTRAST > 1.0 {
        return Err(MapsUndefined::LowContrast {
            contrast: 1.0 / noise,
        });
    }
    let scale = TissueScale {
        fluid: (fluid - grey) / contrast,
        grey,
        white,
        grey_sd: classes.sds[1] / contrast,
        white_sd: classes.sds[2] / contrast,
        noise,
    };
    Ok((values, scale))
}

fn intensities(volume: &Volume, block: &Block) -> Vec<f32> {
    let mut values = Vec::with_capacity(block.voxel_count());
    for number in 0..block.size[1] * block.size[2] {
        let row = block.row(volume, number).iter();
        values.extend(row.map(|&stored| volume.intensity(f32::from(stored))));
    }
    values
}

/// Means and standard deviations of fluid, grey and white matter.
#[derive(Debug, Clone, Copy)]
struct Classes {
    means: [f32; 3],
    sds: [f32; 3],
}

/// A histogram with bins of equal width and exact sums.
struct Histogram {
    counts: Vec<f64>,
    sums: Vec<f64>,
    squares: Vec<f64>,
}

impl Histogram {
    fn new(values: &[f32], zones: &[Zone]) -> Option<Self> {
        let tissue = || {
            let voxels = values.iter().zip(zones);
            voxels.filter_map(|(&value, &zone)| (zone >= Zone::Tissue).then_some(value))
        };
        let (least, most) = tissue().fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), value| {
            (a.min(value), b.max(value))
        });
        let bins_a_unit = BINS as f32 / (most - least);
        if !bins_a_unit.is_finite() || bins_a_unit <= 0.0 {
            return None;
        }
        let mut histogram = Self {
            counts: vec![0.0; BINS],
            sums: vec![0.0; BINS],
            squares: vec![0.0; BINS],
        };
        for value in tissue() {
            let bin = (((value - least) * bins_a_unit) as usize).min(BINS - 1);
            let value = f64::from(value);
            histogram.counts[bin] += 1.0;
            histogram.sums[bin] += value;
            histogram.squares[bin] += value * value;
        }
        Some(histogram)
    }

    /// The mean of the bin at a quantile.
    fn percentile(&self, share: f64) -> f64 {
        let wanted = share * self.counts.iter().sum::<f64>();
        let mut below = 0.0;
        let bin = self.counts.iter().position(|count| {
            below += count;
            below >= wanted && *count > 0.0
        });
        bin.map_or(f64::NAN, |bin| self.sums[bin] / self.counts[bin])
    }

    /// Count, sum and sum of squares of the values nearest to each mean; means ascend.
    fn nearest(&self, means: [f64; 3]) -> [[f64; 3]; 3] {
        let borders = [(means[0] + means[1]) / 2.0, (means[1] + means[2]) / 2.0];
        let mut totals = [[0.0; 3]; 3];
        for (bin, &count) in self.counts.iter().enumerate() {
            if count > 0.0 {
                let mean = self.sums[bin] / count;
                let class = borders.iter().filter(|&&border| mean >= border).count();
                totals[class][0] += count;
                totals[class][1] += self.sums[bin];
                totals[class][2] += self.squares[bin];
            }
        }
        totals
    }
}

/// The three tissue classes of some voxels, by Lloyd's algorithm.
fn classes(values: &[f32], zones: &[Zone]) -> Result<Classes, MapsUndefined> {
    let none = MapsUndefined::LowContrast { contrast: 0.0 };
    let histogram = Histogram::new(values, zones).ok_or(none)?;
    let mut means = STARTS.map(|share| histogram.percentile(share));
    let mut totals = histogram.nearest(means);
    for _ in 0..ROUNDS {
        let next = totals.map(|[count, sum, _]| sum / count);
        if next == means {
            break;
        }
        means = next;
        totals = histogram.nearest(means);
    }
    let sd = |class: usize| {
        let [count, sum, squares] = totals[class];
        (squares / count - (sum / count).powi(2)).max(0.0).sqrt() as f32
    };
    let is_ordered = means[0] < means[1] && means[1] < means[2];
    is_ordered
        .then(|| Classes {
            means: means.map(|mean| mean as f32),
            sds: [sd(0), sd(1), sd(2)],
        })
        .ok_or(none)
}

/// Divides intensities by the local mean of the white matter relative to its mean in the whole head.
fn divide_by_bias(values: &mut [f32], block: &Block, bias: &Bias) -> Result<(), MapsUndefined> {
    let sample = Sample::of(values, block);
    let mut corrected = sample.values.clone();
    let mut field = vec![[1.0, 0.0]; sample.coarse.size.iter().product()];
    for &(sigma_mm, white_from) in bias.passes {
        let classes = classes(&corrected, &sample.zones)?;
        let [_, grey, white] = classes.means;
        let bounds = (
            grey + white_from * (white - grey),
            white + 3.0 * classes.sds[2],
        );
        let means = sample.coarse.means(|index| {
            let value = corrected[index];
            let is_tissue = sample.zones[index] >= Zone::Tissue;
            let is_white = is_tissue && value > bounds.0 && value < bounds.1;
            if is_white { [value, 1.0] } else { [0.0; 2] }
        });
        let smoothed = sample.coarse.smoothed(&means, sigma_mm);
        for ([field, _], [sum, weight]) in field.iter_mut().zip(smoothed) {
            if weight > LEAST_WHITE {
                *field *= (sum / weight / white).clamp(BIAS_RANGE[0], BIAS_RANGE[1]);
            }
        }
        corrected.copy_from_slice(&sample.values);
        divide(&mut corrected, &sample.coarse, &field);
    }
    divide(
        values,
        &sample.coarse.refined(block.size, sample.strides),
        &field,
    );
    Ok(())
}

/// Divides the voxels of a grid by a field of its cells.
fn divide(values: &mut [f32], coarse: &Coarse, field: &[Pair]) {
    let (along_row, mut mixed) = (coarse.along_row(), Vec::new());
    for (number, row) in values.chunks_exact_mut(along_row.len()).enumerate() {
        coarse.mixed_row(field, number, &mut mixed);
        for (value, between) in row.iter_mut().zip(&along_row) {
            *value /= between.of_row(&mixed)[0];
        }
    }
}

/// Every few voxels of a block.
struct Sample {
    strides: [usize; 3],
    values: Vec<f32>,
    zones: Vec<Zone>,
    /// Cells of the sample.
    coarse: Coarse,
}

impl Sample {
    fn of(values: &[f32], block: &Block) -> Self {
        let strides = block
            .in_voxels(BIAS_SAMPLE_MM)
            .map(|stride| (stride.round() as usize).max(1));
        let size = [0, 1, 2].map(|axis| block.size[axis].div_ceil(strides[axis]));
        let spacing_mm = [0, 1, 2].map(|axis| block.spacing_mm[axis] * strides[axis] as f64);
        let along = |axis: usize| (0..block.size[axis]).step_by(strides[axis]);
        let indices = along(2).flat_map(|z| {
            along(1).flat_map(move |y| along(0).map(move |x| block.grid.index([x, y, z])))
        });
        let (values, zones) = indices
            .map(|index| (values[index], block.zones[index]))
            .unzip();
        Self {
            strides,
            values,
            zones,
            coarse: Coarse::new(size, spacing_mm, BIAS_STEP_MM),
        }
    }
}

/// The standard deviation of the noise in tissue scale, from deep white matter.
fn noise(values: &[f32], block: &Block) -> Result<f32, MapsUndefined> {
    let [nx, ny, nz] = block.size.map(|side| side as i64);
    let index = |[x, y, z]: [i64; 3]| (x + nx * (y + ny * z)) as usize;
    let (margin, margin_mm) = DEEP_WHITE;
    let stride = |axis: usize| {
        let (most, most_mm) = NOISE_STRIDE;
        ((most_mm / block.spacing_mm[axis] + 1e-6) as usize).clamp(1, most)
    };
    let strides = [0, 1, 2].map(stride);
    let along = |axis: usize, side: i64| (margin..side - margin).step_by(strides[axis]);
    let is_within = |offset: &[i64; 3]| {
        let voxels = offset.iter().map(|along| along.abs());
        let mm = [0, 1, 2].map(|axis| offset[axis].abs() as f64 * block.spacing_mm[axis]);
        let is_neighbour = voxels.clone().all(|along| along <= 1);
        is_neighbour || voxels.sum::<i64>() <= margin && mm.iter().sum::<f64>() <= margin_mm + 1e-6
    };
    let offsets: Vec<[i64; 3]> = cube(margin).filter(is_within).collect();
    let around: Vec<[i64; 3]> = cube(1).collect();
    let moved = |voxel: [i64; 3], by: &[i64; 3]| [0, 1, 2].map(|axis| voxel[axis] + by[axis]);
    let is_white = |voxel: [i64; 3]| {
        let index = index(voxel);
        values[index] > 0.8 && block.zones[index] >= Zone::Tissue
    };
    let mut residuals = Vec::new();
    for voxel in along(2, nz)
        .flat_map(|z| along(1, ny).flat_map(move |y| along(0, nx).map(move |x| [x, y, z])))
    {
        if is_white(voxel) && offsets.iter().all(|offset| is_white(moved(voxel, offset))) {
            let sum: f32 = around
                .iter()
                .map(|by| values[index(moved(voxel, by))])
                .sum();
            residuals.push((values[index(voxel)] - sum / 27.0).abs());
        }
    }
    if residuals.len() < LEAST_SAMPLES {
        return Err(without_noise(residuals.len(), block));
    }
    let middle = residuals.len() / 2;
    let median = *residuals.select_nth_unstable_by(middle, f32::total_cmp).1;
    // The median and the mean of the absolute residuals of a Gaussian, relative to its deviation. White matter that was
    // stored as a single number has a median of 0.
    let mean = residuals.iter().sum::<f32>() / residuals.len() as f32;
    let deviation = f32::max(1.4826 * median, 0.5 * 1.2533 * mean);
    Ok(deviation / (1.0f32 - 1.0 / 27.0).sqrt())
}

/// Why there is no estimate of the noise: large voxels leave few that lie within white matter, fine ones do not.
fn without_noise(samples: usize, block: &Block) -> MapsUndefined {
    let largest_mm = block.spacing_mm.into_iter().fold(0.0, f64::max);
    if largest_mm <= DEEP_WHITE.1 / DEEP_WHITE.0 as f64 + 1e-6 {
        return MapsUndefined::NoWhiteMatter;
    }
    MapsUndefined::NoiseUnknown {
        samples,
        needed: LEAST_SAMPLES,
        largest_mm,
    }
}

fn cube(reach: i64) -> impl Iterator<Item = [i64; 3]> {
    let along = move || -reach..=reach;
    along().flat_map(move |z| along().flat_map(move |y| along().map(move |x| [x, y, z])))
}
