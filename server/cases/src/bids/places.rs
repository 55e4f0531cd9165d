//! The places that maps list, as a table of BIDS.

use std::fmt::Write as _;

use case::{ATLAS_ERROR_MM, CandidateFacts, Gyrus, MapName};
use serde_json::{Value, json};

use super::record::ras;
use crate::gyri::PlaceNames;
use crate::library::LoadedMaps;

/// The head of the table.
const COLUMNS: &str = "map\trank\tx\ty\tz\tscore\tside\tdepth_mm\tgyrus\tstands_out\tsize_mm\tmni152_x\tmni152_y\tmni152_z\n";

/// A row for each place of the cerebrum, the highest of each map first. Numbers are the shortest texts that read back as the same numbers.
pub(super) fn table<'a>(
    maps: impl IntoIterator<Item = (MapName, &'a LoadedMaps)>,
    names: &PlaceNames<'_>,
) -> String {
    let mut text = COLUMNS.to_owned();
    for (name, maps) in maps {
        for (rank, place) in (1..).zip(names.of_places(maps.places(name))) {
            let [x, y, z] = ras(place.position_in_patient);
            let depth = place
                .depth_mm
                .map_or("n/a".to_owned(), |depth| depth.to_string());
            let CandidateFacts { score, size_mm, .. } = place;
            let [side, gyrus] = [place.side.name(), place.gyrus.map_or("n/a", Gyrus::name)];
            let stands_out = match place.unusual {
                Some(_) => place.stands_out().to_string(),
                None => "n/a".to_owned(),
            };
            let atlas = place.standard.and_then(|standard| standard.atlas);
            let mni152 = atlas.map_or("n/a\tn/a\tn/a".to_owned(), |atlas| {
                atlas.mni152.map(|mm| mm.to_string()).join("\t")
            });
            let name = name.name();
            let _ = writeln!(
                text,
                "{name}\t{rank}\t{x}\t{y}\t{z}\t{score}\t{side}\t{depth}\t{gyrus}\t{stands_out}\t{size_mm}\t{mni152}"
            );
        }
    }
    text
}

/// What the columns are.
pub(super) fn columns() -> Value {
    let about = |axis: &str| {
        format!(
            "{axis} in MNI 152, by an affine fit of the whole head to an atlas: up to {ATLAS_ERROR_MM} mm off; n/a as for the gyrus."
        )
    };
    json!({
        "map": {"Description": "The map that lists the place. Most places are normal: nothing is detected.", "Levels": {
            "blur": "the junction of grey and white matter is less sharp than around the place and on the other side",
            "thickness": "the cortex is thicker than on the other side",
            "flair": "the FLAIR is brighter than around the place and on the other side",
        }},
        "rank": {"Description": "From 1, the highest score, within the map."},
        "x": {"Description": "To the patient's right, in the scanner space of the T1-weighted volume (RAS).", "Units": "mm"},
        "y": {"Description": "To the front (RAS).", "Units": "mm"},
        "z": {"Description": "Upwards (RAS).", "Units": "mm"},
        "score": {"Description": "A robust z of this head."},
        "side": {"Description": "The side of the plane between the hemispheres.", "Levels": {
            "left": "the patient's left", "right": "the patient's right",
            "middle": "within 5 mm of the plane", "unknown": "the plane is in doubt",
        }},
        "depth_mm": {"Description": "Depth below the envelope of the brain; n/a where it is not known.", "Units": "mm"},
        "gyrus": {"Description": "A coarse name from an atlas, never a measurement; n/a without an atlas, or if the head does not surely fit it."},
        "stands_out": {"Description": "Whether the score is higher than in heads without a lesion, n/a where that is not known. No place that stands out does not exclude a lesion."},
        "size_mm": {"Description": "The diameter of the place.", "Units": "mm"},
        "mni152_x": {"Description": about("To the right"), "Units": "mm"},
        "mni152_y": {"Description": about("To the front"), "Units": "mm"},
        "mni152_z": {"Description": about("Upwards"), "Units": "mm"},
    })
}
