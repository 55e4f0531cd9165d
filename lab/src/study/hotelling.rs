//! A channelised Hotelling observer (O2) for a known place.
//!
//! It sees a round patch of a view through six Laguerre–Gauss channels; the patch is centred on the nearest junction. It
//! weights the channels by a linear template, which is the difference of the means with and without a lesion, divided by
//! the covariance within both. Training and judgement use different heads.

use serde::{Deserialize, Serialize};

/// The number of channels.
pub const CHANNELS: usize = 6;
/// The width of the channels, in radii of the lesion.
pub(crate) const WIDTH: f64 = 1.5;
/// The radius of a patch and the distance of its points, in widths.
const RADIUS: f64 = 2.0;
const STEP: f64 = 0.1;
/// The part of the mean variance that is added to each variance, so that the covariance has an inverse.
const RIDGE: f64 = 1e-6;

/// The outputs of the channels for one patch.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Outputs(pub [f32; CHANNELS]);

impl Outputs {
    pub(crate) const NONE: Self = Self([0.0; CHANNELS]);

    pub(crate) fn plus(self, other: Self, factor: f32) -> Self {
        Self(std::array::from_fn(|n| self.0[n] + factor * other.0[n]))
    }
}

/// The points of a round patch, with the weights of the channels.
pub(crate) struct Patch {
    /// In widths from the centre.
    pub(crate) offsets: Vec<[f64; 2]>,
    weights: Vec<[f64; CHANNELS]>,
}

impl Patch {
    pub(crate) fn new() -> Self {
        let reach = (RADIUS / STEP) as i32;
        let along = |number: i32| f64::from(number) * STEP;
        let all = (-reach..=reach).flat_map(|v| (-reach..=reach).map(move |u| [u, v].map(along)));
        let offsets: Vec<[f64; 2]> = all
            .filter(|[u, v]| u * u + v * v <= RADIUS * RADIUS)
            .collect();
        let weights = offsets.iter().map(|[u, v]| channels(u * u + v * v));
        Self {
            weights: weights.collect(),
            offsets,
        }
    }

    /// The outputs for the values at the points of a patch, in the order of `offsets`.
    pub(crate) fn outputs(&self, values: impl IntoIterator<Item = f32>) -> Outputs {
        let mut sums = [0.0; CHANNELS];
        for (value, weights) in values.into_iter().zip(&self.weights) {
            for (sum, weight) in sums.iter_mut().zip(weights) {
                *sum += weight * f64::from(value) * STEP * STEP;
            }
        }
        Outputs(sums.map(|sum| sum as f32))
    }
}

/// The Laguerre–Gauss functions at a squared distance in widths: orthonormal in the plane.
fn channels(squared: f64) -> [f64; CHANNELS] {
    let x = std::f64::consts::TAU * squared;
    let envelope = std::f64::consts::SQRT_2 * (-0.5 * x).exp();
    let mut polynomials = [1.0; CHANNELS];
    polynomials[1] = 1.0 - x;
    for n in 2..CHANNELS {
        let before = n as f64 - 1.0;
        polynomials[n] = ((2.0 * before + 1.0 - x) * polynomials[n - 1]
            - before * polynomials[n - 2])
            / (before + 1.0);
    }
    polynomials.map(|polynomial| envelope * polynomial)
}

/// The patches of one head with and without lesions.
#[derive(Debug, Clone, Default)]
pub(crate) struct Group {
    pub(crate) with: Vec<Outputs>,
    pub(crate) without: Vec<Outputs>,
}

/// The weights of the channels.
pub(crate) struct Template([f64; CHANNELS]);

impl Template {
    /// Trained on heads, each of which counts by its own means, so that a difference between heads is no signal. `None`
    /// if there are too few patches.
    pub(crate) fn trained<'a>(heads: impl IntoIterator<Item = &'a Group>) -> Option<Self> {
        let mut signal = [0.0; CHANNELS];
        let mut covariance = [[0.0; CHANNELS]; CHANNELS];
        let (mut freedom, mut count) = (0usize, 0.0);
        for head in heads {
            if head.with.is_empty() || head.without.is_empty() {
                continue;
            }
            let [with, without] = [&head.with, &head.without].map(|patches| {
                let mean = mean(patches);
                for patch in patches {
                    let apart: [f64; CHANNELS] =
                        std::array::from_fn(|n| f64::from(patch.0[n]) - mean[n]);
                    for (row, a) in covariance.iter_mut().zip(apart) {
                        for (sum, b) in row.iter_mut().zip(apart) {
                            *sum += a * b;
                        }
                    }
                }
                freedom += patches.len() - 1;
                mean
            });
            for n in 0..CHANNELS {
                signal[n] += with[n] - without[n];
            }
            count += 1.0;
        }
        if freedom <= CHANNELS {
            return None;
        }
        let mut trace = 0.0;
        for (n, row) in covariance.iter_mut().enumerate() {
            for sum in row.iter_mut() {
                *sum /= freedom as f64;
            }
            trace += row[n];
        }
        for (n, row) in covariance.iter_mut().enumerate() {
            row[n] += (trace * RIDGE / CHANNELS as f64).max(f64::MIN_POSITIVE);
        }
        Some(Self(solved(covariance, signal.map(|sum| sum / count))))
    }

    pub(crate) fn score(&self, patch: &Outputs) -> f64 {
        let products = self.0.iter().zip(patch.0).map(|(a, b)| a * f64::from(b));
        products.sum()
    }
}

fn mean(patches: &[Outputs]) -> [f64; CHANNELS] {
    let sum = |n: usize| {
        patches
            .iter()
            .map(|patch| f64::from(patch.0[n]))
            .sum::<f64>()
    };
    std::array::from_fn(|n| sum(n) / patches.len() as f64)
}

/// The solution of a system with a positive definite matrix.
fn solved(mut matrix: [[f64; CHANNELS]; CHANNELS], mut right: [f64; CHANNELS]) -> [f64; CHANNELS] {
    for pivot in 0..CHANNELS {
        let own = matrix[pivot];
        for row in pivot + 1..CHANNELS {
            let factor = matrix[row][pivot] / own[pivot];
            for (value, above) in matrix[row].iter_mut().zip(own) {
                *value -= factor * above;
            }
            right[row] -= factor * right[pivot];
        }
    }
    for row in (0..CHANNELS).rev() {
        let known: f64 = (row + 1..CHANNELS).map(|n| matrix[row][n] * right[n]).sum();
        right[row] = (right[row] - known) / matrix[row][row];
    }
    right
}

/// The area under the curve: how often a score with a lesion exceeds one without; equal ones count half.
pub(crate) fn area(with: &[f64], without: &[f64]) -> f64 {
    let pairs = with
        .iter()
        .flat_map(|a| without.iter().map(move |b| (a, b)));
    let wins = pairs.map(|(a, b)| f64::from(u8::from(a > b)) + f64::from(u8::from(a >= b)));
    wins.sum::<f64>() / (2 * with.len() * without.len()).max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::random::Random;

    /// Patches of white noise with a deviation of 1, with and without a signal.
    fn head(patch: &Patch, signal: &[f64], count: usize, random: &mut Random) -> Group {
        let mut patches = |share: f64| {
            let patches = (0..count).map(|_| {
                let values = signal
                    .iter()
                    .map(|value| (share * value + random.normal()) as f32);
                patch.outputs(values.collect::<Vec<_>>())
            });
            patches.collect::<Vec<_>>()
        };
        Group {
            with: patches(1.0),
            without: patches(0.0),
        }
    }

    fn judged(template: &Template, head: &Group) -> f64 {
        let scores = |patches: &[Outputs]| -> Vec<f64> {
            patches.iter().map(|patch| template.score(patch)).collect()
        };
        area(&scores(&head.with), &scores(&head.without))
    }

    /// The share of a normal distribution below a value.
    fn normal_below(value: f64) -> f64 {
        let step = 1e-3;
        let density = |x: f64| (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt();
        let steps = (value / step).round() as usize;
        0.5 + (0..steps)
            .map(|n| density((n as f64 + 0.5) * step) * step)
            .sum::<f64>()
    }

    #[test]
    fn a_known_signal_in_white_noise_is_seen_as_well_as_by_the_ideal_observer() {
        let patch = Patch::new();
        let mut random = Random::new(11);
        // A disc of the radius of the lesion with a soft edge.
        let profile = patch.offsets.iter().map(|[u, v]| {
            let radius = (u * u + v * v).sqrt() * WIDTH;
            1.0 / (1.0 + ((radius - 1.0) / 0.15).exp())
        });
        let profile: Vec<f64> = profile.collect();
        let energy: f64 = profile.iter().map(|value| value * value).sum();
        for detectability in [0.7, 1.5] {
            let signal: Vec<f64> = profile
                .iter()
                .map(|value| value * detectability / energy.sqrt())
                .collect();
            let training = [
                head(&patch, &signal, 500, &mut random),
                head(&patch, &signal, 500, &mut random),
            ];
            let template = Template::trained(&training).unwrap();
            let found = judged(&template, &head(&patch, &signal, 1000, &mut random));
            let ideal = normal_below(detectability / std::f64::consts::SQRT_2);
            assert!((found - ideal).abs() < 0.03, "{found} {ideal}");
            let nothing = vec![0.0; signal.len()];
            let chance = judged(&template, &head(&patch, &nothing, 1000, &mut random));
            assert!((chance - 0.5).abs() < 0.03, "{chance}");
        }
    }

    #[test]
    fn heads_that_differ_as_a_whole_are_not_a_signal() {
        let patch = Patch::new();
        let mut random = Random::new(12);
        let nothing = vec![0.0; patch.offsets.len()];
        let mut bright = head(&patch, &nothing, 100, &mut random);
        for output in bright.with.iter_mut().chain(&mut bright.without) {
            output.0[0] += 100.0;
        }
        bright.with.truncate(90);
        let dark = head(&patch, &nothing, 100, &mut random);
        let Template(weights) = Template::trained([&bright, &dark]).unwrap();
        // The deviation of an output is 0.1.
        assert!(weights.iter().all(|w| w.abs() < 10.0), "{weights:?}");
        assert!(Template::trained([&Group::default()]).is_none());
    }
}
