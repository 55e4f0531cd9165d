//! The numbers of a layer in 16 bits.

use std::collections::BTreeMap;

use case::{Failure, LabelFacts, LayerKind, LayerParameters};
use geometry::{Envelope, Rescale, Volume};
use glam::{DAffine3, DVec3};
use imaging::nifti::{SAMPLE, Values, kept_range};

use crate::failure::from_geometry;

/// The stored value of undefined voxels.
pub const UNDEFINED_CODE: u16 = 0;

/// The greatest stored value.
const LAST_CODE: f64 = u16::MAX as f64;

/// The greatest magnitude of a value, as for the window of a picture.
const MOST: f32 = 1e9;

const MOST_LABEL: f32 = 16_777_215.0;

/// The most different labels.
const MOST_LABELS: usize = u16::MAX as usize;

/// What MELD multiplies the number of a cluster by in its most salient part.
const SALIENT: u32 = 100;

/// The brain window of CT, in Hounsfield units.
const BRAIN_WINDOW: [f64; 2] = [0.0, 80.0];

/// A layer on the grid of its acquisition.
pub(super) struct Voxels {
    /// A stored 0 is undefined; of labels, the stored value is the number of a label, from 1.
    pub(super) volume: Volume,
    /// The labels, ascending.
    pub(super) labels: Vec<LabelFacts>,
    /// Least and greatest value.
    pub(super) range: [f32; 2],
    /// How many values lie so far beyond all others that they became the end of the range.
    pub(super) clipped: u64,
}

impl Voxels {
    /// Checks the numbers and stores them in 16 bits: exactly if they are integers with a range of at most 65,534,
    /// otherwise in 65,534 equal steps, one of which is zero.
    pub(super) fn of(values: Values, parameters: &LayerParameters) -> Result<Self, Failure> {
        let defined = values.numbers.iter().filter(|number| !number.is_nan());
        let range = defined.fold(
            [f32::INFINITY, f32::NEG_INFINITY],
            |[low, high], &number| [low.min(number), high.max(number)],
        );
        let [least, greatest] = range;
        if least > greatest {
            let detail = "every voxel of the layer is NaN or infinite; there is nothing to show";
            return Err(Failure::unusable("layer-empty", detail));
        }
        if least < -MOST || greatest > MOST {
            let detail = format!(
                "the values of the layer run from {least:e} to {greatest:e}; they must be within -1e9 to 1e9; scale the volume"
            );
            return Err(Failure::unusable("intensity-range", detail));
        }
        if parameters.kind == LayerKind::Labels {
            return Self::of_labels(values, range, parameters);
        }
        if least == greatest {
            let detail =
                format!("every voxel of the layer has the value {least}; there is nothing to show");
            return Err(Failure::unusable("layer-empty", detail));
        }
        let range = match steps(&values.numbers, range).slope {
            1.0 => range,
            _ => kept(&values.numbers, range),
        };
        let is_clipped = |number: &&f32| **number < range[0] || **number > range[1];
        let clipped = values.numbers.iter().filter(is_clipped).count() as u64;
        let rescale = steps(&values.numbers, range);
        let code = |&number: &f32| {
            if number.is_nan() {
                return UNDEFINED_CODE;
            }
            let steps =
                (f64::from(number) - f64::from(rescale.intercept)) / f64::from(rescale.slope);
            steps.round().clamp(1.0, LAST_CODE) as u16
        };
        let codes = values.numbers.iter().map(code).collect();
        Ok(Self {
            volume: Volume::new(values.grid, codes, rescale).map_err(from_geometry)?,
            labels: Vec::new(),
            range,
            clipped,
        })
    }

    fn of_labels(
        values: Values,
        range: [f32; 2],
        parameters: &LayerParameters,
    ) -> Result<Self, Failure> {
        let mut counts = BTreeMap::<u32, u64>::new();
        for &number in values.numbers.iter().filter(|number| !number.is_nan()) {
            if number.fract() != 0.0 || !(0.0..=MOST_LABEL).contains(&number) {
                let detail = format!(
                    "a voxel of the label map has the value {number}; labels are whole numbers from 0 to {MOST_LABEL}; \
                     send other values as the kind `map`"
                );
                return Err(Failure::unusable("labels-not-whole", detail));
            }
            *counts.entry(number as u32).or_default() += 1;
        }
        counts.remove(&0);
        if counts.is_empty() {
            let detail = "no voxel of the label map has a label; there is nothing to show";
            return Err(Failure::unusable("layer-empty", detail));
        }
        if counts.len() > MOST_LABELS {
            let detail = format!("the label map has more than {MOST_LABELS} labels; is it one?");
            return Err(Failure::unusable("labels-too-many", detail));
        }
        let codes: BTreeMap<u32, u16> = counts.keys().copied().zip(1..).collect();
        let code = |&number: &f32| match number {
            number if number.is_nan() => UNDEFINED_CODE,
            number => codes
                .get(&(number as u32))
                .copied()
                .unwrap_or(UNDEFINED_CODE),
        };
        let voxels = values.numbers.iter().map(code).collect();
        let whole = Rescale {
            slope: 1.0,
            intercept: 0.0,
        };
        let is_of_meld = parameters.labels.is_empty() && is_of_meld(counts.keys().copied());
        let named = |(value, voxels): (u32, u64)| LabelFacts {
            value,
            name: match parameters.labels.get(&value) {
                Some(name) => name.clone(),
                None if is_of_meld && value >= SALIENT => {
                    format!("cluster {}, salient", value / SALIENT)
                }
                None if is_of_meld => format!("cluster {value}"),
                None => value.to_string(),
            },
            voxels,
        };
        Ok(Self {
            volume: Volume::new(values.grid, voxels, whole).map_err(from_geometry)?,
            labels: counts.into_iter().map(named).collect(),
            range,
            clipped: 0,
        })
    }

    /// The default window.
    pub(super) fn window(
        &self,
        seen: &Seen,
        parameters: &LayerParameters,
    ) -> Result<[f64; 2], Failure> {
        let value = |code: u16| f64::from(self.volume.intensity(f32::from(code)));
        let all = seen.codes(|_| true);
        let window = match parameters.kind {
            LayerKind::Labels => {
                all.quantile(0.5).ok_or_else(outside)?;
                return Ok([0.0, self.labels.len() as f64]);
            }
            LayerKind::Ct if parameters.unit == "HU" => {
                all.quantile(0.5).ok_or_else(outside)?;
                BRAIN_WINDOW
            }
            LayerKind::Mr | LayerKind::Ct => {
                [0.02, 0.98].map(|share| all.quantile(share).map_or(f64::NAN, value))
            }
            LayerKind::Pet => [0.0, all.quantile(0.995).map_or(f64::NAN, value)],
            // A zero says that nothing was found or looked at.
            LayerKind::Map => {
                let high = seen.codes(|code| value(code) > 0.0).quantile(0.995);
                let low = seen.codes(|code| value(code) < 0.0).quantile(0.005);
                match (low.map(value), high.map(value)) {
                    (Some(low), high) => {
                        let most = high.unwrap_or(0.0).max(-low);
                        [-most, most]
                    }
                    (None, Some(high)) => [0.0, high],
                    (None, None) => return Err(outside()),
                }
            }
        };
        if window.iter().any(|end| end.is_nan()) {
            return Err(outside());
        }
        let [low, high] = window;
        let least = 1e-4 * low.abs().max(high.abs()).max(0.1);
        Ok([low, high.max(low + least)])
    }
}

/// Whether labels are those of MELD's predictions: clusters are numbered from 1, and the most salient part of a cluster
/// has its number times 100.
fn is_of_meld(values: impl Iterator<Item = u32>) -> bool {
    let (salient, clusters): (Vec<_>, Vec<_>) = values.partition(|&value| value >= SALIENT);
    let has_cluster =
        |value: &u32| value.is_multiple_of(SALIENT) && clusters.contains(&(value / SALIENT));
    !salient.is_empty() && salient.iter().all(has_cluster)
}

/// The layer has nothing to show in the head.
pub(super) fn outside() -> Failure {
    Failure::unusable(
        "layer-outside-head",
        "nothing of the layer lies in the head; is it of another head, or is its header wrong?",
    )
}

/// The range without values far beyond all others.
fn kept(numbers: &[f32], range: [f32; 2]) -> [f32; 2] {
    let every = (numbers.len() / SAMPLE).max(1);
    let sample = numbers.iter().step_by(every);
    let sample = sample.map(|&number| f64::from(number)).collect();
    kept_range(sample, range.map(f64::from)).map(|end| end as f32)
}

/// The value of a stored unit and of the stored 0.
fn steps(numbers: &[f32], [least, greatest]: [f32; 2]) -> Rescale {
    let are_whole = numbers
        .iter()
        .all(|number| number.is_nan() || number.fract() == 0.0);
    let range = f64::from(greatest) - f64::from(least);
    if are_whole && range <= LAST_CODE - 1.0 && least.abs() < MOST_LABEL {
        return Rescale {
            slope: 1.0,
            intercept: least - 1.0,
        };
    }
    // Two spare steps, so that zero can be a level.
    let slope = (range / (LAST_CODE - 2.0)) as f32;
    let first = (f64::from(least) / f64::from(slope)).floor();
    let includes_zero = least <= 0.0 && greatest >= 0.0;
    Rescale {
        slope,
        intercept: match includes_zero {
            true => ((first - 1.0) * f64::from(slope)) as f32,
            false => least - slope,
        },
    }
}

/// How often each stored value occurs inside the envelope.
pub(super) struct Seen(Vec<u64>);

impl Seen {
    pub(super) fn inside(envelope: &Envelope, volume: &Volume, case_from_layer: DAffine3) -> Self {
        let mut counts = vec![0; 1 << 16];
        let region = envelope.grid();
        let inside = envelope.mask().voxels();
        let size = region.size();
        let region_from_voxel =
            region.voxel_from_patient() * case_from_layer * volume.grid().patient_from_voxel();
        let step = region_from_voxel.matrix3.x_axis;
        let [nx, ny, _] = volume.grid().size();
        for (row, codes) in volume.voxels().chunks_exact(nx).enumerate() {
            let start = DVec3::new(0.0, (row % ny) as f64, (row / ny) as f64);
            let start = region_from_voxel.transform_point3(start);
            for (x, &code) in codes.iter().enumerate() {
                let position = start + step * x as f64;
                if !region.contains(position) {
                    continue;
                }
                let nearest = position.round().to_array().map(|place| place as usize);
                let nearest = [0, 1, 2].map(|axis| nearest[axis].min(size[axis] - 1));
                counts[usize::from(code)] += u64::from(inside[region.index(nearest)]);
            }
        }
        counts[usize::from(UNDEFINED_CODE)] = 0;
        Self(counts)
    }

    /// Those of some codes.
    fn codes(&self, are_meant: impl Fn(u16) -> bool) -> Self {
        let counts = (0..=u16::MAX).zip(&self.0);
        let kept = counts.map(|(code, &count)| if are_meant(code) { count } else { 0 });
        Self(kept.collect())
    }

    /// The stored value below or at which this share lies; `None` if there are none.
    fn quantile(&self, share: f64) -> Option<u16> {
        let total: u64 = self.0.iter().sum();
        let wanted = (share * total as f64).ceil().max(1.0) as u64;
        let mut below = 0;
        let found = self.0.iter().position(|&count| {
            below += count;
            below >= wanted
        })?;
        (total > 0).then_some(found as u16)
    }
}
