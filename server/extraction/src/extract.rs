//! The two methods behind one function.

use std::ops::ControlFlow;

use geometry::{BrainMask, DistanceMap, Volume, cut_envelope, distance_map};

use crate::axes::with_other_axes;
use crate::quality::{Because, Quality, Verdict};
use crate::{ExtractionError, Network, Observe, pruning};

/// How a brain was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// By the network of deepbet.
    Network,
    /// By tree pruning.
    TreePruning,
}

/// The brain of a volume.
#[derive(Debug, Clone)]
pub struct Extraction {
    /// Its voxels on the working grid of the volume.
    pub brain: BrainMask,
    /// The depth below the envelope of the brain, closed by [`CLOSING_RADIUS_MM`]: what it was judged by.
    pub closed: DistanceMap,
    /// How they were found.
    pub method: Method,
    /// Whether they can be believed.
    pub quality: Quality,
}

/// Radius of the closing by which a brain is judged, in mm: the usual one of envelopes.
pub const CLOSING_RADIUS_MM: f64 = 10.0;

/// The share of the work that the first method takes, in which the second is rarely needed.
const FIRST_SHARE: f32 = 0.9;

/// The agreement of the network's looks below which a brain whose shape lets doubt the axes is looked for with others.
const DOUBTFUL_AGREEMENT: f64 = 0.95;

/// Finds the brain in a T1-weighted head, in any orientation and at any spacing.
///
/// With the network, where there is one, as the places whose probability is above `threshold` (0.5 is the surface that it was
/// trained for; less makes the brain larger); by [`prune`] where there is none, or where what the network found is
/// [`Verdict::Failed`] and pruning does better. `observe` is told the share of the work that is done, several times a second,
/// and can stop it. The result is the same bytes for any number of threads.
///
/// Where the network is unsure and the shape of what it found lets doubt the volume's axes, it is shown the volume with the 23 other
/// axes that are no mirror images. If it finds a brain so, that is taken, at its place in the volume as it came, and
/// [`Quality::other_patient_from_voxel`] holds what the header might have to say.
///
/// An extraction whose quality is [`Verdict::Failed`] is returned as well: it is for the caller to say so.
///
/// # Errors
/// When nothing in the volume can be a brain, or when `observe` said stop.
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

/// Finds the brain by tree pruning alone: it needs no weights, but a healthy contrast of grey and white matter.
///
/// The verdict is [`Verdict::Review`] at best.
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

/// The depth below the envelope of a brain, closed by [`CLOSING_RADIUS_MM`]; the faces of the volume are no dura.
///
/// # Errors
/// When the voxels are too fine for that.
pub(crate) fn closed(brain: &BrainMask, volume: &Volume) -> Result<DistanceMap, ExtractionError> {
    let cuts = brain.cuts(volume.grid());
    let envelope = cut_envelope(brain, CLOSING_RADIUS_MM, &cuts)?;
    Ok(distance_map(&envelope))
}

/// Tells the share that is done and stops where that is wanted.
pub(crate) fn go_on(observe: Observe<'_>, done: f32) -> Result<(), ExtractionError> {
    match observe(done) {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(()) => Err(ExtractionError::Cancelled),
    }
}
