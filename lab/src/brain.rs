//! The brain of a head of the study: from a mask, or extracted from the volume.

use std::ops::ControlFlow;
use std::path::PathBuf;

use extraction::{Extraction, Method, Network, Rating, extract};
use geometry::{BrainMask, Volume};
use imaging::nifti;

use crate::BenchError;
use crate::files::read;

/// The probability above which the network counts a voxel as brain, as for cases.
const THRESHOLD: f32 = 0.5;

/// Where the brain mask of a head comes from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum MaskFrom {
    /// A NIfTI file.
    File(PathBuf),
    /// The network with the weights in this file; tree pruning if it fails.
    Network(PathBuf),
    /// Tree pruning, which needs no weights.
    Pruning,
}

impl MaskFrom {
    /// The brain of a volume. Standard error receives how a mask was extracted, and its rating.
    ///
    /// # Errors
    /// If a file cannot be read, there is no brain, or the rating of an extracted mask is [`Rating::Failed`].
    pub(crate) fn brain(&self, head: &str, volume: &Volume) -> Result<BrainMask, BenchError> {
        let network = match self {
            Self::File(path) => {
                let mask = nifti::read_mask(&read(path)?, &imaging::Limits::default())?;
                return Ok(BrainMask::from_mask(&mask, volume.grid())?);
            }
            Self::Network(path) => {
                let network = Network::from_wheel(&read(path)?);
                let unusable = |error| {
                    BenchError::Usage(format!("--network {} is unusable: {error}", path.display()))
                };
                Some(network.map_err(unusable)?)
            }
            Self::Pruning => None,
        };
        eprintln!("{head}: extracting the brain, because no mask was given");
        let go_on = |_| ControlFlow::Continue(());
        let found = extract(volume, network.as_ref(), THRESHOLD, &go_on)?;
        let reasons = reasons(&found);
        if found.quality.rating == Rating::Failed {
            let head = head.to_owned();
            return Err(BenchError::FailedMask { head, reasons });
        }
        let method = match found.method {
            Method::Network => "the network",
            Method::TreePruning => "tree pruning",
        };
        let rating = match found.quality.rating {
            Rating::Ok => "ok".to_owned(),
            _ => format!("review: {reasons}"),
        };
        eprintln!("{head}: the mask was made by {method}; its rating is {rating}");
        Ok(found.brain)
    }
}

/// The reasons for a rating, in one line.
fn reasons(found: &Extraction) -> String {
    let reasons = found.quality.reasons.iter();
    let sentences: Vec<&str> = reasons.map(|reason| reason.sentence.as_str()).collect();
    sentences.join("; ")
}
