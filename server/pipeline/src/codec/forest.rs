//! A forest, encoded as codes of the voxels of the envelope.

use geometry::{Envelope, Forest};

/// The payload of a forest.
pub fn encode_forest(forest: &Forest, envelope: &Envelope) -> Vec<u8> {
    let inside = forest.predecessor().iter().zip(envelope.mask().voxels());
    inside
        .filter(|(_, inside)| **inside)
        .map(|(&code, _)| code)
        .collect()
}

/// The forest over an envelope; `None` if the codes are invalid.
/// The forest from a payload; `None` if it does not belong to the envelope.
pub fn decode_forest(codes: &[u8], envelope: &Envelope) -> Option<Forest> {
    let mut codes = codes.iter();
    let mut predecessor = Vec::with_capacity(envelope.mask().voxels().len());
    for &inside in envelope.mask().voxels() {
        predecessor.push(if inside {
            *codes.next()?
        } else {
            Forest::OUTSIDE
        });
    }
    if codes.next().is_some() {
        return None;
    }
    Forest::from_stored(envelope.grid(), predecessor)
}
