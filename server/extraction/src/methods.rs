//! Each extraction method by itself, and the rating of its result.

use geometry::{BrainCuts, BrainMask, DistanceMap, Mask, Volume, cut_envelope, distance_map};

use crate::observe::go_on;
use crate::pruning::tree_pruned;
use crate::quality::{Because, Masked, Origin, Quality, rate};
use crate::{ExtractionError, Network, Observe};

/// How a brain was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// By the network deepbet.
    Network,
    TreePruning,
}

/// The brain of a volume.
#[derive(Debug, Clone)]
pub struct Extraction {
    /// Its voxels on the working grid of the volume.
    pub brain: BrainMask,
    /// The depth below the envelope of the brain, closed by [`CLOSING_RADIUS_MM`], on which the rating is based.
    pub closed: DistanceMap,
    pub cuts: BrainCuts,
    /// The method that found it.
    pub method: Method,
    pub quality: Quality,
}

impl Extraction {
    /// Whether the network is certain enough of it for a supplied mask to be compared with it.
    pub fn is_certain(&self) -> bool {
        self.quality.is_certain()
    }
}

/// Radius of the closing for the rating, in mm: the default of envelopes.
pub const CLOSING_RADIUS_MM: f64 = 10.0;

/// Finds the brain with the network alone.
///
/// # Errors
/// As [`extract`](crate::extract()).
pub fn predict(
    volume: &Volume,
    network: &Network,
    threshold: f32,
    observe: Observe<'_>,
) -> Result<Extraction, ExtractionError> {
    let prediction = network.predict(volume, &|done| observe(0.9 * done))?;
    let brain = prediction.fine.brain(volume.grid(), threshold)?;
    go_on(observe, 0.95)?;
    let mask = prediction.fine.above(0.5)?;
    let origin = Origin::Predicted(&prediction);
    rated(volume, &mask, brain, Method::Network, origin)
}

/// Finds the brain by tree pruning alone. It needs no weights, but a good contrast between grey and white matter.
///
/// The rating is at best [`Rating::Review`](crate::Rating::Review).
///
/// # Errors
/// As [`extract`](crate::extract()).
pub fn prune(volume: &Volume, observe: Observe<'_>) -> Result<Extraction, ExtractionError> {
    pruned(volume, Because::Asked, observe)
}

pub(crate) fn pruned(
    volume: &Volume,
    because: Because,
    observe: Observe<'_>,
) -> Result<Extraction, ExtractionError> {
    let pruned = tree_pruned(volume, &|done| observe(0.9 * done))?;
    let brain = BrainMask::from_mask(&pruned, volume.grid())?;
    go_on(observe, 0.95)?;
    let origin = Origin::Pruned(because);
    rated(volume, &pruned, brain, Method::TreePruning, origin)
}

/// A brain that a method has found, closed and rated.
pub(crate) fn rated(
    volume: &Volume,
    mask: &Mask,
    brain: BrainMask,
    method: Method,
    origin: Origin<'_>,
) -> Result<Extraction, ExtractionError> {
    let (closed, cuts) = closed(&brain, volume)?;
    let masked = Masked {
        mask,
        brain: &brain,
        closed: &closed,
        cuts: &cuts,
        volume,
    };
    let quality = rate(masked, origin)?;
    Ok(Extraction {
        brain,
        closed,
        cuts,
        method,
        quality,
    })
}

/// The depth below the envelope of a brain, closed by [`CLOSING_RADIUS_MM`], and what cuts it, which does not count as dura.
///
/// # Errors
/// If the voxels are too small for that radius.
pub fn closed(
    brain: &BrainMask,
    volume: &Volume,
) -> Result<(DistanceMap, BrainCuts), ExtractionError> {
    let cuts = brain.cut_by(volume);
    let envelope = cut_envelope(brain, CLOSING_RADIUS_MM, &cuts.cuts)?;
    Ok((distance_map(&envelope), cuts))
}
