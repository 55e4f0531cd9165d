//! What may be asked for in a picture: one request for HTTP and the command line.

use case::{CaseFacts, MapName};
use geometry::{DeformableModel, MeshSize};
use render::choice::Renderer;
use render::{
    Background, Camera, ColorMap, FrameSize, Light, MIN_ANNOTATED_SIDE, NamedView,
    RenderParameters, RenderRequest, Window,
};
use serde::{Deserialize, Serialize};

use super::depth::DepthMm;
use super::{LayerChoice, Numbers};
use crate::error::Error;
use crate::models::PathKind;

/// The largest number of contours of a mesh.
pub const MAX_CONTOURS: usize = 512;

/// The largest number of points on a contour of a mesh.
pub const MAX_POINTS: usize = 1024;

/// The largest number of pixels of a picture.
pub const MAX_PIXELS: usize = 4096 * 4096;

/// The width and height of a picture by default.
pub fn default_side() -> u32 {
    512
}

/// The zoom that fits the head into the picture.
pub fn default_zoom() -> f64 {
    1.0
}

/// The fineness of a mesh by default, along and across.
pub fn default_count() -> usize {
    DeformableModel::DEFAULT_MESH.contour_count()
}

fn default_paths() -> PathKind {
    PathKind::Flow
}

fn default_ambient() -> f64 {
    f64::from(Light::default().ambient())
}

/// A picture of the isosurface.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::IntoParams, utoipa::ToSchema))]
#[cfg_attr(feature = "openapi", schema(as = RenderQuery))]
#[cfg_attr(feature = "openapi", into_params(parameter_in = Query))]
#[serde(deny_unknown_fields)]
pub struct PictureRequest {
    /// Depth below the envelope in mm; more than the case's maximum is clamped to it.
    #[serde(default)]
    #[cfg_attr(feature = "openapi", param(minimum = 0, default = 0))]
    pub depth_mm: f32,
    /// A named direction: `left` where neither it nor `orientation` is given.
    #[cfg_attr(feature = "openapi", param(inline))]
    pub view: Option<NamedView>,
    /// The quaternion x,y,z,w from patient to view space (x right, y up, z to the viewer), instead of `view`.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<Vec<f64>>))]
    #[cfg_attr(feature = "openapi", param(value_type = Option<String>, example = "0,0,0,1"))]
    pub orientation: Option<Numbers<4>>,
    /// Who draws; `auto` takes what this server has, and the answer's header says which that was.
    #[serde(default)]
    #[cfg_attr(feature = "openapi", param(inline))]
    pub renderer: Renderer,
    /// Pixels in a row.
    #[serde(default = "default_side")]
    #[cfg_attr(feature = "openapi", param(minimum = 1, maximum = 4096, default = 512))]
    pub width: u32,
    /// Rows of pixels.
    #[serde(default = "default_side")]
    #[cfg_attr(feature = "openapi", param(minimum = 1, maximum = 4096, default = 512))]
    pub height: u32,
    /// 1 fits the envelope's bounding sphere into the smaller side.
    #[serde(default = "default_zoom")]
    #[cfg_attr(feature = "openapi", param(minimum = 0.01, maximum = 100, default = 1))]
    pub zoom: f64,
    /// Millimetres by which the head is moved to the right and up: `x,y`.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<Vec<f64>>))]
    #[cfg_attr(feature = "openapi", param(value_type = Option<String>, example = "0,0"))]
    pub pan: Option<Numbers<2>>,
    /// Window centre and width, in intensities: `c,w`; by default that of the case. As DICOM has it (LINEAR), the ramp from black
    /// to white is `w - 1` long and its middle is `c - 0.5`: 0 is black and 0.25 white in `0.625,1.25`. The width is at least 1.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<Vec<f64>>))]
    #[cfg_attr(feature = "openapi", param(value_type = Option<String>, example = "80,120"))]
    pub window: Option<Numbers<2>>,
    /// Colours for brightness.
    #[serde(default)]
    #[cfg_attr(feature = "openapi", param(inline))]
    pub colormap: ColorMap,
    /// Intensities are averaged over this depth to either side, in mm.
    #[serde(default)]
    #[cfg_attr(feature = "openapi", param(minimum = 0, maximum = 20, default = 0))]
    pub slab_mm: f64,
    /// The share of light that reaches every face; 1 turns the shading off.
    #[serde(default = "default_ambient")]
    #[cfg_attr(feature = "openapi", param(minimum = 0, maximum = 1, default = 0.3))]
    pub ambient: f64,
    /// What is behind the brain.
    #[serde(default)]
    #[cfg_attr(feature = "openapi", param(inline))]
    pub background: Background,
    /// Contours of the mesh, for the renderer `mesh`.
    #[serde(default = "default_count")]
    #[cfg_attr(feature = "openapi", param(minimum = 3, maximum = 512, default = 30))]
    pub contours: usize,
    /// Points on each contour of the mesh, for the renderer `mesh`.
    #[serde(default = "default_count")]
    #[cfg_attr(feature = "openapi", param(minimum = 3, maximum = 1024, default = 30))]
    pub points: usize,
    /// What the vertices of the mesh follow, for the renderer `mesh`. Deep down, meshes along the gradient are nearer to the
    /// exact picture than those along the forest, which tear.
    #[serde(default = "default_paths")]
    #[cfg_attr(feature = "openapi", param(inline, default = "flow"))]
    pub paths: PathKind,
    /// Whether label, day and first digits of the case, depth, window, scale, directions and the notice of research use are written into
    /// the picture, with an overlay its colours too.
    #[serde(default)]
    #[cfg_attr(feature = "openapi", param(default = false))]
    pub annotate: bool,
    /// What is seen in place of the case's intensities, with the window in its values: a map of the junction of grey and white matter.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", param(inline))]
    pub layer: Option<MapName>,
    /// What lies in colours above the grey texture: a map of the junction of grey and white matter. Undefined parts are transparent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", param(inline))]
    pub overlay: Option<MapName>,
    /// The values of the overlay's first and last colour: `low,high`; by default those of the layer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(value_type = Option<Vec<f64>>))]
    #[cfg_attr(feature = "openapi", param(value_type = Option<String>, example = "2.5,6"))]
    pub overlay_window: Option<Numbers<2>>,
    /// The overlay's colours; by default those of the layer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", param(inline))]
    pub overlay_colormap: Option<ColorMap>,
    /// What of the overlay is at most this is transparent, of diverging colours by its magnitude; above it the overlay fades in over a
    /// tenth of its window. By default that of the layer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub overlay_threshold: Option<f64>,
    /// How much the overlay hides of what is below it, 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", param(minimum = 0, maximum = 1))]
    pub overlay_opacity: Option<f64>,
}

impl Default for PictureRequest {
    fn default() -> Self {
        Self {
            depth_mm: 0.0,
            view: None,
            orientation: None,
            renderer: Renderer::default(),
            width: default_side(),
            height: default_side(),
            zoom: default_zoom(),
            pan: None,
            window: None,
            colormap: ColorMap::default(),
            slab_mm: 0.0,
            ambient: default_ambient(),
            background: Background::default(),
            contours: default_count(),
            points: default_count(),
            paths: default_paths(),
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

impl PictureRequest {
    /// The values, each in its range.
    ///
    /// # Errors
    /// [`Error::Parameter`] for the one that is not.
    pub fn checked(&self) -> Result<CheckedPicture, Error> {
        let depth = DepthMm::new(self.depth_mm)?;
        let mesh = mesh_size(self.contours, self.points)?;
        let camera = self.camera()?;
        check_annotation(self.annotate, [self.width, self.height])?;
        self.layers().check()?;
        let window = self.window.map(window_of_numbers).transpose()?;
        let request = RenderRequest::new(RenderParameters {
            depth_mm: 0.0,
            camera,
            size: picture_size(self.width, self.height)?,
            window: window.unwrap_or_else(|| Window::between(0.0, 1.0)),
            colormap: self.colormap,
            slab_mm: self.slab_mm,
            light: Light::new(self.ambient)?,
            background: self.background,
        })?;
        Ok(CheckedPicture {
            asked: self.clone(),
            depth,
            mesh,
            window,
            request,
        })
    }

    fn camera(&self) -> Result<Camera, Error> {
        let camera = match (self.orientation, self.view) {
            (Some(_), Some(_)) => {
                let detail = "cannot be given together with `view`";
                return Err(Error::out_of_range("orientation", detail));
            }
            (Some(Numbers(orientation)), None) => Camera::new(orientation, 1.0, [0.0; 2])?,
            (None, view) => Camera::named(view.unwrap_or(NamedView::Left)),
        };
        let pan_mm = self.pan.map_or([0.0; 2], |Numbers(pan)| pan);
        Ok(camera.with_zoom(self.zoom)?.with_pan_mm(pan_mm)?)
    }

    /// The layers that are asked for.
    pub fn layers(&self) -> LayerChoice {
        LayerChoice {
            layer: self.layer,
            overlay: self.overlay,
            overlay_window: self.overlay_window,
            overlay_colormap: self.overlay_colormap,
            overlay_threshold: self.overlay_threshold,
            overlay_opacity: self.overlay_opacity,
        }
    }

    /// From where the head is seen: the name of the view, or the orientation.
    pub fn direction(&self) -> String {
        match (self.orientation, self.view) {
            (Some(Numbers([x, y, z, w])), _) => format!("{x:.2},{y:.2},{z:.2},{w:.2}"),
            (None, view) => view.unwrap_or(NamedView::Left).name().to_owned(),
        }
    }
}

/// A picture that can be asked of every case.
#[derive(Debug, Clone)]
pub struct CheckedPicture {
    /// What was asked for.
    pub asked: PictureRequest,
    /// At which depth.
    pub depth: DepthMm,
    /// The mesh, for a renderer that draws one.
    pub mesh: MeshSize,
    /// Through which window, if not that of the layer or the case.
    window: Option<Window>,
    /// Everything else, at depth 0.
    request: RenderRequest,
}

impl CheckedPicture {
    /// The request to the renderer for a case.
    pub fn of_case(&self, facts: &CaseFacts) -> RenderRequest {
        let depth_mm = self.depth.shown_in(facts).mm.into();
        let usual = || self.asked.layers().window_or(window_of(facts));
        self.request
            .shown(depth_mm, self.window.unwrap_or_else(usual))
    }

    /// From where the head is seen.
    pub fn camera(&self) -> &Camera {
        &self.request.parameters().camera
    }
}

/// Whether a count is within `least..=most`.
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

/// The size of a mesh that can be asked for.
///
/// # Errors
/// [`Error::Parameter`] that names the key.
pub fn mesh_size(contours: usize, points: usize) -> Result<MeshSize, Error> {
    check_count("contours", contours, 3, MAX_CONTOURS)?;
    check_count("points", points, 3, MAX_POINTS)?;
    Ok(MeshSize::new(contours, points)?)
}

/// Whether what is to be written into a picture fits into it.
///
/// # Errors
/// [`Error::Parameter`] for `annotate`.
pub fn check_annotation(annotate: bool, size: [u32; 2]) -> Result<(), Error> {
    if annotate && size.iter().any(|&side| side < MIN_ANNOTATED_SIDE) {
        let detail = format!("needs a picture of at least {MIN_ANNOTATED_SIDE} pixels a side");
        return Err(Error::out_of_range("annotate", detail));
    }
    Ok(())
}

/// A size that is accepted.
///
/// # Errors
/// [`Error::Parameter`] that names the side.
pub fn picture_size(width: u32, height: u32) -> Result<FrameSize, Error> {
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
pub fn window_of_numbers(Numbers([centre, width]): Numbers<2>) -> Result<Window, Error> {
    Ok(Window::new(centre, width)?)
}

/// The case's own window: its ramp runs over the interval that the facts hold.
pub fn window_of(facts: &CaseFacts) -> Window {
    let half = facts.window.width / 2.0;
    Window::between(facts.window.center - half, facts.window.center + half)
}
