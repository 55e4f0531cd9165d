//! Normalised mutual information of the case and the layer, and its gradient by the pose.

use glam::{DAffine3, DMat3, DVec3, Mat3, Vec3};

use super::image::Image;
use super::pose::{Motion, Pose};
use super::samples::{Range, Samples};
use crate::MidsagittalPlane;

/// Bins of each intensity.
pub(super) const BINS: usize = 48;
/// Bins at either end of the intensities of the layer that only its Parzen window reaches.
const ENDS: f32 = 1.5;
/// The fewest points for a meaningful histogram.
const LEAST_PLACES: usize = 500;

/// The points of the case and the intensities of the layer, both at one resolution.
pub(super) struct Comparison {
    samples: Samples,
    size: [usize; 3],
    /// The intensities of the layer, in bins.
    values: Vec<f32>,
    voxel_from_layer: DAffine3,
    is_flat: bool,
}

/// The mutual information of two volumes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Score {
    /// `(H(case) + H(layer)) / H(case, layer)`: 1 for none, 2 for complete.
    pub(super) nmi: f64,
    /// The fraction of the points that the layer covers.
    pub(super) overlap: f64,
}

impl Score {
    const NOTHING: Self = Self {
        nmi: 1.0,
        overlap: 0.0,
    };
}

/// The frequency of each pair of bins.
pub(super) struct Joint {
    counts: Vec<f64>,
    total: f64,
}

/// The data of a point that the gradient needs after the histogram.
struct Met {
    sample: u32,
    bin: f32,
    /// The derivative of the bin by the voxel coordinates of the layer.
    slope: Vec3,
}

impl Comparison {
    pub(super) fn new(samples: Samples, layer: &Image, range: Range) -> Self {
        let is_flat = samples.are_flat || range.is_flat();
        let bins = BINS as f32 - 1.0 - 2.0 * ENDS;
        let bin = |&value: &f32| ENDS + range.share(value) * bins;
        Self {
            samples,
            size: layer.size,
            values: layer.values.iter().map(bin).collect(),
            voxel_from_layer: layer.patient_from_voxel.inverse(),
            is_flat,
        }
    }

    /// Whether one of the volumes has a single intensity where both are defined.
    pub(super) fn is_flat(&self) -> bool {
        self.is_flat
    }

    /// The same comparison with the case mirrored at a plane.
    pub(super) fn mirrored(mut self, centre: DVec3, plane: &MidsagittalPlane) -> Self {
        for place in &mut self.samples.places {
            *place = (plane.reflected(place.as_dvec3() + centre) - centre).as_vec3();
        }
        self
    }

    pub(super) fn places(&self) -> &[Vec3] {
        &self.samples.places
    }

    fn transform(&self, pose: Pose) -> (Mat3, Vec3) {
        let (linear, target) = pose.parts();
        let linear = self.voxel_from_layer.matrix3 * linear;
        (
            linear.as_mat3(),
            self.voxel_from_layer.transform_point3(target).as_vec3(),
        )
    }

    pub(super) fn score(&self, pose: Pose) -> Score {
        self.joint(pose).score(self.samples.places.len())
    }

    pub(super) fn joint(&self, pose: Pose) -> Joint {
        let (linear, target) = self.transform(pose);
        let mut joint = Joint::new();
        for (&place, &case_bin) in self.samples.places.iter().zip(&self.samples.bins) {
            if let Some(bin) = self.value(linear * place + target) {
                joint.add(case_bin, bin);
            }
        }
        joint
    }

    /// The score, and the gradient of the mutual information by turns and strains of the case about the centre and by its shifts.
    pub(super) fn score_and_slope(&self, pose: Pose) -> (Score, Motion) {
        let (linear, target) = self.transform(pose);
        let mut joint = Joint::new();
        let mut met = Vec::with_capacity(self.samples.places.len());
        for (sample, (&place, &case_bin)) in self
            .samples
            .places
            .iter()
            .zip(&self.samples.bins)
            .enumerate()
        {
            if let Some((bin, slope)) = self.value_and_slope(linear * place + target) {
                joint.add(case_bin, bin);
                met.push(Met {
                    sample: sample as u32,
                    bin,
                    slope,
                });
            }
        }
        let score = joint.score(self.samples.places.len());
        if score == Score::NOTHING {
            return (score, Motion::default());
        }
        let worth = joint.worth_of_a_count();
        let (mut force, mut moment) = (Vec3::ZERO, Mat3::ZERO);
        let (mut force_sum, mut moment_sum) = (DVec3::ZERO, DMat3::ZERO);
        // Single precision within blocks, double between them.
        for block in met.chunks(256) {
            for place in block {
                let sample = place.sample as usize;
                let row = &worth[usize::from(self.samples.bins[sample]) * BINS..][..BINS];
                let (first, weights) = parzen_slopes(place.bin);
                let weight: f32 = (0..4).map(|tap| weights[tap] * row[first + tap]).sum();
                let pull = place.slope * weight;
                let position = self.samples.places[sample];
                force += pull;
                moment += Mat3::from_cols(pull * position.x, pull * position.y, pull * position.z);
            }
            force_sum += force.as_dvec3();
            moment_sum += moment.as_dmat3();
            (force, moment) = (Vec3::ZERO, Mat3::ZERO);
        }
        let to_case = linear.as_dmat3().transpose();
        let moment = to_case * moment_sum;
        // The sum of position × pull.
        let turn = DVec3::new(
            moment.y_axis.z - moment.z_axis.y,
            moment.z_axis.x - moment.x_axis.z,
            moment.x_axis.y - moment.y_axis.x,
        );
        let slope = Motion {
            turn,
            shift: to_case * force_sum,
            stretch: DVec3::new(moment.x_axis.x, moment.y_axis.y, moment.z_axis.z),
            shear: DVec3::new(
                moment.y_axis.z + moment.z_axis.y,
                moment.z_axis.x + moment.x_axis.z,
                moment.x_axis.y + moment.y_axis.x,
            ),
        };
        (score, slope)
    }

    /// The bin of the layer at a position in its voxels; `None` beyond the outermost voxel centres.
    #[inline]
    pub(super) fn value(&self, place: Vec3) -> Option<f32> {
        self.value_and_slope(place).map(|(value, _)| value)
    }

    #[inline]
    fn value_and_slope(&self, place: Vec3) -> Option<(f32, Vec3)> {
        let [nx, ny, nz] = self.size;
        let last = Vec3::new(nx as f32 - 1.0, ny as f32 - 1.0, nz as f32 - 1.0);
        if !(place.cmpge(Vec3::ZERO).all() && place.cmplt(last).all()) {
            return None;
        }
        // Truncation of a non-negative number is its floor, in one instruction.
        let [x, y, z] = [place.x as u32, place.y as u32, place.z as u32];
        let part = place - Vec3::new(x as f32, y as f32, z as f32);
        let start = x as usize + nx * (y as usize + ny * z as usize);
        let cell = &self.values[start..start + nx * (ny + 1) + 2];
        let pair = |offset: usize| {
            let [low, high] = [cell[offset], cell[offset + 1]];
            (low + (high - low) * part.x, high - low)
        };
        let [(a, ax), (b, bx)] = [pair(0), pair(nx)];
        let [(c, cx), (d, dx)] = [pair(nx * ny), pair(nx * (ny + 1))];
        let between = |low: f32, high: f32, part: f32| low + (high - low) * part;
        let [low, high] = [between(a, b, part.y), between(c, d, part.y)];
        let slope = Vec3::new(
            between(between(ax, bx, part.y), between(cx, dx, part.y), part.z),
            between(b - a, d - c, part.z),
            high - low,
        );
        Some((between(low, high, part.z), slope))
    }

    /// How well each block of points fits the joint histogram of all points if it alone is shifted. Points that are not
    /// covered do not count.
    pub(super) fn fit_of_blocks(&self, fit: &Fit, pose: Pose, blocks: &Blocks) -> Vec<BlockFit> {
        let (linear, target) = self.transform(pose);
        let mut fits = vec![BlockFit::default(); blocks.shifts.len()];
        let samples = self.samples.places.iter().zip(&self.samples.bins);
        for ((&place, &case_bin), &block) in samples.zip(&blocks.of_place).step_by(PLACES_PASSED) {
            let block = usize::from(block);
            let position = place + blocks.shifts[block];
            if let Some(bin) = self.value(linear * position + target) {
                fits[block].sum += f64::from(fit.at(case_bin, bin));
                fits[block].count += 1.0;
            }
        }
        fits
    }
}

/// The stride of the points for the fit of blocks.
pub(super) const PLACES_PASSED: usize = 2;

/// The block of each point, and the shift of each block (mm, in the case).
pub(super) struct Blocks {
    pub(super) of_place: Vec<u16>,
    pub(super) shifts: Vec<Vec3>,
}

impl BlockFit {
    /// The mean information of a point.
    pub(super) fn mean(self) -> f64 {
        if self.count > 0.0 {
            self.sum / self.count
        } else {
            0.0
        }
    }
}

/// The sum of the information of its points, and their number.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct BlockFit {
    pub(super) sum: f64,
    pub(super) count: f64,
}

/// The pointwise mutual information of a pair of bins.
pub(super) struct Fit(Vec<f32>);

impl Fit {
    fn at(&self, case_bin: u8, bin: f32) -> f32 {
        let row = &self.0[usize::from(case_bin) * BINS..][..BINS];
        let (first, weights) = parzen(bin);
        (0..4).map(|tap| weights[tap] * row[first + tap]).sum()
    }
}

impl Joint {
    fn new() -> Self {
        Self {
            counts: vec![0.0; BINS * BINS],
            total: 0.0,
        }
    }

    #[inline]
    fn add(&mut self, case_bin: u8, bin: f32) {
        let (first, weights) = parzen(bin);
        let row = &mut self.counts[usize::from(case_bin) * BINS + first..][..4];
        for (count, weight) in row.iter_mut().zip(weights) {
            *count += f64::from(weight);
        }
        self.total += 1.0;
    }

    /// The marginal frequencies of the bins of the case and of the layer.
    fn margins(&self) -> [[f64; BINS]; 2] {
        let (mut case, mut layer) = ([0.0; BINS], [0.0; BINS]);
        for (row, case_share) in self.counts.chunks_exact(BINS).zip(&mut case) {
            for (count, layer_share) in row.iter().zip(&mut layer) {
                let share = count / self.total;
                *case_share += share;
                *layer_share += share;
            }
        }
        [case, layer]
    }

    fn entropies(&self) -> [f64; 3] {
        let [case, layer] = self.margins();
        let joint = self.counts.iter().map(|count| count / self.total);
        [
            entropy(case.into_iter()),
            entropy(layer.into_iter()),
            entropy(joint),
        ]
    }

    fn score(&self, places: usize) -> Score {
        if (self.total as usize) < LEAST_PLACES {
            return Score::NOTHING;
        }
        let [case, layer, joint] = self.entropies();
        let nmi = if joint > 0.0 {
            (case + layer) / joint
        } else {
            1.0
        };
        Score {
            nmi,
            overlap: self.total / places as f64,
        }
    }

    /// The derivative of the normalised mutual information by the count of each pair of bins, with the total and the
    /// bins of the case fixed.
    fn worth_of_a_count(&self) -> Vec<f32> {
        let [case, layer, joint] = self.entropies();
        let [_, layer_shares] = self.margins();
        let worth = |(pair, count): (usize, &f64)| {
            let of_layer = -logarithm(layer_shares[pair % BINS]) * joint;
            let of_joint = logarithm(count / self.total) * (case + layer);
            ((of_layer + of_joint) / (joint * joint * self.total)) as f32
        };
        self.counts.iter().enumerate().map(worth).collect()
    }

    /// The information of each pair of bins. A pair that never occurs gets a small frequency.
    pub(super) fn fit(&self) -> Fit {
        let [case, layer] = self.margins();
        let rare = 1.0 / self.total;
        let told = |(pair, count): (usize, &f64)| {
            let expected = case[pair / BINS] * layer[pair % BINS];
            ((count / self.total + rare) / (expected + rare)).ln() as f32
        };
        Fit(self.counts.iter().enumerate().map(told).collect())
    }
}

fn entropy(shares: impl Iterator<Item = f64>) -> f64 {
    -shares.map(|share| share * logarithm(share)).sum::<f64>()
}

/// Zero for zero: a pair that does not occur adds nothing.
fn logarithm(share: f64) -> f64 {
    if share > 0.0 { share.ln() } else { 0.0 }
}

/// The cubic B-spline at the four bins around a value, and the first of them.
#[inline]
fn parzen(bin: f32) -> (usize, [f32; 4]) {
    let whole = bin as u32;
    let (first, t) = (whole as usize - 1, bin - whole as f32);
    let s = 1.0 - t;
    let weights = [
        s * s * s / 6.0,
        2.0 / 3.0 - t * t * (1.0 - t / 2.0),
        2.0 / 3.0 - s * s * (1.0 - s / 2.0),
        t * t * t / 6.0,
    ];
    (first, weights)
}

/// The derivatives of those weights by the value.
#[inline]
fn parzen_slopes(bin: f32) -> (usize, [f32; 4]) {
    let whole = bin as u32;
    let (first, t) = (whole as usize - 1, bin - whole as f32);
    let s = 1.0 - t;
    let slopes = [
        -s * s / 2.0,
        t * (1.5 * t - 2.0),
        s * (2.0 - 1.5 * s),
        t * t / 2.0,
    ];
    (first, slopes)
}
