//! From the bytes of an upload to everything that a case needs.

use std::sync::atomic::AtomicBool;

use bytes::Bytes;
use geometry::{DistanceMap, Envelope, Forest, PathTable, Volume};

use crate::case::{CaseFacts, Failure, Parameters, Progress};

/// What was uploaded.
#[derive(Debug, Clone)]
pub struct Source {
    /// The volume, as it came.
    pub volume: Bytes,
    /// The mask of the brain, as it came; `None` where the volume is to be its own mask.
    pub mask: Option<Bytes>,
}

/// What an upload may at most ask for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Limits {
    /// The largest accepted number of voxels of a volume or mask.
    pub max_voxels: usize,
}

/// A case, computed.
#[derive(Debug)]
pub struct Prepared {
    /// Intensities, cropped to the envelope with a margin.
    pub volume: Volume,
    /// The envelope, on the working grid.
    pub envelope: Envelope,
    /// Its distance map.
    pub distance: DistanceMap,
    /// The optimal-path forest.
    pub forest: Forest,
    /// The table of the forest's paths for a mesh of 30 × 30.
    pub default_paths: PathTable,
    /// What clients are told.
    pub facts: CaseFacts,
}

/// Computes everything of a case.
///
/// # Errors
/// A [`Failure`] that names what is wrong with the input, or `cancelled`.
pub fn prepare(
    source: &Source,
    parameters: &Parameters,
    limits: &Limits,
    observe: &(dyn Fn(Progress) + Sync),
    cancelled: &AtomicBool,
) -> Result<Prepared, Failure> {
    let _ = (source, parameters, limits, observe, cancelled);
    todo!()
}
