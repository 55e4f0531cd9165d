//! Heads with wrong axes in the header: the network is tried with other axes.
//!
//! A mirrored head is never tried: no network can tell left from right, and a correct header would become wrong.

use geometry::{AXIS_ORDERS, BrainMask, Grid, Mask, Volume};
use glam::{DAffine3, DMat3, DVec3};

use crate::methods::{Extraction, Method, predict, rated};
use crate::quality::{Origin, Quality};
use crate::{ExtractionError, Network, Observe};

/// The least agreement of the two passes of the network for other axes to be offered.
const LEAST_AGREEMENT: f64 = 0.97;

/// The brain that the network finds with its best alternative axes, if there are any; placed by the header of the
/// volume. The quality of the result contains the alternative affine.
///
/// # Errors
/// If `observe` stops the work.
pub(crate) fn with_other_axes(
    volume: &Volume,
    network: &Network,
    threshold: f32,
    observe: Observe<'_>,
) -> Result<Option<Extraction>, ExtractionError> {
    let middle = middle(volume.grid());
    let mut best = (0.0, DAffine3::IDENTITY);
    for turn in turns() {
        let about = DAffine3 {
            matrix3: turn,
            translation: middle - turn * middle,
        };
        let liking = match network.liking(&turned(volume, about)?, observe) {
            Err(ExtractionError::Cancelled) => return Err(ExtractionError::Cancelled),
            liking => liking.unwrap_or_default(),
        };
        if liking > best.0 {
            best = (liking, about);
        }
    }
    let about = best.1;
    let found = match predict(&turned(volume, about)?, network, threshold, observe) {
        Err(ExtractionError::Cancelled) => return Err(ExtractionError::Cancelled),
        found => found.ok().filter(|found| is_better(&found.quality)),
    };
    found
        .map(|found| turned_back(volume, found, about))
        .transpose()
}

fn is_better(quality: &Quality) -> bool {
    let agreement = quality.agreement.unwrap_or_default();
    agreement >= LEAST_AGREEMENT && !quality.doubts_axes()
}

/// The 23 rotations that map axes to axes, without the identity.
fn turns() -> impl Iterator<Item = DMat3> {
    let all = AXIS_ORDERS.into_iter().flat_map(|order| {
        (0..8).map(move |signs| {
            let axis = |axis: usize| {
                let sign = if signs >> axis & 1 == 0 { 1.0 } else { -1.0 };
                DVec3::AXES[order[axis]] * sign
            };
            DMat3::from_cols(axis(0), axis(1), axis(2))
        })
    });
    all.filter(|turn| turn.determinant() > 0.0 && *turn != DMat3::IDENTITY)
}

/// The centre of a grid, LPS mm.
fn middle(grid: &Grid) -> DVec3 {
    let middle = DVec3::from_array(grid.size().map(|side| (side - 1) as f64 / 2.0));
    grid.patient_from_voxel().transform_point3(middle)
}

/// The same voxels on another grid.
fn turned(volume: &Volume, about: DAffine3) -> Result<Volume, ExtractionError> {
    let grid = Grid::new(
        volume.grid().size(),
        about * volume.grid().patient_from_voxel(),
    )?;
    let voxels = volume.voxels().to_vec();
    Ok(Volume::new(grid, voxels, volume.rescale())?)
}

/// Maps a result from the turned volume to the volume itself.
fn turned_back(
    volume: &Volume,
    found: Extraction,
    about: DAffine3,
) -> Result<Extraction, ExtractionError> {
    let mask = found.brain.mask();
    let grid = Grid::new(
        mask.grid().size(),
        about.inverse() * mask.grid().patient_from_voxel(),
    )?;
    let mask = Mask::new(grid, mask.voxels().to_vec())?;
    let brain = BrainMask::from_mask(&mask, volume.grid())?;
    let certainty = [found.quality.agreement, found.quality.uncertain];
    let origin = Origin::Turned(certainty);
    let mut back = rated(volume, &mask, brain, Method::Network, origin)?;
    let turned = about * volume.grid().patient_from_voxel();
    back.quality.offer_axes(turned);
    Ok(back)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_are_23_other_rotations_and_none_mirrors() {
        let turns: Vec<DMat3> = turns().collect();
        assert_eq!(turns.len(), 23);
        for (index, turn) in turns.iter().enumerate() {
            assert_eq!(turn.determinant(), 1.0);
            assert!(!turns[..index].contains(turn));
        }
    }
}
