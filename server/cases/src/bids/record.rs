//! What is known of a head that is done: the JSON beside its brain mask, which is written last.

use std::collections::BTreeMap;

use case::{PlaneFacts, Quality};
use pipeline::Undefined;
use pipeline::maps::MAP_FORMAT;
use serde::{Deserialize, Serialize};

/// What the files of a head depend on, besides its volumes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "PascalCase")]
pub struct MadeWith {
    /// That of the program.
    pub version: String,
    pub map_format: u32,
    /// The BLAKE3 hash of the file with the weights of the network that extracts brains, if there is one.
    pub network: Option<String>,
    /// The tag of the atlas; empty without one.
    pub atlas: String,
}

impl MadeWith {
    /// This program, with the format of its maps.
    pub fn new(version: &str, network: Option<&str>, atlas: &str) -> Self {
        Self {
            version: version.to_owned(),
            map_format: MAP_FORMAT,
            network: network.map(str::to_owned),
            atlas: atlas.to_owned(),
        }
    }
}

/// A head that is done. The first fields are those of BIDS for a mask.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "PascalCase")]
pub struct HeadRecord {
    pub description: String,
    /// `Brain`.
    #[serde(rename = "Type")]
    pub kind: String,
    /// BIDS URIs.
    pub sources: Vec<String>,
    pub spatial_reference: String,
    pub made_with: MadeWith,
    /// The hash of each volume by the name of its file.
    pub source_blake3: BTreeMap<String, String>,
    pub mask: MaskRecord,
    pub midsagittal: PlaneRecord,
    /// The state of the regions: `ok`, `review` or `undefined`.
    pub cerebrum: String,
    /// The edges of a voxel of the T1-weighted volume.
    pub voxel_mm: [f64; 3],
    pub maps: MapsRecord,
    /// The verdict on the place of the FLAIR, if there is one: `registered`, `unchanged` or `failed`.
    pub flair: Option<String>,
    /// How many places of the cerebrum stand out, in maps of which limits are known; `None` if no limits are known.
    pub standing_out: Option<usize>,
    /// What else is to be known, in sentences.
    pub notes: Vec<String>,
    /// How long it took.
    pub seconds: f64,
    /// The names of all files, relative to the root.
    pub files: Vec<String>,
}

/// The mask of a head.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "PascalCase")]
pub struct MaskRecord {
    pub state: String,
    pub method: String,
    pub reasons: Vec<String>,
}

impl MaskRecord {
    pub(super) fn of(quality: Option<&Quality>) -> Self {
        Self {
            state: word(quality.map(|quality| quality.state)),
            method: word(quality.map(|quality| quality.method)),
            reasons: quality.map_or_else(Vec::new, |quality| quality.reasons.clone()),
        }
    }
}

/// The word of a value in the JSON of a case; `unknown` for none.
fn word(value: Option<impl Serialize>) -> String {
    let value = value.and_then(|value| serde_json::to_value(value).ok());
    let word = value.as_ref().and_then(serde_json::Value::as_str);
    word.unwrap_or("unknown").to_owned()
}

/// The plane between the hemispheres: the points `p` (scanner RAS) with `normal · p = offset_mm`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "PascalCase")]
pub struct PlaneRecord {
    /// Towards the patient's left.
    pub normal: [f64; 3],
    pub offset_mm: f64,
    pub doubtful: bool,
}

impl From<&PlaneFacts> for PlaneRecord {
    fn from(plane: &PlaneFacts) -> Self {
        Self {
            normal: ras(plane.normal),
            offset_mm: plane.offset_mm,
            doubtful: plane.doubtful,
        }
    }
}

/// The maps of a head.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "PascalCase")]
pub struct MapsRecord {
    /// `ready` or `undefined`.
    pub state: String,
    /// Why there are none: the stable name, and a sentence.
    pub code: Option<String>,
    pub reason: Option<String>,
}

impl MapsRecord {
    pub(super) fn of(undefined: Option<&Undefined>) -> Self {
        Self {
            state: undefined.map_or("ready", |_| "undefined").to_owned(),
            code: undefined.map(|reason| reason.code.to_string()),
            reason: undefined.map(|reason| reason.sentence.to_string()),
        }
    }
}

/// An LPS vector as RAS, and the other way round.
pub(super) fn ras([x, y, z]: [f64; 3]) -> [f64; 3] {
    [-x, -y, z]
}
