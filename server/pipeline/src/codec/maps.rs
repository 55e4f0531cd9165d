//! The maps of a case, or the reason why it has none.

use analysis::{HeadDoubts, MapKind, StoredMap};
use case::{CandidateFacts, JunctionBandFacts, RegionFacts};
use serde::{Deserialize, Serialize};

use super::bytes::Reader;
use crate::Undefined;
use crate::maps::{CaseMaps, MAP_FORMAT, MapsOrReason};

/// The longest accepted head.
const MAX_HEAD_BYTES: u32 = 1 << 20;

/// The head of the object, before the maps.
#[derive(Debug, Serialize, Deserialize)]
struct ObjectHead {
    format: u32,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    undefined: Option<Undefined>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    places: Option<Places>,
}

/// What is stored beside the maps.
#[derive(Debug, Serialize, Deserialize)]
struct Places {
    candidates: Vec<CandidateFacts>,
    elsewhere: Vec<CandidateFacts>,
    thick: [Vec<CandidateFacts>; 2],
    regions: RegionFacts,
    junction_by_depth: Vec<JunctionBandFacts>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    detail_share: Option<f32>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    contrast: Option<f32>,
}

/// The payload of maps, or of the reason for none.
pub fn encode_maps(maps: &MapsOrReason) -> Vec<u8> {
    let head = ObjectHead {
        format: MAP_FORMAT,
        undefined: maps.as_ref().err().cloned(),
        places: maps.as_ref().ok().map(|maps| Places {
            candidates: maps.candidates.clone(),
            elsewhere: maps.elsewhere.clone(),
            thick: maps.thick.clone(),
            regions: maps.regions.clone(),
            junction_by_depth: maps.junction_by_depth.clone(),
            detail_share: maps.doubts.detail_share,
            contrast: maps.doubts.contrast,
        }),
    };
    let head = serde_json::to_vec(&head).expect("numbers and names");
    let mut bytes = Vec::new();
    let mut part = |part: &[u8]| {
        bytes.extend_from_slice(&(part.len() as u32).to_le_bytes());
        bytes.extend_from_slice(part);
    };
    part(&head);
    for map in maps.iter().flat_map(|maps| &maps.maps) {
        part(&map.to_bytes());
    }
    bytes
}

/// The maps from a payload; `None` if it is damaged or has another format, so that they must be computed again.
pub fn decode_maps(payload: &[u8]) -> Option<MapsOrReason> {
    let mut reader = Reader(payload);
    let length = reader.u32().filter(|&length| length <= MAX_HEAD_BYTES)?;
    let head: ObjectHead = serde_json::from_slice(reader.take(length as usize)?).ok()?;
    if head.format != MAP_FORMAT {
        return None;
    }
    if let Some(reason) = head.undefined {
        return Some(Err(reason));
    }
    let mut maps = Vec::with_capacity(MapKind::OF_HEAD.len());
    while !reader.0.is_empty() {
        let length = reader.u32()?;
        maps.push(StoredMap::from_bytes(reader.take(length as usize)?).ok()?);
    }
    let are_of = |kinds: &[MapKind]| maps.iter().map(StoredMap::kind).eq(kinds.iter().copied());
    if !are_of(&MapKind::OF_HEAD) && !are_of(&[MapKind::Flair]) {
        return None;
    }
    let places = head.places?;
    Some(Ok(CaseMaps {
        maps,
        candidates: places.candidates,
        elsewhere: places.elsewhere,
        thick: places.thick,
        regions: places.regions,
        junction_by_depth: places.junction_by_depth,
        doubts: HeadDoubts {
            detail_share: places.detail_share,
            contrast: places.contrast,
        },
    }))
}
