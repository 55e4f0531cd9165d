//! Three-dimensional convolutions, plain and transposed, as products of small matrices.
//!
//! With channels last, the values that an output reads from one row of its neighbourhood are adjacent in memory. A
//! convolution is then the sum, over the rows of its kernel, of products of a contiguous piece of the input with a
//! block of the weights, without copying. A transposed convolution of stride 2 is eight plain ones, one for each parity
//! of the output.
//!
//! Every output adds its products in one fixed order with fused multiply-adds, so the result is byte-identical for any
//! number of threads and on every machine.

use rayon::prelude::*;

use super::kernel::{Row, convolve_row};
use super::normalisation::Sums;
use super::tensor::Tensor;
use super::weights::Parameters;

/// How the kernel of a layer moves over its input.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// An odd kernel at every `stride`-th voxel.
    Plain {
        /// Input voxels per output voxel.
        stride: usize,
    },
    /// The adjoint of a kernel of three voxels, with `stride` output voxels per input voxel.
    Transposed {
        /// Output voxels per input voxel: 1 or 2.
        stride: usize,
    },
}

/// The input voxels of an output along an axis, relative to its position in the input.
#[derive(Debug, Clone)]
struct Reach {
    first: isize,
    /// The index of the weight in the kernel, for each of them.
    taps: Vec<usize>,
}

impl Reach {
    fn places(&self) -> std::ops::Range<isize> {
        self.first..self.first + self.taps.len() as isize
    }
}

impl Kind {
    /// The input voxels of an output of each parity along an axis.
    fn reaches(self, kernel: usize) -> Vec<Reach> {
        match self {
            Self::Plain { .. } => vec![Reach {
                first: -(kernel as isize / 2),
                taps: (0..kernel).collect(),
            }],
            Self::Transposed { stride: 1 } => vec![Reach {
                first: -1,
                taps: vec![2, 1, 0],
            }],
            // Output 2 i − 1 + k is reached from input i by weight k.
            Self::Transposed { .. } => vec![
                Reach {
                    first: 0,
                    taps: vec![1],
                },
                Reach {
                    first: 0,
                    taps: vec![2, 0],
                },
            ],
        }
    }

    fn strides(self) -> [usize; 2] {
        match self {
            Self::Plain { stride } => [stride, 1],
            Self::Transposed { stride } => [1, stride],
        }
    }
}

/// The outputs of one parity along each axis: a plain convolution.
#[derive(Debug, Clone)]
struct Phase {
    /// The first input voxel along x.
    first_x: isize,
    /// The input rows: their positions along y and z.
    rows: Vec<[isize; 2]>,
    /// The number of input values in each row.
    seen: usize,
    /// For each block of output channels, row and input value: the weight of each channel.
    weights: Vec<f32>,
}

/// A convolution with its weights.
#[derive(Debug, Clone)]
pub(crate) struct Convolution {
    kind: Kind,
    channels: [usize; 2],
    bias: Vec<f32>,
    /// By parity, x-fastest.
    phases: Vec<Phase>,
}

impl Convolution {
    /// A convolution from `channels[0]` to `channels[1]` channels with a cubic kernel of `kernel` voxels.
    ///
    /// Weights have the layout of the model file: outputs, inputs, x, y, z for a plain convolution, inputs first for a
    /// transposed one; the last is the fastest. An empty bias means none.
    ///
    /// # Panics
    /// If the number of weights or biases is wrong.
    pub(crate) fn new(
        kind: Kind,
        channels: [usize; 2],
        kernel: usize,
        parameters: Parameters<'_>,
    ) -> Self {
        let [inputs, outputs] = channels;
        let weights = parameters.weights;
        assert_eq!(weights.len(), inputs * outputs * kernel.pow(3), "weights");
        assert!(
            [0, outputs].contains(&parameters.bias.len()),
            "one bias for each output"
        );
        let weight = |output: usize, input: usize, [x, y, z]: [usize; 3]| {
            let pair = match kind {
                Kind::Plain { .. } => output * inputs + input,
                Kind::Transposed { .. } => input * outputs + output,
            };
            weights[((pair * kernel + x) * kernel + y) * kernel + z]
        };
        let reaches = kind.reaches(kernel);
        let lanes = lanes(outputs);
        let phase = |[x, y, z]: [&Reach; 3]| {
            let mut packed = Vec::new();
            for block in 0..outputs.div_ceil(lanes) {
                for [tap_z, tap_y, tap_x] in triples([&z.taps, &y.taps, &x.taps]) {
                    for input in 0..inputs {
                        packed.extend((block * lanes..(block + 1) * lanes).map(|output| {
                            if output < outputs {
                                weight(output, input, [tap_x, tap_y, tap_z])
                            } else {
                                0.0
                            }
                        }));
                    }
                }
            }
            Phase {
                first_x: x.first,
                rows: z
                    .places()
                    .flat_map(|z| y.places().map(move |y| [y, z]))
                    .collect(),
                seen: x.taps.len() * inputs,
                weights: packed,
            }
        };
        let mut phases = Vec::new();
        for z in &reaches {
            for y in &reaches {
                phases.extend(reaches.iter().map(|x| phase([x, y, z])));
            }
        }
        Self {
            kind,
            channels,
            bias: parameters.bias.to_vec(),
            phases,
        }
    }

    /// The convolution of a tensor, with a border of one zero, and the sums of each channel.
    ///
    /// # Panics
    /// If the input has another number of channels, or a border that is too narrow for the kernel.
    pub(crate) fn apply(&self, input: &Tensor) -> (Tensor, Vec<Sums>) {
        assert_eq!(input.channels(), self.channels[0], "input channels");
        let [in_stride, out_stride] = self.kind.strides();
        let size = input.size().map(|side| side * out_stride / in_stride);
        let mut output = Tensor::zeros(size, self.channels[1], 1);
        let rows = output.rows_in_plane();
        let plane = output.plane_length();
        let sums: Vec<Vec<Sums>> = output
            .planes_mut()
            .par_chunks_mut(plane)
            .enumerate()
            .map(|(z, plane)| {
                let mut sums = vec![Sums::default(); self.channels[1]];
                for (y, row) in rows.iter().enumerate() {
                    self.fill_row(input, [y, z], &mut plane[row.clone()], &mut sums);
                }
                sums
            })
            .collect();
        // In the order of the planes, whichever thread computed them.
        (output, Sums::total(&sums))
    }

    fn fill_row(&self, input: &Tensor, place: [usize; 2], row: &mut [f32], sums: &mut [Sums]) {
        let [in_stride, out_stride] = self.kind.strides();
        let [y, z] = place.map(|place| place / out_stride * in_stride);
        let parity = place.map(|place| place % out_stride);
        for x in 0..out_stride {
            let phase = &self.phases[x + out_stride * (parity[0] + out_stride * parity[1])];
            let starts: Vec<usize> = phase
                .rows
                .iter()
                .map(|[dy, dz]| input.start_of([phase.first_x, y as isize + dy, z as isize + dz]))
                .collect();
            let task = Row {
                input: input.values(),
                starts: &starts,
                step: in_stride * self.channels[0],
                seen: phase.seen,
                weights: &phase.weights,
                lanes: lanes(self.channels[1]),
                bias: &self.bias,
                outputs: self.channels[1],
                first: x,
                stride: out_stride,
            };
            convolve_row(&task, row, sums);
        }
    }
}

/// The number of output channels in a block.
fn lanes(outputs: usize) -> usize {
    if outputs > 8 { 16 } else { 8 }
}

/// All combinations; the last varies fastest.
fn triples([a, b, c]: [&[usize]; 3]) -> impl Iterator<Item = [usize; 3]> {
    a.iter().flat_map(move |&a| {
        b.iter()
            .flat_map(move |&b| c.iter().map(move |&c| [a, b, c]))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::testing::{random, random_tensor, value};

    fn weights(count: usize, state: &mut u32) -> Vec<f32> {
        (0..count).map(|_| random(state)).collect()
    }

    /// The definition, one product at a time, in double precision.
    struct Slow<'a> {
        kind: Kind,
        channels: [usize; 2],
        kernel: usize,
        parameters: Parameters<'a>,
    }

    impl Slow<'_> {
        fn at(&self, input: &Tensor, voxel: [usize; 3], output: usize) -> f64 {
            let bias = self.parameters.bias.get(output).copied().unwrap_or(0.0);
            let mut sum = f64::from(bias);
            let kernel = self.kernel;
            for tap in 0..kernel.pow(3) {
                let tap = [tap / (kernel * kernel), tap / kernel % kernel, tap % kernel];
                let Some(place) = self.seen(voxel, tap) else {
                    continue;
                };
                for channel in 0..self.channels[0] {
                    let pair = match self.kind {
                        Kind::Plain { .. } => output * self.channels[0] + channel,
                        Kind::Transposed { .. } => channel * self.channels[1] + output,
                    };
                    let weight = ((pair * kernel + tap[0]) * kernel + tap[1]) * kernel + tap[2];
                    let weight = f64::from(self.parameters.weights[weight]);
                    sum += weight * f64::from(value(input, place, channel));
                }
            }
            sum
        }

        /// The input voxel that a tap of the kernel contributes to an output.
        fn seen(&self, voxel: [usize; 3], tap: [usize; 3]) -> Option<[isize; 3]> {
            let reach = self.kernel as isize / 2;
            let along = |axis: usize| {
                let (place, tap) = (voxel[axis] as isize, tap[axis] as isize);
                match self.kind {
                    Kind::Plain { stride } => Some(place * stride as isize + tap - reach),
                    Kind::Transposed { stride } => {
                        let shifted = place + 1 - tap;
                        (shifted.rem_euclid(stride as isize) == 0)
                            .then(|| shifted.div_euclid(stride as isize))
                    }
                }
            };
            Some([along(0)?, along(1)?, along(2)?])
        }
    }

    fn assert_is_the_definition(kind: Kind, channels: [usize; 2], kernel: usize, has_bias: bool) {
        let mut state = 7;
        let input = random_tensor([12, 6, 4], channels[0], kernel / 2 + 1, &mut state);
        let kernel_weights = weights(channels[0] * channels[1] * kernel.pow(3), &mut state);
        let bias = weights(if has_bias { channels[1] } else { 0 }, &mut state);
        let parameters = Parameters {
            weights: &kernel_weights,
            bias: &bias,
        };
        let slow = Slow {
            kind,
            channels,
            kernel,
            parameters,
        };
        let (output, sums) = Convolution::new(kind, channels, kernel, parameters).apply(&input);
        let [nx, ny, nz] = output.size();
        let mut expected_sums = vec![Sums::default(); channels[1]];
        for index in 0..nx * ny * nz {
            let voxel = [index % nx, index / nx % ny, index / (nx * ny)];
            for (channel, sums) in expected_sums.iter_mut().enumerate() {
                let found = f64::from(value(&output, voxel.map(|place| place as isize), channel));
                let expected = slow.at(&input, voxel, channel);
                assert!(
                    (found - expected).abs() < 1e-4,
                    "{kind:?} {channels:?} {kernel}³ at {voxel:?}, {channel}: {found} and not {expected}"
                );
                sums.values += found;
                sums.squares += found * found;
            }
        }
        for (found, expected) in sums.iter().zip(&expected_sums) {
            assert!((found.values - expected.values).abs() < 1e-6);
            assert!((found.squares - expected.squares).abs() < 1e-6);
        }
    }

    #[test]
    fn every_kind_of_layer_is_its_definition() {
        let plain = |stride| Kind::Plain { stride };
        assert_is_the_definition(plain(1), [3, 20], 3, false);
        assert_is_the_definition(plain(1), [4, 8], 3, true);
        assert_is_the_definition(plain(2), [1, 16], 7, false);
        assert_is_the_definition(plain(2), [2, 32], 3, false);
        assert_is_the_definition(plain(1), [5, 4], 1, false);
        assert_is_the_definition(plain(2), [5, 9], 1, true);
        for stride in [1, 2] {
            let kind = Kind::Transposed { stride };
            assert_is_the_definition(kind, [3, 5], 3, true);
            assert_is_the_definition(kind, [2, 17], 3, false);
        }
    }

    #[test]
    fn the_border_of_an_output_stays_zero() {
        let mut state = 3;
        let input = random_tensor([8, 4, 4], 2, 1, &mut state);
        let kernel = weights(2 * 3 * 27, &mut state);
        let parameters = Parameters {
            weights: &kernel,
            bias: &[1.0; 3],
        };
        let convolution = Convolution::new(Kind::Plain { stride: 1 }, [2, 3], 3, parameters);
        let (output, _) = convolution.apply(&input);
        for voxel in [
            [-1, 0, 0],
            [8, 3, 3],
            [0, -1, 2],
            [5, 4, 1],
            [2, 2, -1],
            [2, 2, 4],
        ] {
            assert_eq!(
                [0, 1, 2].map(|channel| value(&output, voxel, channel)),
                [0.0; 3]
            );
        }
    }
}
