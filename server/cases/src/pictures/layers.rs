//! The layers of a picture, and their display.

use std::sync::Arc;

use case::{CaseId, MapName};
use render::{ColorMap, KeyedLayers, OverlayParameters, OverlayStyle, Window};

use super::Numbers;
use crate::error::Error;
use crate::library::{Library, LoadedMaps, MapsState};

/// The default opacity of an overlay.
const DEFAULT_OPACITY: f64 = 0.85;

/// The layers of a picture, from the keys of a request.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LayerChoice {
    /// The layer to show in grey instead of the intensities.
    pub layer: Option<MapName>,
    /// The layer to show in colours over the texture.
    pub overlay: Option<MapName>,
    /// The values of the first and last colour of the overlay.
    pub overlay_window: Option<Numbers<2>>,
    /// The colours of the overlay.
    pub overlay_colormap: Option<ColorMap>,
    /// The threshold of the overlay.
    pub overlay_threshold: Option<f64>,
    /// The opacity of the overlay.
    pub overlay_opacity: Option<f64>,
}

/// The default display of a map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapStyle {
    /// The values of the first and the last colour, or of black and white.
    pub window: [f64; 2],
    /// Its colours.
    pub colormap: ColorMap,
    /// Values up to this are transparent; `None` shows every defined value.
    pub threshold: Option<f64>,
    /// Its opacity.
    pub opacity: f64,
}

impl MapStyle {
    /// The default for a map: one-sided for `blur`, diverging with a transparent middle for comparisons of the sides.
    pub fn of(name: MapName) -> Self {
        let (window, colormap, threshold) = match name {
            MapName::Blur => ([2.5, 5.0], ColorMap::VermilionYellow, Some(2.5)),
            MapName::Asymmetry | MapName::IntensityAsymmetry => {
                ([-6.0, 6.0], ColorMap::BlueOrange, Some(2.5))
            }
            MapName::Sharpness => ([0.0, 0.6], ColorMap::Viridis, None),
            MapName::Junction => ([0.0, 1.0], ColorMap::Viridis, None),
        };
        Self {
            window,
            colormap,
            threshold,
            opacity: DEFAULT_OPACITY,
        }
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
        self.style().map(drop)
    }

    /// The display of the overlay.
    fn style(&self) -> Result<Option<(MapName, OverlayStyle)>, Error> {
        let Some(name) = self.overlay else {
            return Ok(None);
        };
        let usual = MapStyle::of(name);
        let parameters = OverlayParameters {
            window: self
                .overlay_window
                .map_or(usual.window, |Numbers(ends)| ends),
            colormap: self.overlay_colormap.unwrap_or(usual.colormap),
            threshold: self.overlay_threshold.or(usual.threshold),
            opacity: self.overlay_opacity.unwrap_or(usual.opacity),
        };
        Ok(Some((name, OverlayStyle::new(parameters)?)))
    }

    /// The window of the texture: from the layer, or `window` if the intensities of the case are shown.
    pub fn window_or(&self, window: Window) -> Window {
        self.layer.map_or(window, |name| {
            let [black, white] = MapStyle::of(name).window.map(|end| end as f32);
            Window::between(black, white)
        })
    }

    /// The layers themselves.
    ///
    /// # Errors
    /// As [`LayerChoice::check`].
    pub fn of_maps(&self, maps: &LoadedMaps) -> Result<KeyedLayers, Error> {
        Ok(KeyedLayers {
            base: self.layer.map(|name| maps.keyed(name)),
            overlay: self.style()?.map(|(name, style)| (maps.keyed(name), style)),
        })
    }

    /// The layers of a ready case; if none is requested, the store is not accessed.
    ///
    /// # Errors
    /// [`Error::LayerNotReady`], [`Error::MapsUndefined`], or an error of the store.
    pub async fn of_case(&self, library: &Library, id: &CaseId) -> Result<KeyedLayers, Error> {
        if !self.is_any() {
            return Ok(KeyedLayers::default());
        }
        self.of_maps(&*maps_of(library, id).await?)
    }
}

/// The maps of a ready case.
///
/// # Errors
/// [`Error::LayerNotReady`], [`Error::MapsUndefined`], or an error of the store.
pub async fn maps_of(library: &Library, id: &CaseId) -> Result<Arc<LoadedMaps>, Error> {
    library.maps(id).await?.found()
}

impl MapsState {
    /// The maps, if they are available.
    ///
    /// # Errors
    /// [`Error::LayerNotReady`] or [`Error::MapsUndefined`].
    pub fn found(self) -> Result<Arc<LoadedMaps>, Error> {
        let undefined = |reason: &str| Error::MapsUndefined {
            reason: reason.to_owned(),
        };
        match self {
            Self::Ready(maps) => Ok(maps),
            Self::Undefined(reason) => Err(undefined(&reason)),
            Self::Off => Err(undefined(MAPS_OFF)),
            Self::Making => Err(Error::LayerNotReady),
        }
    }
}

/// The reason for missing maps on a server that computes none.
pub const MAPS_OFF: &str = "this server computes no maps, because `limits.maps` is off";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_map_has_a_style_that_is_accepted() {
        for name in MapName::ALL {
            let choice = LayerChoice {
                overlay: Some(name),
                ..LayerChoice::default()
            };
            choice.check().unwrap();
            let [low, high] = MapStyle::of(name).window;
            let window = LayerChoice {
                layer: Some(name),
                ..LayerChoice::default()
            }
            .window_or(Window::between(0.0, 1.0));
            assert_eq!(
                window.ramp().map(|end| end as f32),
                [low as f32, high as f32]
            );
        }
    }

    #[test]
    fn what_belongs_to_no_overlay_or_is_out_of_its_range_is_named() {
        let none = LayerChoice::default();
        let blur = LayerChoice {
            overlay: Some(MapName::Blur),
            ..none
        };
        let wrong = [
            (
                LayerChoice {
                    overlay_opacity: Some(0.5),
                    ..none
                },
                "overlay_opacity",
            ),
            (
                LayerChoice {
                    overlay_threshold: Some(2.0),
                    ..none
                },
                "overlay_threshold",
            ),
            (
                LayerChoice {
                    overlay_window: Some(Numbers([3.0, 2.0])),
                    ..blur
                },
                "overlay_window",
            ),
            (
                LayerChoice {
                    overlay_opacity: Some(1.5),
                    ..blur
                },
                "overlay_opacity",
            ),
            (
                LayerChoice {
                    overlay_threshold: Some(1e12),
                    ..blur
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
