//! Layers: volumes shown on the surfaces of a case, as their texture or as colours over it.

use std::sync::Arc;

use geometry::Grid;
use glam::{DAffine3, DVec3};

use crate::error::checked;
use crate::sampler::{Sampler, trilinear};
use crate::{ColorMap, RenderError};

/// The smallest defined fraction of a cell that is divided by.
const LEAST_SHARE: f32 = 1e-6;

/// The fraction of a cell that must be defined for a texture to be defined there.
const ENOUGH: f32 = 0.5;

/// The part of the window over which an overlay fades in above its threshold.
const SOFT_PART: f64 = 0.1;

/// A volume on a grid of its own, with its place in the patient space of a case. It is never resampled: every picture
/// interpolates its own voxels.
#[derive(Debug, Clone, PartialEq)]
pub struct Layer {
    name: String,
    unit: String,
    /// The origin of its place, in words; empty if it is the case's own.
    origin: String,
    size: [usize; 3],
    voxel_from_case: DAffine3,
    values: LayerValues,
}

/// The values of the voxels of a layer, x-fastest. Some may be undefined.
#[derive(Debug, Clone, PartialEq)]
pub enum LayerValues {
    /// Eight bits: a code of 1 to 255 is the value `least + (code − 1) · step`; 0 is undefined.
    Codes {
        /// One code for each voxel.
        codes: Vec<u8>,
        /// The value of code 1.
        least: f32,
        /// The difference between one code and the next, above 0.
        step: f32,
    },
    /// Numbers; a number that is not finite is undefined.
    Numbers(Vec<f32>),
    /// Regions, which are never interpolated: a position has the label of its nearest voxel.
    Labels {
        /// The number of a colour for each voxel, 1 to 255; 0 is undefined.
        codes: Vec<u8>,
        /// The names of the labels with their colours, for a legend.
        names: Vec<(u8, String)>,
    },
}

impl Layer {
    /// A layer on a grid in its own patient space, with the rigid transform into the patient space of the case.
    ///
    /// A legend shows `name` and `unit`; both may be empty.
    ///
    /// # Errors
    /// If the number of values differs from the number of voxels.
    pub fn new(
        [name, unit]: [&str; 2],
        grid: &Grid,
        case_from_layer: DAffine3,
        mut values: LayerValues,
    ) -> Result<Self, RenderError> {
        let count = match &mut values {
            LayerValues::Codes { codes, .. } | LayerValues::Labels { codes, .. } => codes.len(),
            LayerValues::Numbers(numbers) => {
                numbers.iter_mut().for_each(|number| {
                    if !number.is_finite() {
                        *number = f32::NAN;
                    }
                });
                numbers.len()
            }
        };
        if count != grid.voxel_count() {
            return Err(RenderError::LayerSize {
                found: count,
                expected: grid.voxel_count(),
            });
        }
        Ok(Self {
            name: name.to_owned(),
            unit: unit.to_owned(),
            origin: String::new(),
            size: grid.size(),
            voxel_from_case: (case_from_layer * grid.patient_from_voxel()).inverse(),
            values,
        })
    }

    /// The same, with the origin of its place, which pictures state: `registered`.
    #[must_use]
    pub fn placed(self, origin: &str) -> Self {
        let origin = origin.to_owned();
        Self { origin, ..self }
    }

    /// The origin of its place; empty if it is the case's own.
    pub fn origin(&self) -> &str {
        &self.origin
    }

    /// Whether its values are labels, which are not interpolated.
    pub fn has_labels(&self) -> bool {
        matches!(self.values, LayerValues::Labels { .. })
    }

    /// Its name in legends.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The unit of its values; empty if they have none.
    pub fn unit(&self) -> &str {
        &self.unit
    }

    /// Name, unit and origin of the place for a legend: `sharpness (1/mm)`, `FLAIR, registered`.
    pub fn title(&self) -> String {
        let Self {
            name, unit, origin, ..
        } = self;
        let unit = match unit.as_str() {
            "" => String::new(),
            unit => format!(" ({unit})"),
        };
        match origin.as_str() {
            "" => format!("{name}{unit}"),
            origin => format!("{name}{unit}, {origin}"),
        }
    }

    /// Voxels along x, y and z.
    pub fn size(&self) -> [usize; 3] {
        self.size
    }

    /// From LPS mm of the case to voxel coordinates of the layer.
    pub fn voxel_from_case(&self) -> DAffine3 {
        self.voxel_from_case
    }

    /// Its voxels.
    pub fn values(&self) -> &LayerValues {
        &self.values
    }

    /// The value at a position (LPS mm of the case), interpolated between the voxels that are defined; `None` outside,
    /// and if most of the cell around it is undefined.
    pub fn value_at(&self, position_in_case: DVec3) -> Option<f32> {
        let position = self.voxel_from_case.transform_point3(position_in_case);
        self.sampler()
            .value_at(position.to_array().map(|coordinate| coordinate as f32))
    }

    /// Memory held by its voxels, in bytes.
    pub fn bytes(&self) -> usize {
        match &self.values {
            LayerValues::Codes { codes, .. } | LayerValues::Labels { codes, .. } => codes.len(),
            LayerValues::Numbers(numbers) => 4 * numbers.len(),
        }
    }

    pub(crate) fn sampler(&self) -> LayerSampler<'_> {
        match &self.values {
            LayerValues::Codes { codes, least, step } => LayerSampler::Codes {
                codes: Sampler::new(codes, self.size),
                scale: *step,
                offset: least - step,
            },
            LayerValues::Numbers(numbers) => {
                LayerSampler::Numbers(Sampler::new(numbers, self.size))
            }
            LayerValues::Labels { codes, .. } => {
                LayerSampler::Labels(Sampler::new(codes, self.size))
            }
        }
    }
}

/// The voxels of a layer, to be interpolated.
#[derive(Debug, Clone, Copy)]
pub(crate) enum LayerSampler<'a> {
    Codes {
        codes: Sampler<'a, u8>,
        scale: f32,
        offset: f32,
    },
    Numbers(Sampler<'a, f32>),
    Labels(Sampler<'a, u8>),
}

impl LayerSampler<'_> {
    /// The value at a position in voxel coordinates, and its defined fraction, 0 to 1. Undefined voxels do not
    /// contribute to the value.
    pub(crate) fn at(&self, position: [f32; 3]) -> [f32; 2] {
        match self {
            Self::Codes {
                codes,
                scale,
                offset,
            } => {
                let (cell, place) = codes.cell(position);
                let corners = codes.corners(cell);
                let defined = corners.map(|code| if code > 0.0 { 1.0 } else { 0.0 });
                let share = trilinear(defined, place);
                let code = trilinear(corners, place) / share.max(LEAST_SHARE);
                [code * scale + offset, within(codes, position, share)]
            }
            Self::Numbers(numbers) => {
                let (cell, place) = numbers.cell(position);
                let corners = numbers.corners(cell);
                let defined = corners.map(|number| if number.is_nan() { 0.0 } else { 1.0 });
                let known = corners.map(|number| if number.is_nan() { 0.0 } else { number });
                let share = trilinear(defined, place);
                let value = trilinear(known, place) / share.max(LEAST_SHARE);
                [value, within(numbers, position, share)]
            }
            Self::Labels(codes) => {
                let code = codes.nearest(position);
                [code, within(codes, position, code.min(1.0))]
            }
        }
    }

    /// The value at a position in voxel coordinates, if at least half of it is defined.
    pub(crate) fn value_at(&self, position: [f32; 3]) -> Option<f32> {
        let [value, share] = self.at(position);
        (share >= ENOUGH).then_some(value)
    }
}

fn within<T: Copy + Into<f32>>(sampler: &Sampler<'_, T>, position: [f32; 3], share: f32) -> f32 {
    if sampler.contains(position) {
        share
    } else {
        0.0
    }
}

/// Unchecked parameters of an [`OverlayStyle`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OverlayParameters {
    /// The values of the first and the last colour.
    pub window: [f64; 2],
    /// Its colours.
    pub colormap: ColorMap,
    /// Values up to this are transparent; for [diverging](ColorMap::is_diverging) colours, magnitudes up to this.
    /// `None` shows every defined value.
    pub threshold: Option<f64>,
    /// Its opacity, 0 to 1.
    pub opacity: f64,
}

/// The colouring of an overlay: source-over, `mix(below, color(v), opacity · smoothstep(threshold, threshold + soft,
/// v))`, where `soft` is a tenth of the window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OverlayStyle(OverlayParameters);

impl OverlayStyle {
    /// Checks the parameters.
    ///
    /// # Errors
    /// If a number is not finite or beyond ±1e9, the window is empty or the opacity is not in 0..=1.
    pub fn new(parameters: OverlayParameters) -> Result<Self, RenderError> {
        let [low, high] = parameters.window;
        for end in [low, high] {
            checked("overlay_window", end, -1e9..=1e9, "within -1e9 to 1e9")?;
        }
        let length = high - low;
        checked(
            "overlay_window length",
            length,
            1e-6..=2e9,
            "at least 1e-6: give the lower value first",
        )?;
        if let Some(threshold) = parameters.threshold {
            checked(
                "overlay_threshold",
                threshold,
                -1e9..=1e9,
                "within -1e9 to 1e9",
            )?;
        }
        checked(
            "overlay_opacity",
            parameters.opacity,
            0.0..=1.0,
            "within 0 to 1",
        )?;
        Ok(Self(parameters))
    }

    /// The checked parameters.
    pub fn parameters(&self) -> &OverlayParameters {
        &self.0
    }

    /// The colouring prepared for the pixels.
    pub(crate) fn ramp(&self) -> OverlayRamp {
        let OverlayParameters {
            window: [low, high],
            colormap,
            threshold,
            opacity,
        } = self.0;
        let length = high - low;
        OverlayRamp {
            low: low as f32,
            factor: (255.0 / length) as f32,
            threshold: threshold.unwrap_or(-2e9) as f32,
            steepness: (1.0 / (SOFT_PART * length)) as f32,
            opacity: opacity as f32,
            is_diverging: colormap.is_diverging(),
        }
    }
}

/// [`OverlayStyle`] prepared for the pixels: the twin of `shaders/overlay.wgsl`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct OverlayRamp {
    pub(crate) low: f32,
    pub(crate) factor: f32,
    pub(crate) threshold: f32,
    pub(crate) steepness: f32,
    pub(crate) opacity: f32,
    pub(crate) is_diverging: bool,
}

impl OverlayRamp {
    /// The number of a value's colour, 0.0 to 255.0.
    pub(crate) fn level(&self, value: f32) -> f32 {
        ((value - self.low) * self.factor).clamp(0.0, 255.0)
    }

    /// The opacity of a value, 0 to 1.
    pub(crate) fn share(&self, value: f32) -> f32 {
        let size = if self.is_diverging {
            value.abs()
        } else {
            value
        };
        let rise = ((size - self.threshold) * self.steepness).clamp(0.0, 1.0);
        self.opacity * (rise * rise * (3.0 - 2.0 * rise))
    }
}

/// A layer that is drawn over the texture of a picture, and its colours.
#[derive(Debug, Clone, Copy)]
pub struct Overlay<'a> {
    /// The layer.
    pub layer: &'a Layer,
    /// Its colours.
    pub style: OverlayStyle,
}

/// Layers shown on a surface in addition to the intensities of the case, or instead of them.
#[derive(Debug, Clone, Copy, Default)]
pub struct Layers<'a> {
    /// The grey texture, instead of the intensities of the case. The window refers to its values.
    pub base: Option<&'a Layer>,
    /// Colours over the texture.
    pub overlay: Option<Overlay<'a>>,
}

/// Identifies a layer on a graphics device. The same key must always mean the same layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct LayerKey(pub u128);

/// A shared layer, and the key of its texture.
#[derive(Debug, Clone)]
pub struct KeyedLayer {
    /// The key: the same one always means the same layer.
    pub key: LayerKey,
    /// The layer.
    pub layer: Arc<Layer>,
}

/// The layers of a picture, owned by its job.
#[derive(Debug, Clone, Default)]
pub struct KeyedLayers {
    /// See [`Layers::base`].
    pub base: Option<KeyedLayer>,
    /// See [`Layers::overlay`].
    pub overlay: Option<(KeyedLayer, OverlayStyle)>,
}

impl KeyedLayers {
    /// The same, borrowed.
    pub fn layers(&self) -> Layers<'_> {
        Layers {
            base: self.base.as_ref().map(|base| &*base.layer),
            overlay: self.overlay.as_ref().map(|(overlay, style)| Overlay {
                layer: &overlay.layer,
                style: *style,
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> Grid {
        Grid::aligned([3, 2, 2], [2.0; 3], DVec3::new(10.0, 20.0, 30.0)).unwrap()
    }

    fn codes() -> LayerValues {
        LayerValues::Codes {
            codes: vec![1, 3, 5, 1, 0, 5, 1, 3, 5, 1, 3, 5],
            least: -1.0,
            step: 0.5,
        }
    }

    fn layer(values: LayerValues) -> Layer {
        Layer::new(["blur", "z"], &grid(), DAffine3::IDENTITY, values).unwrap()
    }

    #[test]
    fn codes_and_numbers_of_the_same_values_are_the_same_layer() {
        let numbers = [
            -1.0,
            0.0,
            1.0,
            -1.0,
            f32::INFINITY,
            1.0,
            -1.0,
            0.0,
            1.0,
            -1.0,
            0.0,
            1.0,
        ];
        let both = [
            layer(codes()),
            layer(LayerValues::Numbers(numbers.to_vec())),
        ];
        for step in 0..200 {
            let along = f64::from(step);
            let position = DVec3::new(
                8.9 + 0.03 * along,
                19.5 + 0.02 * along,
                29.5 + 0.015 * along,
            );
            let [a, b] = both.each_ref().map(|layer| layer.value_at(position));
            assert_eq!(a.is_some(), b.is_some(), "{position}");
            if let (Some(a), Some(b)) = (a, b) {
                assert!((a - b).abs() < 1e-5, "{position}: {a} {b}");
            }
        }
    }

    #[test]
    fn undefined_voxels_have_no_say_and_are_not_zero() {
        let layer = layer(codes());
        let at = |x, y, z| layer.value_at(DVec3::new(x, y, z));
        assert_eq!(at(12.0, 20.0, 30.0), Some(0.0));
        assert_eq!(at(12.0, 22.0, 30.0), None);
        // Three quarters of the way from the undefined voxel to its neighbour of value 1.
        let beside = at(13.5, 22.0, 30.0).unwrap();
        assert!((beside - 1.0).abs() < 0.01, "{beside}");
        assert_eq!(at(12.5, 22.0, 30.0), None);
        assert_eq!(at(16.0, 20.0, 30.0), None, "outside");
    }

    #[test]
    fn labels_are_those_of_the_nearest_voxel() {
        let codes = vec![1, 7, 5, 1, 0, 5, 1, 3, 5, 1, 3, 5];
        let names = vec![(1, "one".to_owned())];
        let labels = layer(LayerValues::Labels { codes, names });
        let at = |x, y| labels.value_at(DVec3::new(x, y, 30.0));
        assert_eq!([at(9.1, 20.0), at(10.9, 20.0)], [Some(1.0); 2]);
        assert_eq!([at(11.1, 20.4), at(12.9, 20.9)], [Some(7.0); 2]);
        assert_eq!([at(14.9, 20.0), at(12.0, 21.2)], [Some(5.0), None]);
        assert_eq!(at(15.1, 20.0), None, "outside");
        assert!(labels.has_labels());
        assert_eq!(labels.placed("registered").title(), "blur (z), registered");
    }

    #[test]
    fn a_layer_lies_where_its_transform_places_it() {
        let turned = DAffine3::from_rotation_z(std::f64::consts::FRAC_PI_2)
            * DAffine3::from_translation(DVec3::new(1.0, 2.0, 3.0));
        let moved = Layer::new(["", ""], &grid(), turned, codes()).unwrap();
        let straight = layer(codes());
        for place in [DVec3::new(11.2, 20.4, 31.0), DVec3::new(13.9, 20.0, 30.5)] {
            let found = moved.value_at(turned.transform_point3(place)).unwrap();
            let expected = straight.value_at(place).unwrap();
            assert!((found - expected).abs() < 1e-5);
        }
    }

    #[test]
    fn values_that_do_not_fit_the_grid_are_refused() {
        let refused = Layer::new(
            ["", ""],
            &grid(),
            DAffine3::IDENTITY,
            LayerValues::Numbers(vec![0.0; 11]),
        );
        let expected = RenderError::LayerSize {
            found: 11,
            expected: 12,
        };
        assert_eq!(refused, Err(expected));
    }

    fn style(colormap: ColorMap, threshold: Option<f64>) -> OverlayRamp {
        let parameters = OverlayParameters {
            window: [-4.0, 6.0],
            colormap,
            threshold,
            opacity: 0.8,
        };
        OverlayStyle::new(parameters).unwrap().ramp()
    }

    #[test]
    fn an_overlay_fades_in_above_its_threshold() {
        let one_sided = style(ColorMap::VermilionYellow, Some(2.0));
        let shares = [-9.0, 2.0, 2.5, 3.0, 9.0].map(|value| one_sided.share(value));
        for (share, expected) in shares.into_iter().zip([0.0, 0.0, 0.4, 0.8, 0.8]) {
            assert!((share - expected).abs() < 1e-6, "{shares:?}");
        }
        let levels = [-9.0, -4.0, 1.0, 6.0, 9.0].map(|value| one_sided.level(value));
        assert_eq!(levels, [0.0, 0.0, 127.5, 255.0, 255.0]);
        let both = style(ColorMap::BlueOrange, Some(2.0));
        assert_eq!(both.share(-3.0), both.share(3.0));
        assert_eq!(both.share(-1.9), 0.0);
        let all = style(ColorMap::VermilionYellow, None);
        assert_eq!(all.share(-1e6), 0.8);
    }

    #[test]
    fn impossible_styles_are_refused() {
        let good = OverlayParameters {
            window: [0.0, 1.0],
            colormap: ColorMap::Hot,
            threshold: None,
            opacity: 1.0,
        };
        assert!(OverlayStyle::new(good).is_ok());
        for bad in [
            OverlayParameters {
                window: [1.0, 1.0],
                ..good
            },
            OverlayParameters {
                window: [2.0, 1.0],
                ..good
            },
            OverlayParameters {
                window: [f64::NAN, 1.0],
                ..good
            },
            OverlayParameters {
                threshold: Some(f64::INFINITY),
                ..good
            },
            OverlayParameters {
                opacity: 1.1,
                ..good
            },
        ] {
            assert!(OverlayStyle::new(bad).is_err(), "{bad:?}");
        }
    }
}
