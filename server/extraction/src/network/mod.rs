//! The network of deepbet, and how its two models find a brain in a volume.

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

/// Side of the cube in which the brain's place is found, in voxels.
const SMALL_SIDE: usize = 128;

/// Side of the cube in which the brain's surface is found, in voxels.
const SIDE: usize = 256;

/// How much of a plane of the small cube the brain must cover for the plane to belong to its box.
const LEAST_COVERED: f32 = 0.02;

/// By how much of its size the box is larger on each side.
const MARGIN: f32 = 0.1;

/// The share of the work that the small cube takes.
const SMALL_SHARE: f32 = 0.12;

/// The size of a brain at the first look, in ml, and the probability from which the first model is sure.
const LIKELY_ML: RangeInclusive<f64> = 700.0..=2500.0;
const SURE: f32 = 0.95;

/// The two models of deepbet 1.0.2: one finds where the brain is, the other one its surface.
#[derive(Debug, Clone)]
pub struct Network {
    coarse: LinkNet,
    fine: LinkNet,
}

/// What the network says of a volume.
#[derive(Debug)]
pub struct Prediction {
    /// Probabilities in the box around the brain, by the model that finds its surface.
    pub fine: Probability,
    /// Probabilities in the whole volume, by the model that finds its place.
    pub coarse: Probability,
}

impl Network {
    /// The network with the weights of deepbet's wheel, version 1.0.2, as its authors published it.
    ///
    /// # Errors
    /// When the bytes are something else, or damaged.
    pub fn from_wheel(wheel: &[u8]) -> Result<Self, ExtractionError> {
        let model = |path| Weights::from_wheel(wheel, path).map(|weights| LinkNet::new(&weights));
        Ok(Self {
            coarse: model("data/models/bbox_model.pt")?,
            fine: model("data/models/model.pt")?,
        })
    }

    /// How much the first model likes a volume as a head: the share of what can be brain of which it is sure, 0 where that has not the
    /// size of a brain.
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

    /// How likely each place of a volume is to belong to the brain.
    ///
    /// The volume is brought to 128³ by taking the nearest voxel, its 0.005 and 0.995 quantiles become black and white,
    /// the first model finds the box around the brain, and the second one looks at that box at 256³. The result is the
    /// same bytes for any number of threads.
    ///
    /// # Errors
    /// When the volume has one intensity, when the first model finds nothing that is large enough, or when `observe` says stop.
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

/// The box around the largest part of a small cube that is brain, in voxels of the volume, with a margin.
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
                what: "the network found nothing that is large enough",
            });
        };
        // In single precision, with halves to even, as where the network was trained.
        let scale = size[axis] as f32 / SMALL_SIDE as f32;
        let centre = (scale * ((first + last + 1) as f32 / 2.0)).round_ties_even();
        let length = ((1.0 + 2.0 * MARGIN) * (scale * (last + 1 - first) as f32)).round_ties_even();
        let end = ((centre + length / 2.0) as usize).min(size[axis]);
        block[axis] = (centre - length / 2.0).max(0.0) as usize..end;
    }
    Ok(block)
}
