//! Both extraction methods behind one function.

use std::ops::ControlFlow;

use geometry::{BrainMask, DistanceMap, Volume, cut_envelope, distance_map};

use crate::axes::with_other_axes;
use crate::quality::{Because, Quality, Verdict};
use crate::{ExtractionError, Network, Observe, pruning};

/// How a brain was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// By the network deepbet.
    Network,
    /// By tree pruning.
    TreePruning,
}

/// The brain of a volume.
#[derive(Debug, Clone)]
pub struct Extraction {
    /// Its voxels on the working grid of the volume.
    pub brain: BrainMask,
    /// The depth below the envelope of the brain, closed by [`CLOSING_RADIUS_MM`], on which the rating is based.
    pub closed: DistanceMap,
    /// The method that found it.
    pub method: Method,
    /// Its rating.
    pub quality: Quality,
}

/// Radius of the closing for the rating, in mm: the default of envelopes.
pub const CLOSING_RADIUS_MM: f64 = 10.0;

/// The fraction of the work for the first method; the second is rarely needed.
const FIRST_SHARE: f32 = 0.9;

/// If the two passes agree less than this and the shape of the mask does not match the axes, other axes are tried.
const DOUBTFUL_AGREEMENT: f64 = 0.95;

/// Finds the brain in a T1-weighted head, in any orientation and at any spacing.
///
/// With a network, the brain is where the probability exceeds `threshold` (0.5 is the surface of the training; less
/// makes the brain larger). Without a network, or if its result is [`Verdict::Failed`] and pruning does better,
/// [`prune`] is used. `observe` receives the finished fraction several times a second and can stop the work. The result
/// is byte-identical for any number of threads.
///
/// If the network is uncertain and the shape of its result does not match the axes of the volume, the 23 other axes
/// without mirroring are tried. If the network finds a brain with one of them, that brain is returned, placed by the
/// header of the volume, and [`Quality::other_patient_from_voxel`] contains the corrected affine.
///
/// A result rated [`Verdict::Failed`] is returned too; the caller must report it.
///
/// # Errors
/// If nothing in the volume can be a brain, or if `observe` stops the work.
pub fn extract(
    volume: &Volume,
    network: Option<&Network>,
    threshold: f32,
    observe: Observe<'_>,
) -> Result<Extraction, ExtractionError> {
    let Some(network) = network else {
        return pruned(volume, Because::NoNetwork, observe);
    };
    let first = predict(volume, network, threshold, &|done| {
        observe(FIRST_SHARE * done)
    });
    if let Ok(found) = &first
        && found.quality.agreement.unwrap_or_default() < DOUBTFUL_AGREEMENT
        && found.quality.doubts_axes()
    {
        let tell = |_: f32| observe(FIRST_SHARE);
        if let Some(other) = with_other_axes(volume, network, threshold, &tell)? {
            return Ok(other);
        }
    }
    let is_in_doubt = match &first {
        Ok(found) => found.quality.verdict == Verdict::Failed,
        Err(error) => *error != ExtractionError::Cancelled,
    };
    if !is_in_doubt {
        return first;
    }
    let second = pruned(volume, Because::NetworkFailed, &|done| {
        observe(FIRST_SHARE + (1.0 - FIRST_SHARE) * done)
    });
    match (first, second) {
        (_, Err(ExtractionError::Cancelled)) => Err(ExtractionError::Cancelled),
        (first, Ok(second)) if second.quality.verdict < Verdict::Failed || first.is_err() => {
            Ok(second)
        }
        (first, _) => first,
    }
}

/// Finds the brain with the network alone.
///
/// # Errors
/// As [`extract`].
pub fn predict(
    volume: &Volume,
    network: &Network,
    threshold: f32,
    observe: Observe<'_>,
) -> Result<Extraction, ExtractionError> {
    let prediction = network.predict(volume, &|done| observe(0.9 * done))?;
    let brain = prediction.fine.brain(volume.grid(), threshold)?;
    go_on(observe, 0.95)?;
    let closed = closed(&brain, volume)?;
    let quality = Quality::of_predicted(&prediction, (&brain, &closed), volume)?;
    Ok(Extraction {
        brain,
        closed,
        method: Method::Network,
        quality,
    })
}

/// Finds the brain by tree pruning alone. It needs no weights, but a good contrast between grey and white matter.
///
/// The verdict is at best [`Verdict::Review`].
///
/// # Errors
/// As [`extract`].
pub fn prune(volume: &Volume, observe: Observe<'_>) -> Result<Extraction, ExtractionError> {
    pruned(volume, Because::Asked, observe)
}

fn pruned(
    volume: &Volume,
    because: Because,
    observe: Observe<'_>,
) -> Result<Extraction, ExtractionError> {
    let pruned = pruning::prune(volume, &|done| observe(0.9 * done))?;
    let brain = BrainMask::from_mask(&pruned, volume.grid())?;
    go_on(observe, 0.95)?;
    let closed = closed(&brain, volume)?;
    let mut quality = Quality::of_found(&pruned, (&brain, &closed), volume);
    quality.put_to_review(because);
    Ok(Extraction {
        brain,
        closed,
        method: Method::TreePruning,
        quality,
    })
}

/// The depth below the envelope of a brain, closed by [`CLOSING_RADIUS_MM`]; the faces of the volume do not count as
/// dura.
///
/// # Errors
/// If the voxels are too small for that radius.
pub(crate) fn closed(brain: &BrainMask, volume: &Volume) -> Result<DistanceMap, ExtractionError> {
    let cuts = brain.cuts(volume.grid());
    let envelope = cut_envelope(brain, CLOSING_RADIUS_MM, &cuts)?;
    Ok(distance_map(&envelope))
}

/// Reports the finished fraction and returns an error if the caller stops the work.
pub(crate) fn go_on(observe: Observe<'_>, done: f32) -> Result<(), ExtractionError> {
    match observe(done) {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(()) => Err(ExtractionError::Cancelled),
    }
}
