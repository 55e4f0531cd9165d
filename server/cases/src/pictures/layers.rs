//! The layers of a picture, and their display.

use std::borrow::Cow;
use std::fmt;
use std::sync::Arc;

use case::{CaseId, Layer, LayerFacts, LayerId, LayerKind, MapName};
use pipeline::Undefined;
use pipeline::maps::MAP_FORMAT;
use render::{ColorMap, KeyedLayer, KeyedLayers, OverlayParameters, OverlayStyle, Window};
use serde::{Deserialize, Serialize};

use super::Numbers;
use crate::error::Error;
use crate::library::{Library, LoadedMaps, MapsState};

/// The default opacity of a map over the texture.
const OPACITY_OF_MAPS: f64 = 0.85;

/// The default opacity of labels and of acquired volumes over the texture.
const OPACITY_OF_OTHERS: f64 = 0.6;

/// The version of the drawing of layers; part of the entity tags of everything that shows them.
const LAYERS_FORMAT: u32 = 1;

/// The name of a map, or the name or id of a layer of the case.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String")]
pub struct LayerRef(String);

impl TryFrom<String> for LayerRef {
    type Error = &'static str;

    fn try_from(name: String) -> Result<Self, &'static str> {
        if name.is_empty() || name.chars().count() > 64 || name.chars().any(char::is_control) {
            return Err("the name of a layer has 1 to 64 characters");
        }
        Ok(Self(name))
    }
}

impl std::str::FromStr for LayerRef {
    type Err = &'static str;

    fn from_str(name: &str) -> Result<Self, &'static str> {
        name.to_owned().try_into()
    }
}

impl From<MapName> for LayerRef {
    fn from(name: MapName) -> Self {
        Self(name.name().to_owned())
    }
}

impl From<case::LayerId> for LayerRef {
    fn from(id: case::LayerId) -> Self {
        Self(id.to_string())
    }
}

impl fmt::Display for LayerRef {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&self.0)
    }
}

impl LayerRef {
    /// The layer among those of a case.
    ///
    /// # Errors
    /// [`Error::NoSuchLayer`].
    pub fn of(&self, layers: &[Layer]) -> Result<ChosenLayer, Error> {
        if let Some(name) = MapName::from_name(&self.0) {
            return Ok(ChosenLayer::of_map(name, layers));
        }
        let is_meant = |layer: &&Layer| layer.name == self.0 || layer.id.to_string() == self.0;
        let found = layers.iter().find(is_meant).ok_or(Error::NoSuchLayer)?;
        Ok(ChosenLayer::Layer(Arc::new(found.clone())))
    }
}

/// A layer of a case.
#[derive(Debug, Clone, PartialEq)]
pub enum ChosenLayer {
    /// A map, computed from the case itself or from one of its layers.
    Map {
        name: MapName,
        /// The layer that it belongs to.
        of_layer: Option<LayerId>,
    },
    /// A layer that was uploaded.
    Layer(Arc<Layer>),
}

impl ChosenLayer {
    /// A map of a case with these layers, which only matter for `flair`.
    pub fn of_map(name: MapName, layers: &[Layer]) -> Self {
        let flair = || Layer::newest_flair(layers).map(|layer| layer.id);
        Self::Map {
            name,
            of_layer: (name == MapName::Flair).then(flair).flatten(),
        }
    }

    /// Its default display.
    ///
    /// # Errors
    /// [`Error::LayerNotReady`], or the failure of a failed layer.
    pub fn style(&self) -> Result<OverlayParameters, Error> {
        Ok(match self {
            Self::Map { name, .. } => style_of_map(*name),
            Self::Layer(layer) => style_of_layer(layer.parameters.kind, ready(layer)?),
        })
    }

    /// Distinguishes answers with different versions of it.
    pub fn version(&self) -> String {
        match self {
            Self::Map { of_layer: None, .. } => format!("maps {MAP_FORMAT}"),
            Self::Map {
                of_layer: Some(layer),
                ..
            } => format!("maps {MAP_FORMAT} {layer}"),
            Self::Layer(layer) => format!("layer {LAYERS_FORMAT} {} {}", layer.id, layer.name),
        }
    }

    async fn load(&self, library: &Library, id: &CaseId) -> Result<KeyedLayer, Error> {
        match self {
            Self::Map { name, .. } => Ok(self.maps(library, id).await?.keyed(*name)),
            Self::Layer(layer) => library.layer(layer).await,
        }
    }

    /// The maps of a ready case, or of its layer that this map belongs to.
    ///
    /// # Errors
    /// [`Error::LayerNotReady`], [`Error::MapsUndefined`], [`Error::NoSuchLayer`] if it is no map, or an error of the store.
    pub async fn maps(&self, library: &Library, id: &CaseId) -> Result<Arc<LoadedMaps>, Error> {
        match self {
            Self::Layer(_) => Err(Error::NoSuchLayer),
            Self::Map {
                of_layer: Some(layer),
                ..
            } => library.maps_of_layer(id, layer).await?.found(),
            Self::Map {
                name: MapName::Flair,
                ..
            } => match library.flair(id).await? {
                Some(flair) => flair.state.found(),
                None => Err(Error::MapsUndefined(NO_FLAIR)),
            },
            Self::Map { .. } => library.maps(id).await?.found(),
        }
    }

    fn is_labels(&self) -> bool {
        matches!(self, Self::Layer(layer) if layer.parameters.kind == LayerKind::Labels)
    }
}

/// The facts of a layer that is ready and open.
///
/// # Errors
/// [`Error::LayerNotReady`], [`Error::LayerClosed`], or the failure of a failed layer.
pub fn ready(layer: &Layer) -> Result<&LayerFacts, Error> {
    if let Some(why) = layer.closed {
        return Err(Error::LayerClosed(why));
    }
    match (layer.state, &layer.facts, &layer.failure) {
        (case::CaseState::Ready, Some(facts), _) => Ok(facts),
        (_, _, Some(failure)) => Err(failure.clone().into()),
        _ => Err(Error::LayerNotReady),
    }
}

/// The layers of a picture, from the keys of a request.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LayerChoice {
    /// The layer to show in grey instead of the intensities.
    pub layer: Option<LayerRef>,
    /// The layer to show in colours over the texture.
    pub overlay: Option<LayerRef>,
    /// The values of the first and last colour of the overlay.
    pub overlay_window: Option<Numbers<2>>,
    /// The colours of the overlay.
    pub overlay_colormap: Option<ColorMap>,
    /// The threshold of the overlay.
    pub overlay_threshold: Option<f64>,
    /// The opacity of the overlay.
    pub overlay_opacity: Option<f64>,
}

/// The default display of a map: one-sided for `blur`, diverging with a transparent middle for comparisons of the sides.
pub fn style_of_map(name: MapName) -> OverlayParameters {
    let (window, colormap, threshold) = match name {
        MapName::Blur => ([2.5, 5.0], ColorMap::VermilionYellow, Some(2.5)),
        MapName::Thickness => ([2.5, 6.0], ColorMap::VermilionYellow, Some(2.5)),
        MapName::Flair => ([2.5, 5.0], ColorMap::VermilionYellow, Some(2.5)),
        MapName::Asymmetry | MapName::IntensityAsymmetry => {
            ([-6.0, 6.0], ColorMap::BlueOrange, Some(2.5))
        }
        MapName::Sharpness => ([0.0, 0.6], ColorMap::Viridis, None),
        MapName::Junction => ([0.0, 1.0], ColorMap::Viridis, None),
    };
    OverlayParameters {
        window,
        colormap,
        threshold,
        opacity: OPACITY_OF_MAPS,
    }
}

/// The default display of an uploaded layer.
pub fn style_of_layer(kind: LayerKind, facts: &LayerFacts) -> OverlayParameters {
    let [low, _] = facts.window;
    let (colormap, threshold, opacity) = match kind {
        LayerKind::Mr | LayerKind::Ct | LayerKind::Pet => (ColorMap::Hot, None, OPACITY_OF_OTHERS),
        LayerKind::Map if low < 0.0 => (ColorMap::BlueOrange, Some(0.0), OPACITY_OF_MAPS),
        LayerKind::Map => (ColorMap::VermilionYellow, Some(0.0), OPACITY_OF_MAPS),
        LayerKind::Labels => (ColorMap::Labels, None, OPACITY_OF_OTHERS),
    };
    // Each label has the colour of its number.
    let window = match kind {
        LayerKind::Labels => [0.0, 255.0],
        _ => facts.window,
    };
    OverlayParameters {
        window,
        colormap,
        threshold,
        opacity,
    }
}

impl LayerChoice {
    /// Whether there is any layer.
    pub fn is_any(&self) -> bool {
        self.layer.is_some() || self.overlay.is_some()
    }

    /// Checks that every value is in its range, and that each belongs to a layer.
    ///
    /// # Errors
    /// [`Error::Parameter`] that names the key.
    pub fn check(&self) -> Result<(), Error> {
        if self.overlay.is_none() {
            let lonely = [
                ("overlay_window", self.overlay_window.is_some()),
                ("overlay_colormap", self.overlay_colormap.is_some()),
                ("overlay_threshold", self.overlay_threshold.is_some()),
                ("overlay_opacity", self.overlay_opacity.is_some()),
            ];
            if let Some((key, _)) = lonely.into_iter().find(|(_, is_given)| *is_given) {
                return Err(Error::out_of_range(key, "needs `overlay`"));
            }
        }
        // Any style will do: each value is checked by itself.
        self.styled(style_of_map(MapName::Blur)).map(drop)
    }

    /// A style with the requested values.
    fn styled(&self, usual: OverlayParameters) -> Result<OverlayStyle, Error> {
        Ok(OverlayStyle::new(OverlayParameters {
            window: self
                .overlay_window
                .map_or(usual.window, |Numbers(ends)| ends),
            colormap: self.overlay_colormap.unwrap_or(usual.colormap),
            threshold: self.overlay_threshold.or(usual.threshold),
            opacity: self.overlay_opacity.unwrap_or(usual.opacity),
        })?)
    }

    /// The layers of a case that are meant. The store is only asked if they are not maps of the case itself.
    ///
    /// # Errors
    /// [`Error::NoSuchLayer`], [`Error::Parameter`] if labels cannot be shown so, or an error of the store.
    pub async fn of_case(&self, library: &Library, id: &CaseId) -> Result<ChosenLayers, Error> {
        let refs = [&self.layer, &self.overlay];
        let are_maps = refs
            .into_iter()
            .flatten()
            .all(|name| MapName::OF_CASE.iter().any(|map| map.name() == name.0));
        let layers = match are_maps {
            true => Vec::new(),
            false => library.store().layers(id).await?,
        };
        self.among(&layers)
    }

    /// The layers that are meant.
    ///
    /// # Errors
    /// As [`LayerChoice::of_case`].
    fn among(&self, layers: &[Layer]) -> Result<ChosenLayers, Error> {
        let chosen =
            |name: &Option<LayerRef>| name.as_ref().map(|name| name.of(layers)).transpose();
        let (base, overlay) = (chosen(&self.layer)?, chosen(&self.overlay)?);
        if base.as_ref().is_some_and(ChosenLayer::is_labels) {
            let detail = "names a label map, which can only be shown as `overlay`";
            return Err(Error::out_of_range("layer", detail));
        }
        if overlay.as_ref().is_some_and(ChosenLayer::is_labels) && self.overlay_window.is_some() {
            let detail =
                "is not accepted for a label map, because labels have their own colours; omit it";
            return Err(Error::out_of_range("overlay_window", detail));
        }
        Ok(ChosenLayers {
            asked: self.clone(),
            base,
            overlay,
        })
    }
}

/// The layers of a picture, found in a case.
#[derive(Debug, Clone, Default)]
pub struct ChosenLayers {
    asked: LayerChoice,
    base: Option<ChosenLayer>,
    overlay: Option<ChosenLayer>,
}

impl ChosenLayers {
    /// Distinguishes pictures with different versions of layers; `None` without layers.
    pub fn version(&self) -> Option<String> {
        let all = [&self.base, &self.overlay].into_iter().flatten();
        let versions: Vec<_> = all.map(ChosenLayer::version).collect();
        (!versions.is_empty()).then(|| versions.join(", "))
    }

    /// The uploaded layers, also those of which maps were computed.
    pub fn ids(&self) -> impl Iterator<Item = LayerId> {
        let all = [&self.base, &self.overlay].into_iter().flatten();
        all.filter_map(|layer| match layer {
            ChosenLayer::Map { of_layer, .. } => *of_layer,
            ChosenLayer::Layer(layer) => Some(layer.id),
        })
    }

    /// Whether one of them is a map.
    pub fn has_maps(&self) -> bool {
        let all = [&self.base, &self.overlay].into_iter().flatten();
        all.into_iter()
            .any(|layer| matches!(layer, ChosenLayer::Map { .. }))
    }

    /// Whether the overlay is a label map.
    pub fn has_labels_above(&self) -> bool {
        self.overlay.as_ref().is_some_and(ChosenLayer::is_labels)
    }

    /// The layers themselves; without any, the store is not accessed.
    ///
    /// # Errors
    /// [`Error::LayerNotReady`], [`Error::MapsUndefined`], the failure of a failed layer, or an error of the store.
    pub async fn load(&self, library: &Library, id: &CaseId) -> Result<PictureLayers, Error> {
        let load = async |chosen: &Option<ChosenLayer>| match chosen {
            Some(layer) => Ok(Some(layer.load(library, id).await?)),
            None => Ok::<_, Error>(None),
        };
        let base = load(&self.base).await?;
        let overlay = load(&self.overlay).await?;
        self.with(base, overlay)
    }

    fn with(
        &self,
        base: Option<KeyedLayer>,
        overlay: Option<KeyedLayer>,
    ) -> Result<PictureLayers, Error> {
        let style =
            |chosen: &Option<ChosenLayer>| chosen.as_ref().map(ChosenLayer::style).transpose();
        let overlay_style = style(&self.overlay)?
            .map(|usual| self.asked.styled(usual))
            .transpose()?;
        let window = style(&self.base)?.map(|style| {
            let [black, white] = style.window.map(|end| end as f32);
            Window::between(black, white)
        });
        Ok(PictureLayers {
            keyed: KeyedLayers {
                base,
                overlay: overlay.zip(overlay_style),
            },
            window,
        })
    }
}

/// The layers of a picture, loaded.
#[derive(Debug, Clone, Default)]
pub struct PictureLayers {
    pub keyed: KeyedLayers,
    /// The default window of the texture, if that is a layer.
    pub window: Option<Window>,
}

impl MapsState {
    /// The maps, if they are available.
    ///
    /// # Errors
    /// [`Error::LayerNotReady`] or [`Error::MapsUndefined`].
    pub fn found(self) -> Result<Arc<LoadedMaps>, Error> {
        match self {
            Self::Ready(maps) => Ok(maps),
            Self::Undefined(reason) => Err(Error::MapsUndefined(reason)),
            Self::Off => Err(Error::MapsUndefined(MAPS_OFF)),
            Self::Making => Err(Error::LayerNotReady),
        }
    }
}

/// The reason for missing maps on a server that computes none.
pub const MAPS_OFF: Undefined = Undefined {
    code: Cow::Borrowed("maps-off"),
    sentence: Cow::Borrowed("this server computes no maps, because `limits.maps` is off"),
};

/// The reason for a missing map of a FLAIR if no layer is one.
pub const NO_FLAIR: Undefined = Undefined {
    code: Cow::Borrowed("no-flair"),
    sentence: Cow::Borrowed(
        "no layer of this case is a FLAIR, or it is closed; add one, or state the `contrast` of the layer that is one",
    ),
};

#[cfg(test)]
mod tests {
    use super::*;

    fn named(name: MapName) -> Option<LayerRef> {
        Some(name.into())
    }

    #[test]
    fn every_map_has_a_style_that_is_accepted() {
        for name in MapName::ALL {
            let choice = LayerChoice {
                overlay: named(name),
                ..LayerChoice::default()
            };
            choice.check().unwrap();
            let chosen = choice.among(&[]).unwrap();
            let of_layer = None;
            assert_eq!(chosen.overlay, Some(ChosenLayer::Map { name, of_layer }));
            assert_eq!(chosen.version(), Some(format!("maps {MAP_FORMAT}")));
            choice.styled(style_of_map(name)).unwrap();
        }
    }

    #[test]
    fn what_belongs_to_no_overlay_or_is_out_of_its_range_is_named() {
        let none = LayerChoice::default();
        let blur = LayerChoice {
            overlay: named(MapName::Blur),
            ..none.clone()
        };
        let wrong = [
            (
                LayerChoice {
                    overlay_opacity: Some(0.5),
                    ..none.clone()
                },
                "overlay_opacity",
            ),
            (
                LayerChoice {
                    overlay_threshold: Some(2.0),
                    ..none.clone()
                },
                "overlay_threshold",
            ),
            (
                LayerChoice {
                    overlay_window: Some(Numbers([3.0, 2.0])),
                    ..blur.clone()
                },
                "overlay_window",
            ),
            (
                LayerChoice {
                    overlay_opacity: Some(1.5),
                    ..blur.clone()
                },
                "overlay_opacity",
            ),
            (
                LayerChoice {
                    overlay_threshold: Some(1e12),
                    ..blur.clone()
                },
                "overlay_threshold",
            ),
        ];
        for (choice, key) in wrong {
            let Err(Error::Parameter { name, .. }) = choice.check() else {
                panic!("{choice:?} is accepted");
            };
            assert_eq!(name, key);
        }
        assert!(none.check().is_ok() && blur.check().is_ok());
    }
}
