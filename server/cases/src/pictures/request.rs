//! The request for a picture, shared by HTTP and the command line.

use case::{CaseFacts, SurfaceName};
use geometry::{DeformableModel, MeshSize};
use pipeline::surfaces::SURFACES_FORMAT;
use render::choice::Renderer;
use render::{
    Background, Camera, ColorMap, FrameSize, Look, MIN_ANNOTATED_SIDE, MapDisc, MapSides,
    NamedView, RenderParameters, RenderRequest, Window, WindowFunction,
};
use serde::{Deserialize, Serialize};

use super::depth::{DepthMm, ShownDepth};
use super::map::{MapRequest, PictureProjection};
use super::{LayerChoice, LayerRef, Numbers, PictureLayers};
use crate::error::Error;
use crate::models::PathKind;

/// The largest number of contours of a mesh.
pub const MAX_CONTOURS: usize = 512;

/// The largest number of points on a contour of a mesh.
pub const MAX_POINTS: usize = 1024;

/// The largest number of pixels of a picture.
pub const MAX_PIXELS: usize = 4096 * 4096;

/// The width and height of a picture by default.
pub(super) fn default_side() -> u32 {
    512
}

/// The zoom that fits the head into the picture.
pub(super) fn default_zoom() -> f64 {
    1.0
}

/// The default number of contours and points of a downloaded mesh.
pub fn default_count() -> usize {
    DeformableModel::DEFAULT_MESH.contour_count()
}

/// The default number of contours and points of a mesh in a picture: 15 mm deep, the picture then differs from that by `trace` by
/// 2 of 255 levels on average; with 30 × 30 by 7 to 10, with wedges.
pub fn default_picture_count() -> usize {
    200
}

/// A word with a default, which a reference to the schema of [`PathKind`] could not have.
#[cfg(feature = "openapi")]
fn paths_schema() -> utoipa::openapi::schema::Object {
    utoipa::openapi::ObjectBuilder::new()
        .schema_type(utoipa::openapi::schema::Type::String)
        .enum_values(Some(["forest", "flow"]))
        .default(Some("flow".into()))
        .build()
}

/// A picture of the isosurface.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::IntoParams, utoipa::ToSchema))]
#[cfg_attr(feature = "openapi", schema(as = RenderQuery))]
#[cfg_attr(feature = "openapi", into_params(parameter_in = Query))]
#[serde(default, deny_unknown_fields)]
pub struct PictureRequest {
    /// Depth below the envelope in mm; a greater depth than the maximum of the case is clamped to it.
    #[cfg_attr(feature = "openapi", param(minimum = 0, default = 0))]
    pub depth_mm: f32,
    /// The surface below which depth is measured. `left` and `right` are the halves of the cerebrum, closed along the falx:
    /// there, the inner side is peeled too. `cerebrum` is without cerebellum and brain stem. If the parts of the brain are in
    /// doubt, only `whole` exists; the answer is then 409 `no-surfaces`. The CPU draws all but `whole`.
    #[serde(skip_serializing_if = "SurfaceName::is_whole")]
    #[cfg_attr(feature = "openapi", param(inline))]
    pub surface: SurfaceName,
    /// `map` is the flat map: each hemisphere as an equal-area disc around its outer or inner side, left on the left, of which every
    /// pixel is a line of sight to the middle of the hemisphere. Then `view` and `orientation` are not accepted, and only
    /// `renderer=trace` draws.
    #[serde(skip_serializing_if = "PictureProjection::is_orthographic")]
    #[cfg_attr(feature = "openapi", param(inline))]
    pub projection: PictureProjection,
    /// With `projection=map`, the sides to show: by default `outer`. Inner sides are those of the surfaces `left` and `right`, whatever
    /// `surface` is; without them, the answer is 409 `no-surfaces`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", param(inline))]
    pub sides: Option<MapSides>,
    /// A named view; by default `left`, unless `orientation` is given. `mesial-left`, the inner side of the left hemisphere, is
    /// for `surface=left` alone, and `mesial-right` for `surface=right`.
    #[cfg_attr(feature = "openapi", param(inline))]
    pub view: Option<NamedView>,
    /// The quaternion x,y,z,w from patient to view space (x right, y up, z to the viewer), instead of `view`.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<Vec<f64>>))]
    #[cfg_attr(feature = "openapi", param(value_type = Option<String>, example = "0,0,0,1"))]
    pub orientation: Option<Numbers<4>>,
    /// The renderer; `auto` is `trace`. A header of the answer states which one drew.
    #[cfg_attr(feature = "openapi", param(inline))]
    pub renderer: Renderer,
    /// Width in pixels.
    #[cfg_attr(feature = "openapi", param(minimum = 1, maximum = 4096, default = 512))]
    pub width: u32,
    /// Height in pixels.
    #[cfg_attr(feature = "openapi", param(minimum = 1, maximum = 4096, default = 512))]
    pub height: u32,
    /// The magnification; 1 fits the bounding sphere of the envelope into the smaller side, or the map into the picture.
    #[cfg_attr(feature = "openapi", param(minimum = 0.01, maximum = 100, default = 1))]
    pub zoom: f64,
    /// The shift of the head to the right and up, in mm: `x,y`. A map shifts as a sphere with a radius of 70 mm would.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<Vec<f64>>))]
    #[cfg_attr(feature = "openapi", param(value_type = Option<String>, example = "0,0"))]
    pub pan: Option<Numbers<2>>,
    /// Window centre and width, in intensities: `c,w`; by default from the case. As in DICOM (LINEAR), the ramp from
    /// black to white is `w - 1` long and its middle is `c - 0.5`: 0 is black and 0.25 white in `0.625,1.25`. The width
    /// is at least 1.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<Vec<f64>>))]
    #[cfg_attr(feature = "openapi", param(value_type = Option<String>, example = "80,120"))]
    pub window: Option<Numbers<2>>,
    /// The function of `window`; `sigmoid` is that of DICOM: the brightness is 1 / (1 + exp(-4 (x - c) / w)), and the
    /// width above 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", param(inline))]
    pub window_function: Option<WindowFunction>,
    /// The colour map.
    #[cfg_attr(feature = "openapi", param(inline))]
    pub colormap: ColorMap,
    /// Intensities are averaged over this depth to either side, in mm. `width` × `height` × (1 + `slab_mm`) is at most 67,108,864.
    #[cfg_attr(feature = "openapi", param(minimum = 0, maximum = 20, default = 0))]
    pub slab_mm: f64,
    /// The fraction of ambient light; 1 turns the shading off.
    #[cfg_attr(
        feature = "openapi",
        param(minimum = 0, maximum = 1, default = 0.3),
        schema(default = 0.3)
    )]
    pub ambient: f64,
    /// The background.
    #[cfg_attr(feature = "openapi", param(inline))]
    pub background: Background,
    /// Contours of the mesh, for the renderer `mesh`. Fewer are faster, and grossly wrong where the surface is hollow.
    #[cfg_attr(feature = "openapi", param(minimum = 3, maximum = 512, default = 200))]
    pub contours: usize,
    /// Points on each contour of the mesh, for the renderer `mesh`.
    #[cfg_attr(feature = "openapi", param(minimum = 3, maximum = 1024, default = 200))]
    pub points: usize,
    /// The paths of the vertices, for the renderer `mesh`. At great depths, meshes along the gradient are closer to the
    /// exact picture than meshes along the forest, which tear.
    #[cfg_attr(feature = "openapi", param(schema_with = paths_schema))]
    pub paths: PathKind,
    /// Whether to draw the label, day and short id of the case, depth, window, scale, directions and the notice into
    /// the picture, and the colours of an overlay.
    #[cfg_attr(feature = "openapi", param(default = false))]
    pub annotate: bool,
    /// The layer to show instead of the intensities: the name of a map, or the name or id of an uploaded layer.
    /// `window` then refers to its values.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(value_type = Option<String>))]
    #[cfg_attr(feature = "openapi", param(value_type = Option<String>, example = "FLAIR"))]
    pub layer: Option<LayerRef>,
    /// The layer to show in colours over the grey texture: the name of a map, or the name or id of an uploaded layer.
    /// Undefined parts are transparent.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(value_type = Option<String>))]
    #[cfg_attr(feature = "openapi", param(value_type = Option<String>, example = "blur"))]
    pub overlay: Option<LayerRef>,
    /// The values of the first and last colour of the overlay: `low,high`; by default from the layer.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(value_type = Option<Vec<f64>>))]
    #[cfg_attr(feature = "openapi", param(value_type = Option<String>, example = "2.5,5"))]
    pub overlay_window: Option<Numbers<2>>,
    /// The colours of the overlay; by default from the layer.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", param(inline))]
    pub overlay_colormap: Option<ColorMap>,
    /// Values of the overlay up to this are transparent; for diverging colours, magnitudes. Above it, the overlay fades
    /// in over a tenth of its window. By default from the layer.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub overlay_threshold: Option<f64>,
    /// The opacity of the overlay, 0 to 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", param(minimum = 0, maximum = 1))]
    pub overlay_opacity: Option<f64>,
}

impl Default for PictureRequest {
    fn default() -> Self {
        let look = Look::default();
        Self {
            depth_mm: 0.0,
            surface: SurfaceName::default(),
            projection: PictureProjection::default(),
            sides: None,
            view: None,
            orientation: None,
            renderer: Renderer::default(),
            width: default_side(),
            height: default_side(),
            zoom: default_zoom(),
            pan: None,
            window: None,
            window_function: None,
            colormap: look.colormap,
            slab_mm: look.slab_mm,
            ambient: look.ambient,
            background: look.background,
            contours: default_picture_count(),
            points: default_picture_count(),
            paths: PathKind::Flow,
            annotate: false,
            layer: None,
            overlay: None,
            overlay_window: None,
            overlay_colormap: None,
            overlay_threshold: None,
            overlay_opacity: None,
        }
    }
}

/// The most pixels of a picture, times 1 + its `slab_mm`: about a second of one CPU core. A picture of 4096 × 4096 pixels may average over
/// 3 mm to either side, one of 1024 × 1024 over all 20.
const MAX_SLAB_SAMPLES: f64 = 67_108_864.0;

/// The version of the flat map; part of the entity tags of everything that shows it.
const FLAT_MAP_FORMAT: u32 = 3;

/// The version of a surface, on which everything that shows it depends; `None` for the whole brain, which never changes.
pub fn surface_version(surface: SurfaceName) -> Option<String> {
    (!surface.is_whole()).then(|| format!("surfaces {SURFACES_FORMAT}"))
}

impl PictureRequest {
    /// The checked values.
    ///
    /// # Errors
    /// [`Error::Parameter`] for an invalid value.
    pub fn checked(&self) -> Result<CheckedPicture, Error> {
        let depth = DepthMm::new(self.depth_mm)?;
        let mesh = mesh_size(self.contours, self.points)?;
        let camera = self.camera()?;
        self.check_map()?;
        check_annotation(self.annotate, [self.width, self.height])?;
        self.layers().check()?;
        let window = self.window()?;
        let size = picture_size(self.width, self.height)?;
        let look = self.look().checked()?;
        self.check_slab()?;
        Ok(CheckedPicture {
            asked: self.clone(),
            depth,
            mesh,
            window,
            parameters: RenderParameters {
                camera,
                size,
                look,
                ..RenderParameters::new(Window::between(0.0, 1.0))
            },
        })
    }

    /// Whether one picture costs no more than the others: an average takes about as many samples a pixel as it is deep in mm.
    fn check_slab(&self) -> Result<(), Error> {
        let pixels = f64::from(self.width) * f64::from(self.height);
        if self.slab_mm > 0.0 && pixels * (1.0 + self.slab_mm) > MAX_SLAB_SAMPLES {
            let most = MAX_SLAB_SAMPLES;
            let detail = format!(
                "must be so small that `width` × `height` × (1 + `slab_mm`) is at most {most}"
            );
            return Err(Error::out_of_range("slab_mm", detail));
        }
        Ok(())
    }

    /// What the picture looks like, but for its window and its layers.
    pub fn look(&self) -> Look {
        Look {
            colormap: self.colormap,
            slab_mm: self.slab_mm,
            ambient: self.ambient,
            background: self.background,
        }
    }

    fn window(&self) -> Result<Option<Window>, Error> {
        match (self.window, self.window_function) {
            (None, Some(_)) => {
                let detail = "is only accepted with `window`";
                Err(Error::out_of_range("window_function", detail))
            }
            (Some(Numbers([centre, width])), Some(WindowFunction::Sigmoid)) => {
                Ok(Some(Window::sigmoid(centre, width)?))
            }
            (window, _) => window.map(window_of_numbers).transpose(),
        }
    }

    /// The view, if the surface has it.
    fn checked_view(&self, view: NamedView) -> Result<NamedView, Error> {
        let needed = match view {
            NamedView::MesialLeft => SurfaceName::Left,
            NamedView::MesialRight => SurfaceName::Right,
            _ => return Ok(view),
        };
        if self.surface == needed {
            return Ok(view);
        }
        let detail = format!(
            "is `{}`, which needs `surface={}`: only that surface has this side",
            view.name(),
            needed.name()
        );
        Err(Error::out_of_range("view", detail))
    }

    /// Whether the keys go with the projection.
    fn check_map(&self) -> Result<(), Error> {
        if self.projection.is_orthographic() {
            return match self.sides {
                Some(_) => Err(Error::out_of_range(
                    "sides",
                    "is only accepted with `projection=map`",
                )),
                None => Ok(()),
            };
        }
        let refused = |key| {
            Err(Error::out_of_range(
                key,
                "is not accepted with `projection=map`",
            ))
        };
        match (self.view, self.orientation) {
            (Some(_), _) => return refused("view"),
            (None, Some(_)) => return refused("orientation"),
            (None, None) => {}
        }
        match self.renderer {
            Renderer::Auto | Renderer::Trace => Ok(()),
            Renderer::Splat | Renderer::Mesh => {
                let detail =
                    "must be `auto` or `trace` with `projection=map`: no other renderer draws maps";
                Err(Error::out_of_range("renderer", detail))
            }
        }
    }

    /// The surfaces and discs of the map; `None` for an orthographic picture.
    pub fn map(&self) -> Option<MapRequest> {
        (!self.projection.is_orthographic()).then(|| MapRequest {
            surface: self.surface,
            sides: self.sides.unwrap_or_default(),
        })
    }

    /// The surfaces that the picture is made of, each once, the requested one first.
    pub fn surfaces(&self) -> Vec<SurfaceName> {
        match self.map() {
            Some(map) => map.surfaces(),
            None => vec![self.surface],
        }
    }

    fn camera(&self) -> Result<Camera, Error> {
        let camera = match (self.orientation, self.view) {
            (Some(_), Some(_)) => {
                let detail = "cannot be combined with `view`";
                return Err(Error::out_of_range("orientation", detail));
            }
            (Some(Numbers(orientation)), None) => Camera::new(orientation, 1.0, [0.0; 2])?,
            (None, view) => Camera::named(self.checked_view(view.unwrap_or(NamedView::Left))?),
        };
        let pan_mm = self.pan.map_or([0.0; 2], |Numbers(pan)| pan);
        Ok(camera.with_zoom(self.zoom)?.with_pan_mm(pan_mm)?)
    }

    /// The same picture turned around its vertical axis.
    ///
    /// # Errors
    /// [`Error::Parameter`] for an invalid view, and for a map, which does not turn.
    pub fn turned(&self, angle_rad: f64) -> Result<Self, Error> {
        if !self.projection.is_orthographic() {
            return Err(Error::out_of_range(
                "projection",
                "must be `orthographic`: a map does not turn",
            ));
        }
        let orientation = glam::DQuat::from_rotation_y(angle_rad) * self.camera()?.orientation();
        Ok(Self {
            view: None,
            orientation: Some(Numbers(orientation.to_array())),
            ..self.clone()
        })
    }

    /// The versions of the map and of the surfaces; `None` for a picture of the whole brain from one direction, which never changes.
    pub fn version(&self) -> Option<String> {
        let map = self.map().map(|_| format!("map {FLAT_MAP_FORMAT}"));
        let surfaces = self.surfaces().into_iter().find_map(surface_version);
        let versions: Vec<String> = map.into_iter().chain(surfaces).collect();
        (!versions.is_empty()).then(|| versions.join(", "))
    }

    pub fn layers(&self) -> LayerChoice {
        LayerChoice {
            layer: self.layer.clone(),
            overlay: self.overlay.clone(),
            overlay_window: self.overlay_window,
            overlay_colormap: self.overlay_colormap,
            overlay_threshold: self.overlay_threshold,
            overlay_opacity: self.overlay_opacity,
        }
    }

    /// The name of the view, the orientation, or the sides on a map.
    pub fn direction(&self) -> String {
        if let Some(map) = self.map() {
            return map.title();
        }
        match (self.orientation, self.view) {
            (Some(Numbers([x, y, z, w])), _) => format!("{x:.2},{y:.2},{z:.2},{w:.2}"),
            (None, view) => view.unwrap_or(NamedView::Left).name().to_owned(),
        }
    }
}

/// A checked request for a picture of any case.
#[derive(Debug, Clone)]
pub struct CheckedPicture {
    pub asked: PictureRequest,
    pub depth: DepthMm,
    /// The mesh, for a renderer that draws one.
    pub mesh: MeshSize,
    /// The window; by default from the layer or the case.
    window: Option<Window>,
    /// All other values, for a depth of 0.
    parameters: RenderParameters,
}

impl CheckedPicture {
    /// The request to the renderer for a disc of a map, at a depth.
    pub(crate) fn of_disc(
        &self,
        disc: MapDisc,
        depth: ShownDepth,
        facts: &CaseFacts,
        layers: &PictureLayers,
    ) -> RenderRequest {
        let request = self.of_case(facts, layers);
        RenderRequest::at_nearest_depth(RenderParameters {
            depth_mm: depth.mm.into(),
            map: Some(disc),
            ..*request.parameters()
        })
    }

    /// The request to the renderer for a case, with its layers.
    pub fn of_case(&self, facts: &CaseFacts, layers: &PictureLayers) -> RenderRequest {
        let depth_mm = self.depth.shown_in(facts).mm.into();
        let usual = || layers.window.unwrap_or_else(|| window_of(facts));
        RenderRequest::at_nearest_depth(RenderParameters {
            depth_mm,
            window: self.window.unwrap_or_else(usual),
            ..self.parameters
        })
    }

    pub fn camera(&self) -> &Camera {
        &self.parameters.camera
    }
}

/// Checks that a count is within `least..=most`.
///
/// # Errors
/// [`Error::Parameter`] for `key`.
pub fn check_count(
    key: &'static str,
    count: usize,
    least: usize,
    most: usize,
) -> Result<(), Error> {
    if (least..=most).contains(&count) {
        Ok(())
    } else {
        Err(Error::out_of_range(
            key,
            format!("is {count}; it must be {least} to {most}"),
        ))
    }
}

/// A checked size of a mesh.
///
/// # Errors
/// [`Error::Parameter`] that names the key.
pub fn mesh_size(contours: usize, points: usize) -> Result<MeshSize, Error> {
    check_count("contours", contours, 3, MAX_CONTOURS)?;
    check_count("points", points, 3, MAX_POINTS)?;
    Ok(MeshSize::new(contours, points)?)
}

/// Checks that a picture is large enough for its annotation.
///
/// # Errors
/// [`Error::Parameter`] for `annotate`.
pub(super) fn check_annotation(annotate: bool, size: [u32; 2]) -> Result<(), Error> {
    if annotate && size.iter().any(|&side| side < MIN_ANNOTATED_SIDE) {
        let detail = format!("needs a picture of at least {MIN_ANNOTATED_SIDE} pixels per side");
        return Err(Error::out_of_range("annotate", detail));
    }
    Ok(())
}

/// A checked size.
///
/// # Errors
/// [`Error::Parameter`] that names the side.
pub(super) fn picture_size(width: u32, height: u32) -> Result<FrameSize, Error> {
    let size = FrameSize::new(width, height)?;
    if size.pixel_count() > MAX_PIXELS {
        let detail = format!("times `height` must be at most {MAX_PIXELS} pixels");
        return Err(Error::out_of_range("width", detail));
    }
    Ok(size)
}

/// The window of a centre and a width.
///
/// # Errors
/// [`Error::Parameter`] that names `window`.
pub(super) fn window_of_numbers(Numbers([centre, width]): Numbers<2>) -> Result<Window, Error> {
    Ok(Window::new(centre, width)?)
}

/// The window of the case, whose ramp covers the interval in its facts.
pub fn window_of(facts: &CaseFacts) -> Window {
    let half = facts.window.width / 2.0;
    Window::between(facts.window.center - half, facts.window.center + half)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(feature = "openapi")]
    fn the_description_states_the_ranges_and_defaults() {
        let number = |value: &serde_json::Value| value.as_f64().unwrap() as f32;
        let usual = serde_json::to_value(PictureRequest::default()).unwrap();
        let is_accepted = |key: &str, value: f64| {
            let mut keys = serde_json::json!({ key: value, "overlay": "blur" });
            if value.fract() == 0.0 {
                keys[key] = (value as i64).into();
            }
            let asked = serde_json::from_value::<PictureRequest>(keys);
            asked.is_ok_and(|asked| asked.checked().is_ok())
        };
        for key in <PictureRequest as utoipa::IntoParams>::into_params(|| None) {
            let schema = serde_json::to_value(key.schema).unwrap();
            if let Some(default) = schema.get("default").filter(|value| value.is_number()) {
                assert_eq!(number(default), number(&usual[&key.name]), "{}", key.name);
            }
            for (end, beyond) in [("minimum", -1e-3), ("maximum", 1e-3)] {
                if let Some(end) = schema.get(end).and_then(serde_json::Value::as_f64) {
                    assert!(is_accepted(&key.name, end), "{} {end}", key.name);
                    assert!(!is_accepted(&key.name, end + beyond), "{} {end}", key.name);
                }
            }
        }
    }

    #[test]
    fn a_large_picture_averages_over_little_depth() {
        let is_accepted = |side: u32, slab_mm: f64| {
            let (width, height) = (side, side);
            let asked = PictureRequest {
                width,
                height,
                slab_mm,
                ..PictureRequest::default()
            };
            asked.checked().is_ok()
        };
        for (side, slab_mm) in [(4096, 0.0), (4096, 3.0), (2048, 15.0), (1024, 20.0)] {
            assert!(is_accepted(side, slab_mm), "{side} {slab_mm}");
        }
        for (side, slab_mm) in [(4096, 3.1), (2048, 15.1), (64, 20.1)] {
            assert!(!is_accepted(side, slab_mm), "{side} {slab_mm}");
        }
    }
}
