//! The network: a three-dimensional U-shaped LinkNet with residual blocks.
//!
//! The layers are those of the published deepbet model (Fisch et al., "deepbet: Fast brain extraction of T1-weighted
//! MRI using Convolutional Neural Networks", Computers in Biology and Medicine 179:108845, 2024).

use std::ops::ControlFlow;

use rayon::prelude::*;

use super::convolution::{Convolution, Kind};
use super::normalisation::{Standardisation, max_pooled, rectified};
use super::tensor::Tensor;
use super::weights::{Parameters, Weights};
use crate::Observe;

const PLAIN: Kind = Kind::Plain { stride: 1 };
const HALVING: Kind = Kind::Plain { stride: 2 };
const DOUBLING: Kind = Kind::Transposed { stride: 2 };

/// A residual block: two convolutions with their result added to the input.
#[derive(Debug, Clone)]
struct Block {
    first: Convolution,
    second: Convolution,
    /// Maps the input to the shape of the result, if that differs.
    skip: Option<Convolution>,
}

/// Upsamples a tensor through a bottleneck of few channels.
#[derive(Debug, Clone)]
struct Decoder {
    narrow: Convolution,
    enlarge: Convolution,
    widen: Convolution,
}

/// The layers with their weights.
#[derive(Debug, Clone)]
pub(crate) struct LinkNet {
    stem: Convolution,
    /// Two per stage, in four stages.
    blocks: Vec<[Block; 2]>,
    decoders: Vec<Decoder>,
    enlarge: Convolution,
    smooth: Convolution,
    /// From the eight channels of a voxel to the log-odds of the eight voxels that it is split into.
    last: Convolution,
}

impl LinkNet {
    /// The layers with their weights, by position in the model file.
    pub(crate) fn new(weights: &Weights) -> Self {
        let plain =
            |kind, channels, number| Convolution::new(kind, channels, 3, weights.tensor(number));
        let single =
            |kind, channels, number| Convolution::new(kind, channels, 1, weights.tensor(number));
        let block = |channels, number| Block {
            first: plain(PLAIN, [channels; 2], number),
            second: plain(PLAIN, [channels; 2], number + 1),
            skip: None,
        };
        let halving = |channels: usize, number| Block {
            first: plain(HALVING, [channels / 2, channels], number),
            second: plain(PLAIN, [channels; 2], number + 1),
            skip: Some(single(HALVING, [channels / 2, channels], number + 2)),
        };
        let decoder = |kind, [inputs, outputs]: [usize; 2], number| Decoder {
            narrow: single(PLAIN, [inputs, inputs / 4], number),
            enlarge: plain(kind, [inputs / 4; 2], number + 1),
            widen: single(PLAIN, [inputs / 4, outputs], number + 2),
        };
        Self {
            stem: Convolution::new(HALVING, [1, 16], 7, weights.tensor(0)),
            blocks: vec![
                [block(16, 1), block(16, 3)],
                [halving(32, 5), block(32, 8)],
                [halving(64, 10), block(64, 13)],
                [halving(128, 15), block(128, 18)],
            ],
            decoders: vec![
                decoder(DOUBLING, [128, 64], 20),
                decoder(DOUBLING, [64, 32], 23),
                decoder(DOUBLING, [32, 16], 26),
                decoder(Kind::Transposed { stride: 1 }, [16, 16], 29),
            ],
            enlarge: Convolution::new(DOUBLING, [16, 8], 3, weights.with_bias(32)),
            smooth: Convolution::new(PLAIN, [8; 2], 3, weights.with_bias(34)),
            last: log_odds(weights.with_bias(36)),
        }
    }

    /// The probability of each voxel of a cube to belong to the brain; x-fastest.
    ///
    /// `image` has a border of three zeros, and its sides are multiples of 16.
    pub(crate) fn run(&self, image: Tensor, observe: Observe<'_>) -> ControlFlow<(), Vec<f32>> {
        observe(0.0)?;
        let (stem, sums) = self.stem.apply(&image);
        drop(image);
        let by = Standardisation::new(&sums, voxels(&stem));
        // Standardisation keeps the order of values, so pooling can come first.
        let mut here = max_pooled(&stem);
        drop(stem);
        by.apply(&mut here, rectified);

        let mut encoded = Vec::new();
        for (blocks, done) in self.blocks.iter().zip(SHARES_BEFORE_STAGES) {
            observe(done)?;
            let after_first = blocks[0].run(&here);
            observe(done)?;
            let after_second = blocks[1].run(&after_first);
            encoded.push(std::mem::replace(&mut here, after_second));
        }
        for (decoder, encoded) in self.decoders.iter().zip(encoded.iter().rev()) {
            observe(SHARE_BEFORE_DECODERS)?;
            here = decoder.run(&here, encoded);
        }
        drop(encoded);
        observe(SHARE_BEFORE_ENLARGING)?;
        let large = rectified_convolution(&self.enlarge, &here);
        observe(SHARE_BEFORE_SMOOTHING)?;
        let smooth = rectified_convolution(&self.smooth, &large);
        drop(large);
        observe(SHARE_BEFORE_LAST)?;
        ControlFlow::Continue(self.probabilities(&smooth))
    }

    /// The last layer: eight probabilities per voxel.
    fn probabilities(&self, features: &Tensor) -> Vec<f32> {
        let (odds, _) = self.last.apply(features);
        let [nx, ny, nz] = features.size();
        let mut probabilities = vec![0.0; 8 * nx * ny * nz];
        let planes = probabilities.par_chunks_mut(4 * nx * ny).enumerate();
        planes.for_each(|(z, plane)| {
            let source = &odds.planes()[z / 2 * odds.plane_length()..];
            for (y, row) in plane.chunks_exact_mut(2 * nx).enumerate() {
                let first = 2 * (y % 2) + 4 * (z % 2);
                let voxels = source[odds.row_in_plane(y / 2)].as_chunks::<8>().0;
                for (pair, voxel) in row.as_chunks_mut::<2>().0.iter_mut().zip(voxels) {
                    *pair = [voxel[first], voxel[first + 1]].map(logistic);
                }
            }
        });
        probabilities
    }
}

// The finished fraction when a part begins, from the number of multiplications.
const SHARES_BEFORE_STAGES: [f32; 4] = [0.40, 0.65, 0.76, 0.82];
const SHARE_BEFORE_DECODERS: f32 = 0.85;
const SHARE_BEFORE_ENLARGING: f32 = 0.86;
const SHARE_BEFORE_SMOOTHING: f32 = 0.90;
const SHARE_BEFORE_LAST: f32 = 0.98;

impl Block {
    fn run(&self, input: &Tensor) -> Tensor {
        let inner = rectified_convolution(&self.first, input);
        let (mut outcome, sums) = self.second.apply(&inner);
        let by = Standardisation::new(&sums, voxels(&outcome));
        let add = |value: f32, skipped: f32| rectified(value + skipped);
        match &self.skip {
            None => by.apply_with(&mut outcome, input, add),
            Some(skip) => {
                let skipped = standardised_convolution(skip, input, |value| value);
                by.apply_with(&mut outcome, &skipped, add);
            }
        }
        outcome
    }
}

impl Decoder {
    fn run(&self, input: &Tensor, encoded: &Tensor) -> Tensor {
        let narrow = rectified_convolution(&self.narrow, input);
        let large = rectified_convolution(&self.enlarge, &narrow);
        let (mut wide, sums) = self.widen.apply(&large);
        let by = Standardisation::new(&sums, voxels(&wide));
        by.apply_with(&mut wide, encoded, |value, encoded| {
            rectified(value) + encoded
        });
        wide
    }
}

/// A convolution, standardised, with negative values set to 0.
fn rectified_convolution(convolution: &Convolution, input: &Tensor) -> Tensor {
    standardised_convolution(convolution, input, rectified)
}

fn standardised_convolution(
    convolution: &Convolution,
    input: &Tensor,
    change: impl Fn(f32) -> f32 + Sync,
) -> Tensor {
    let (mut output, sums) = convolution.apply(input);
    Standardisation::new(&sums, voxels(&output)).apply(&mut output, change);
    output
}

fn voxels(tensor: &Tensor) -> usize {
    tensor.size().iter().product()
}

/// The last layer as a convolution with eight outputs, the voxels of a 2 × 2 × 2 block.
///
/// It is published as a transposed convolution of stride 2 with two classes; only their difference matters.
fn log_odds(parameters: Parameters<'_>) -> Convolution {
    let weight = |block: usize, input: usize| {
        let [x, y, z] = [block & 1, block >> 1 & 1, block >> 2];
        let of_class = |class: usize| {
            let place = (((input * 2 + class) * 2 + x) * 2 + y) * 2 + z;
            parameters.weights[place]
        };
        of_class(1) - of_class(0)
    };
    let weights: Vec<f32> = (0..8)
        .flat_map(|block| (0..8).map(move |input| weight(block, input)))
        .collect();
    let bias = [parameters.bias[1] - parameters.bias[0]; 8];
    let parameters = Parameters {
        weights: &weights,
        bias: &bias,
    };
    Convolution::new(PLAIN, [8; 2], 1, parameters)
}

/// `1 / (1 + e^-x)`, within 2⁻²², from operations with the same result on every machine.
fn logistic(log_odds: f32) -> f32 {
    1.0 / (1.0 + exponential(-log_odds.clamp(-80.0, 80.0)))
}

/// `e^x` for x from -80 to 80, with a relative error of about 2⁻²³.
fn exponential(x: f32) -> f32 {
    use std::f32::consts::LOG2_E;
    let halvings = (x * LOG2_E).round();
    // The remainder of x is within ±½ ln 2; ln 2 is split in two parts, the first with few bits.
    let rest = (x - halvings * 0.693_359_4) + halvings * 2.121_944_4e-4;
    // A Taylor series of degree 7; its next term is below 2⁻²⁶.
    let coefficients = [
        1.0 / 5040.0,
        1.0 / 720.0,
        1.0 / 120.0,
        1.0 / 24.0,
        1.0 / 6.0,
        0.5,
        1.0,
        1.0,
    ];
    let series = coefficients
        .into_iter()
        .fold(0.0, |sum: f32, coefficient| sum * rest + coefficient);
    series * f32::from_bits(((halvings as i32 + 127) as u32) << 23)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::testing::{random_tensor, value};

    #[test]
    fn the_logistic_function_is_right_to_single_precision() {
        for step in -8000..=8000 {
            let x = step as f32 / 100.0;
            let expected = 1.0 / (1.0 + (-f64::from(x)).exp());
            let found = f64::from(logistic(x));
            assert!(
                (found / expected - 1.0).abs() < 5e-7,
                "{x}: {found} {expected}"
            );
        }
        assert_eq!(logistic(0.0), 0.5);
        assert!(logistic(-1e30) < 1e-30 && logistic(1e30) == 1.0);
    }

    #[test]
    fn the_last_layer_is_a_transposed_convolution_and_a_softmax() {
        let weights = Weights::random(9);
        let network = LinkNet::new(&weights);
        let features = random_tensor([4, 3, 2], 8, 1, &mut 4);
        let found = network.probabilities(&features);
        let last = weights.with_bias(36);
        for (index, &found) in found.iter().enumerate() {
            let voxel = [index % 8, index / 8 % 6, index / 48];
            let (from, tap) = (
                voxel.map(|place| place as isize / 2),
                voxel.map(|place| place % 2),
            );
            let [outside, brain] = [0, 1].map(|class| {
                let weight = |channel: usize| {
                    let place = (channel * 2 + class) * 8 + tap[0] * 4 + tap[1] * 2 + tap[2];
                    last.weights[place] * value(&features, from, channel)
                };
                (last.bias[class] + (0..8).map(weight).sum::<f32>()).exp()
            });
            assert!(
                (found - brain / (outside + brain)).abs() < 1e-5,
                "{voxel:?}"
            );
        }
    }

    #[test]
    fn a_run_is_the_same_bytes_for_any_number_of_threads_and_stops_when_it_is_told_to() {
        let network = LinkNet::new(&Weights::random(1));
        let image = random_tensor([32; 3], 1, 3, &mut 2);
        let go_on: Observe<'_> = &|_| ControlFlow::Continue(());
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| network.run(image.clone(), &|_| ControlFlow::Continue(())))
        };
        let ControlFlow::Continue(first) = network.run(image.clone(), go_on) else {
            panic!("nobody stopped it");
        };
        assert_eq!(first.len(), 32 * 32 * 32);
        assert!(first.iter().any(|&p| p < 0.4) && first.iter().any(|&p| p > 0.6));
        for threads in [1, 3] {
            assert_eq!(on(threads), ControlFlow::Continue(first.clone()));
        }
        let stop_late: Observe<'_> = &|done| {
            if done > 0.8 {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        };
        assert_eq!(network.run(image, stop_late), ControlFlow::Break(()));
    }
}
