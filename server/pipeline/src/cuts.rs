//! The stored form of the faces of the volume that cut a brain.

use case::{CaseFacts, CutFacts};
use geometry::{Cut, Envelope, Face};
use glam::DVec3;

use crate::codec::decode_envelope;

/// The version of the preparation; see [`CaseFacts::pipeline`].
pub(crate) const PIPELINE: u32 = 3;

/// The envelope of a case with its cuts, from its payload; `None` if that is damaged.
pub fn envelope_of(facts: &CaseFacts, payload: &[u8]) -> Option<Envelope> {
    Some(decode_envelope(payload)?.with_cuts(cuts_of(&facts.cuts)))
}

/// The cuts of their stored form.
pub(crate) fn cuts_of(stored: &[CutFacts]) -> Vec<Cut> {
    stored.iter().filter_map(cut_of).collect()
}

fn cut_of(stored: &CutFacts) -> Option<Cut> {
    Some(Cut {
        face: Face::ALL
            .into_iter()
            .find(|face| face.name() == stored.face)?,
        inward: DVec3::from_array(stored.normal),
        offset_mm: stored.offset_mm,
    })
}

/// The stored form of cuts.
pub(crate) fn cut_facts(cuts: &[Cut]) -> Vec<CutFacts> {
    let stored = |cut: &Cut| CutFacts {
        face: cut.face.name().to_owned(),
        normal: cut.inward.to_array(),
        offset_mm: cut.offset_mm,
    };
    cuts.iter().map(stored).collect()
}
