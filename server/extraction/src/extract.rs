//! The two methods behind one function.

use std::ops::ControlFlow;

use geometry::{BrainMask, Volume};

use crate::quality::Quality;
use crate::{ExtractionError, Network, Observe};

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
    /// How they were found.
    pub method: Method,
    /// Whether they can be believed.
    pub quality: Quality,
}

/// Finds the brain in a T1-weighted head, in any orientation and at any spacing.
///
/// `observe` is told the share of the work that is done, several times a second, and can stop it. The result is the same
/// bytes for any number of threads. An extraction whose quality is [`Verdict::Failed`] is returned as well: what it shows is
/// not a brain, and it is for the caller to say so.
///
/// # Errors
/// When nothing in the volume can be a brain, or when `observe` said stop.
pub fn extract(
    volume: &Volume,
    network: Option<&Network>,
    observe: Observe<'_>,
) -> Result<Extraction, ExtractionError> {
    let network = network.ok_or(ExtractionError::NoMethod)?;
    by_network(volume, network, observe)
}

fn by_network(
    volume: &Volume,
    network: &Network,
    observe: Observe<'_>,
) -> Result<Extraction, ExtractionError> {
    let prediction = network.predict(volume, &|done| observe(0.9 * done))?;
    let brain = prediction.fine.brain(volume.grid())?;
    if observe(0.9) == ControlFlow::Break(()) {
        return Err(ExtractionError::Cancelled);
    }
    let quality = Quality::of_predicted(&prediction, &brain, volume)?;
    Ok(Extraction {
        brain,
        method: Method::Network,
        quality,
    })
}
