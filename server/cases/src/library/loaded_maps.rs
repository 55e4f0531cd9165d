//! The maps of cases in memory.

use std::borrow::Cow;
use std::sync::Arc;

use case::{CandidateFacts, JunctionBandFacts, LayerId, MapName, RegionFacts};
use geometry::Grid;
use glam::DAffine3;
use pipeline::Undefined;
use pipeline::maps::{CaseMaps, HeadDoubts, Judgement, judgement, map_unit};
use render::{KeyedLayer, Layer, LayerKey, LayerValues};

use crate::cache::CacheValue;

/// The maps of a case, or the map of a FLAIR among its layers, in memory and ready for drawing.
#[derive(Debug)]
pub struct LoadedMaps {
    key: u128,
    grid: Grid,
    layers: Vec<(MapName, Arc<Layer>)>,
    /// The most blurred places of the cerebrum, or the brightest ones of the FLAIR, the highest value first.
    pub candidates: Vec<CandidateFacts>,
    /// The same elsewhere in the brain.
    pub elsewhere: Vec<CandidateFacts>,
    /// The places with the thickest cortex compared with the other side: in the cerebrum, and elsewhere in the brain.
    pub thick: [Vec<CandidateFacts>; 2],
    /// The regions of the brain.
    pub regions: RegionFacts,
    /// How slantwise isosurfaces meet the junction, from the surface inwards.
    pub junction_by_depth: Vec<JunctionBandFacts>,
    doubts: HeadDoubts,
}

impl LoadedMaps {
    /// Takes over the maps of a case; the keys of their layers derive from `key`.
    pub fn new(key: u128, mut maps: CaseMaps) -> Self {
        let candidates = std::mem::take(&mut maps.candidates);
        let elsewhere = std::mem::take(&mut maps.elsewhere);
        let thick = std::mem::take(&mut maps.thick);
        let regions = maps.regions.clone();
        let junction_by_depth = std::mem::take(&mut maps.junction_by_depth);
        let grid = maps.grid().clone();
        let doubts = maps.doubts;
        let layers = maps.into_named().map(|(name, map)| {
            let scale = map.scale();
            let values = LayerValues::Codes {
                least: scale.least,
                step: scale.step,
                codes: map.into_codes(),
            };
            let texts = [name.name(), map_unit(name)];
            let layer = Layer::new(texts, &grid, DAffine3::IDENTITY, values);
            (name, Arc::new(layer.expect("all maps have the same grid")))
        });
        Self {
            key,
            layers: layers.collect(),
            grid,
            candidates,
            elsewhere,
            thick,
            regions,
            junction_by_depth,
            doubts,
        }
    }

    /// Whether no place of the cerebrum stands out, which means that its score is unusual. This does not exclude a lesion.
    pub fn nothing_stands_out(&self) -> bool {
        !self.candidates.iter().any(CandidateFacts::stands_out)
    }

    /// The places of the cerebrum that a map lists, the highest value first.
    pub fn places(&self, name: MapName) -> &[CandidateFacts] {
        match name {
            MapName::Thickness => &self.thick[0],
            _ => &self.candidates,
        }
    }

    /// What is known about the scores of a map of the case.
    pub fn judgement(&self, name: MapName) -> Judgement {
        judgement(name, self.grid.spacing_mm(), self.doubts)
    }

    /// The grid of all maps: a block of the grid of the volume.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// One of the maps.
    ///
    /// # Panics
    /// If it is not among them.
    pub fn layer(&self, name: MapName) -> &Arc<Layer> {
        let found = self.layers.iter().find(|(other, _)| *other == name);
        &found
            .expect("the maps of a case have one of each name, those of a layer have `flair`")
            .1
    }

    /// One of the maps, with the key of its texture on a graphics device.
    pub fn keyed(&self, name: MapName) -> KeyedLayer {
        KeyedLayer {
            key: LayerKey(self.key ^ (1 + name as u128)),
            layer: Arc::clone(self.layer(name)),
        }
    }

    fn bytes(&self) -> u64 {
        let layers = self.layers.iter();
        layers.map(|(_, layer)| layer.bytes() as u64).sum()
    }
}

/// The state of the maps of a case.
#[derive(Debug, Clone)]
pub enum MapsState {
    Ready(Arc<LoadedMaps>),
    Undefined(Undefined),
    /// They are being computed.
    Making,
    /// This server computes none.
    Off,
}

/// The state of the map of the newest FLAIR of a case.
#[derive(Debug, Clone)]
pub struct FlairState {
    /// The layer; `None` while none is ready.
    pub layer: Option<LayerId>,
    /// The state of its map.
    pub state: MapsState,
}

/// The reason for no map of a FLAIR if all of them failed.
pub(super) const FLAIR_NOT_PLACED: Undefined = Undefined {
    code: Cow::Borrowed("flair-not-placed"),
    sentence: Cow::Borrowed("no FLAIR of this case could be placed in its head"),
};

/// The cached state of the maps of a case.
pub(super) type Known = Result<Arc<LoadedMaps>, Undefined>;

impl From<&Known> for MapsState {
    fn from(known: &Known) -> Self {
        match known {
            Ok(maps) => Self::Ready(Arc::clone(maps)),
            Err(reason) => Self::Undefined(reason.clone()),
        }
    }
}

impl CacheValue for Known {
    fn bytes(&self) -> u64 {
        self.as_ref().map_or(1, |maps| maps.bytes())
    }
}
