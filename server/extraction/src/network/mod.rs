//! The network deepbet, and how its two models find a brain in a volume.

mod convolution;
mod image;
mod kernel;
mod linknet;
mod normalisation;
mod tensor;
#[cfg(test)]
mod testing;
mod weights;

use std::ops::{ControlFlow, RangeInclusive};

use geometry::Volume;

use crate::canonical::{Box3, Canonical};
use crate::{ExtractionError, Observe, Probability};

use image::{Quantiles, image};
use linknet::LinkNet;
use weights::Weights;

/// Side of the cube for the coarse pass, which locates the brain, in voxels.
const SMALL_SIDE: usize = 128;

/// Side of the cube for the fine pass, which finds its surface, in voxels.
const SIDE: usize = 256;

/// The fraction of a plane of the small cube that the brain must cover for the plane to belong to its box.
const LEAST_COVERED: f32 = 0.02;

/// The margin of the box on each side, as a fraction of its size.
const MARGIN: f32 = 0.1;

/// The fraction of the work for the small cube.
const SMALL_SHARE: f32 = 0.12;

/// The volume of a brain in the coarse pass, in ml, and the probability above which the coarse model is certain.
const LIKELY_ML: RangeInclusive<f64> = 700.0..=2500.0;
const SURE: f32 = 0.95;

/// The two models of deepbet 1.0.2: one locates the brain, the other finds its surface.
#[derive(Debug, Clone)]
pub struct Network {
    coarse: LinkNet,
    fine: LinkNet,
}

/// The result of the network for a volume.
#[derive(Debug)]
pub struct Prediction {
    /// Probabilities in the box around the brain, from the fine model.
    pub fine: Probability,
    /// Probabilities in the whole volume, from the coarse model.
    pub coarse: Probability,
}

impl Network {
    /// The network with the weights from the wheel of deepbet 1.0.2, as its authors published it.
    ///
    /// # Errors
    /// If the bytes are something else, or damaged.
    pub fn from_wheel(wheel: &[u8]) -> Result<Self, ExtractionError> {
        let model = |path| Weights::from_wheel(wheel, path).map(|weights| LinkNet::new(&weights));
        Ok(Self {
            coarse: model("data/models/bbox_model.pt")?,
            fine: model("data/models/model.pt")?,
        })
    }

    /// How well the coarse model recognises a head: the fraction of the possible brain of which it is certain; 0 if
    /// that does not have the size of a brain.
    ///
    /// # Errors
    /// As [`Network::predict`].
    pub(crate) fn liking(
        &self,
        volume: &Volume,
        observe: Observe<'_>,
    ) -> Result<f32, ExtractionError> {
        let canonical = Canonical::new(volume);
        let small = canonical.cube(&canonical.whole(), SMALL_SIDE);
        let quantiles = Quantiles::of(volume, &small)?;
        let image = image(volume, &small, SMALL_SIDE, quantiles)?;
        let values = finished(self.coarse.run(image, observe))?;
        let grid = canonical.cube_grid(&canonical.whole(), SMALL_SIDE)?;
        let coarse = Probability::new(grid, values);
        let brain_ml = coarse.above(0.5)?.largest_component().volume_ml();
        if !LIKELY_ML.contains(&brain_ml) {
            return Ok(0.0);
        }
        let above = |least: f32| {
            coarse
                .values()
                .iter()
                .filter(|&&value| value > least)
                .count()
        };
        Ok(above(SURE) as f32 / above(1.0 - SURE).max(1) as f32)
    }

    /// The probability of each point of a volume to belong to the brain.
    ///
    /// The volume is resampled to 128³ by nearest neighbour, and its 0.005 and 0.995 quantiles become black and white.
    /// The coarse model finds the box around the brain, and the fine model evaluates that box at 256³. The result is
    /// byte-identical for any number of threads.
    ///
    /// # Errors
    /// If the volume has a single intensity, if the coarse model finds nothing large enough, or if `observe` stops the
    /// work.
    pub fn predict(
        &self,
        volume: &Volume,
        observe: Observe<'_>,
    ) -> Result<Prediction, ExtractionError> {
        let canonical = Canonical::new(volume);
        let small = canonical.cube(&canonical.whole(), SMALL_SIDE);
        let quantiles = Quantiles::of(volume, &small)?;
        let coarse = self
            .coarse
            .run(image(volume, &small, SMALL_SIDE, quantiles)?, &|done| {
                observe(done * SMALL_SHARE)
            });
        let coarse_grid = canonical.cube_grid(&canonical.whole(), SMALL_SIDE)?;
        let coarse = Probability::new(coarse_grid, finished(coarse)?);
        drop(small);
        let block = box_around(&coarse, canonical.size())?;
        let cube = canonical.cube(&block, SIDE);
        let image = image(volume, &cube, SIDE, quantiles)?;
        drop(cube);
        let fine = self.fine.run(image, &|done| {
            observe(SMALL_SHARE + done * (1.0 - SMALL_SHARE))
        });
        let fine = Probability::new(canonical.cube_grid(&block, SIDE)?, finished(fine)?);
        Ok(Prediction { fine, coarse })
    }
}

fn finished<T>(flow: ControlFlow<(), T>) -> Result<T, ExtractionError> {
    match flow {
        ControlFlow::Continue(value) => Ok(value),
        ControlFlow::Break(()) => Err(ExtractionError::Cancelled),
    }
}

/// The box around the largest component of brain in a small cube, in voxels of the volume, with a margin.
fn box_around(coarse: &Probability, size: [usize; 3]) -> Result<Box3, ExtractionError> {
    let brain = coarse.above(0.5)?.largest_component();
    let mut covered = [0, 1, 2].map(|_| vec![0u32; SMALL_SIDE]);
    for index in (0..brain.voxels().len()).filter(|&index| brain.voxels()[index]) {
        for (covered, place) in covered.iter_mut().zip(brain.grid().voxel(index)) {
            covered[place] += 1;
        }
    }
    let mut block = [const { 0..0 }; 3];
    for axis in 0..3 {
        let is_covered =
            |&count: &u32| count as f32 / (SMALL_SIDE * SMALL_SIDE) as f32 > LEAST_COVERED;
        let first = covered[axis].iter().position(is_covered);
        let last = covered[axis].iter().rposition(is_covered);
        let (Some(first), Some(last)) = (first, last) else {
            return Err(ExtractionError::NoBrain {
                what: "the network found nothing large enough",
            });
        };
        // In single precision, with ties to even, as in the training of the network.
        let scale = size[axis] as f32 / SMALL_SIDE as f32;
        let centre = (scale * ((first + last + 1) as f32 / 2.0)).round_ties_even();
        let length = ((1.0 + 2.0 * MARGIN) * (scale * (last + 1 - first) as f32)).round_ties_even();
        let end = ((centre + length / 2.0) as usize).min(size[axis]);
        block[axis] = (centre - length / 2.0).max(0.0) as usize..end;
    }
    Ok(block)
}
