//! Pictures of the isosurface.

use std::borrow::Cow;
use std::sync::Arc;

use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use geometry::MeshSize;
use render::gpu::GpuCase;
use render::{
    Camera, ColorMap, FrameSize, Light, MIN_ANNOTATED_SIDE, NamedView, RenderError,
    RenderParameters, RenderRequest, Wanted, Window,
};
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use super::depth_headers;
use super::mesh::{Paths, check_size, default_count};
use super::query::{ApiQuery, CasePath, Checked, Numbers, check_depth};
use crate::caching::{EntityTag, IMMUTABLE, Representation, not_modified};
use crate::case::{CaseFacts, CaseId};
use crate::drawing::{Drawer, Drawing};
use crate::finish::{Story, finish};
use crate::models::{Model, PathKind};
use crate::negotiate::{Coding, media_type};
use crate::problem::{AppError, Problem};
use crate::state::AppState;

/// The media type of every picture.
pub(crate) const PNG: &str = "image/png";

/// The largest number of pixels of a picture.
pub(crate) const MAX_PIXELS: usize = 4096 * 4096;

/// The width and height where none is asked for.
pub(crate) fn default_side() -> u32 {
    512
}

/// The zoom that fits the head into the picture.
pub(crate) fn default_zoom() -> f64 {
    1.0
}

fn default_ambient() -> f64 {
    f64::from(Light::default().ambient())
}

/// A direction from which the head is seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum View {
    /// The patient's left side.
    Left,
    /// The patient's right side.
    Right,
    /// Facing the patient.
    Anterior,
    /// From behind.
    Posterior,
    /// From above.
    Superior,
    /// From below.
    Inferior,
}

impl From<View> for NamedView {
    fn from(view: View) -> Self {
        match view {
            View::Left => Self::Left,
            View::Right => Self::Right,
            View::Anterior => Self::Anterior,
            View::Posterior => Self::Posterior,
            View::Superior => Self::Superior,
            View::Inferior => Self::Inferior,
        }
    }
}

/// Who draws.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema, clap::ValueEnum,
)]
#[serde(rename_all = "lowercase")]
pub enum Renderer {
    /// What this server has that is best.
    #[default]
    Auto,
    /// Voxels of a thin shell, in software (the paper's section 3.3).
    Splat,
    /// The facets of the mesh.
    Mesh,
    /// Sphere tracing of the distance map.
    Trace,
}

/// How brightness becomes a colour.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema, clap::ValueEnum,
)]
#[serde(rename_all = "lowercase")]
pub enum Colors {
    /// Black to white.
    #[default]
    Grey,
    /// White to black.
    Inverted,
    /// Black, red, yellow, white.
    Hot,
    /// Dark blue, green, yellow.
    Viridis,
    /// Grey with a tinge of blue.
    Bone,
}

impl From<Colors> for ColorMap {
    fn from(colors: Colors) -> Self {
        match colors {
            Colors::Grey => Self::Grey,
            Colors::Inverted => Self::Inverted,
            Colors::Hot => Self::Hot,
            Colors::Viridis => Self::Viridis,
            Colors::Bone => Self::Bone,
        }
    }
}

/// What is behind the brain.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema, clap::ValueEnum,
)]
#[serde(rename_all = "lowercase")]
pub enum Background {
    /// Opaque black.
    #[default]
    Black,
    /// Nothing.
    Transparent,
}

impl From<Background> for render::Background {
    fn from(background: Background) -> Self {
        match background {
            Background::Black => Self::Black,
            Background::Transparent => Self::Transparent,
        }
    }
}

/// A picture of the isosurface.
#[derive(Debug, Clone, Serialize, Deserialize, IntoParams, ToSchema)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct RenderQuery {
    /// Depth below the envelope in mm; more than the case's maximum is clamped to it.
    #[serde(default)]
    #[param(minimum = 0, default = 0)]
    pub(crate) depth_mm: f32,
    /// A named direction: `left` where neither it nor `orientation` is given.
    #[param(inline)]
    pub(crate) view: Option<View>,
    /// The quaternion x,y,z,w from patient to view space (x right, y up, z to the viewer), instead of `view`.
    #[schema(value_type = Option<Vec<f64>>)]
    #[param(value_type = Option<String>, example = "0,0,0,1")]
    pub(crate) orientation: Option<Numbers<4>>,
    /// Who draws; `auto` takes what this server has, and the answer's header says which that was.
    #[serde(default)]
    #[param(inline)]
    pub(crate) renderer: Renderer,
    /// Pixels in a row.
    #[serde(default = "default_side")]
    #[param(minimum = 1, maximum = 4096, default = 512)]
    pub(crate) width: u32,
    /// Rows of pixels.
    #[serde(default = "default_side")]
    #[param(minimum = 1, maximum = 4096, default = 512)]
    pub(crate) height: u32,
    /// 1 fits the envelope's bounding sphere into the smaller side.
    #[serde(default = "default_zoom")]
    #[param(minimum = 0.01, maximum = 100, default = 1)]
    pub(crate) zoom: f64,
    /// Millimetres by which the head is moved to the right and up: `x,y`.
    #[schema(value_type = Option<Vec<f64>>)]
    #[param(value_type = Option<String>, example = "0,0")]
    pub(crate) pan: Option<Numbers<2>>,
    /// Window centre and width, in intensities: `c,w`; by default that of the case. As DICOM has it (LINEAR), the ramp from black
    /// to white is `w - 1` long and its middle is `c - 0.5`: 0 is black and 0.25 white in `0.625,1.25`. The width is at least 1.
    #[schema(value_type = Option<Vec<f64>>)]
    #[param(value_type = Option<String>, example = "80,120")]
    pub(crate) window: Option<Numbers<2>>,
    /// Colours for brightness.
    #[serde(default)]
    #[param(inline)]
    pub(crate) colormap: Colors,
    /// Intensities are averaged over this depth to either side, in mm.
    #[serde(default)]
    #[param(minimum = 0, maximum = 20, default = 0)]
    pub(crate) slab_mm: f64,
    /// The share of light that reaches every face; 1 turns the shading off.
    #[serde(default = "default_ambient")]
    #[param(minimum = 0, maximum = 1, default = 0.3)]
    pub(crate) ambient: f64,
    /// What is behind the brain.
    #[serde(default)]
    #[param(inline)]
    pub(crate) background: Background,
    /// Contours of the mesh, for the renderer `mesh`.
    #[serde(default = "default_count")]
    #[param(minimum = 3, maximum = 512, default = 30)]
    pub(crate) contours: usize,
    /// Points on each contour of the mesh, for the renderer `mesh`.
    #[serde(default = "default_count")]
    #[param(minimum = 3, maximum = 1024, default = 30)]
    pub(crate) points: usize,
    /// What the vertices of the mesh follow, for the renderer `mesh`.
    #[serde(default)]
    #[param(inline)]
    pub(crate) paths: Paths,
    /// Whether depth, window, scale, directions and the notice of research use are written into the picture.
    #[serde(default)]
    #[param(default = false)]
    pub(crate) annotate: bool,
}

impl Checked for RenderQuery {
    fn check(&self) -> Result<(), AppError> {
        check_depth(self.depth_mm)?;
        check_size(self.contours, self.points)?;
        if self.view.is_some() && self.orientation.is_some() {
            return Err(AppError::out_of_range(
                "orientation",
                "cannot be given together with `view`",
            ));
        }
        check_annotation(self.annotate, [self.width, self.height])?;
        // Any window and depth will do: those of the case are right by themselves.
        self.request(0.0, Window::between(0.0, 1.0)).map(drop)
    }
}

impl RenderQuery {
    /// The request to the renderer, at a depth that the case has, with `window` where the query names none.
    pub(crate) fn request(&self, depth_mm: f32, window: Window) -> Result<RenderRequest, AppError> {
        let camera = match self.orientation {
            Some(Numbers(orientation)) => Camera::new(orientation, 1.0, [0.0; 2])?,
            None => Camera::named(self.view.unwrap_or(View::Left).into()),
        };
        let pan_mm = self.pan.map_or([0.0; 2], |Numbers(pan)| pan);
        let parameters = RenderParameters {
            depth_mm: f64::from(depth_mm),
            camera: camera.with_zoom(self.zoom)?.with_pan_mm(pan_mm)?,
            size: picture_size(self.width, self.height)?,
            window: window_or(self.window, window)?,
            colormap: self.colormap.into(),
            slab_mm: self.slab_mm,
            light: Light::new(self.ambient)?,
            background: self.background.into(),
        };
        Ok(RenderRequest::new(parameters)?)
    }

    /// From where the head is seen: the name of the view, or the orientation.
    pub(crate) fn direction(&self) -> String {
        match (self.orientation, self.view) {
            (Some(Numbers([x, y, z, w])), _) => format!("{x:.2},{y:.2},{z:.2},{w:.2}"),
            (None, view) => NamedView::from(view.unwrap_or(View::Left))
                .name()
                .to_owned(),
        }
    }

    /// The mesh of the query.
    ///
    /// # Errors
    /// When there is no such mesh.
    pub(crate) fn mesh_size(&self) -> Result<MeshSize, AppError> {
        Ok(MeshSize::new(self.contours, self.points)?)
    }
}

impl From<RenderError> for AppError {
    fn from(error: RenderError) -> Self {
        let name = match error {
            RenderError::Parameter { name, .. } | RenderError::UnknownName { name, .. } => name,
            RenderError::TooManyContours { .. } => "depth_mm",
            _ => return Self::Internal,
        };
        // `window centre` and `window width` are both of the key `window`: the rest of the name stays in the sentence.
        let key = name.split(' ').next().unwrap_or(name);
        let text = error.to_string();
        let detail = match text.strip_prefix(key) {
            Some(rest) => rest.trim_start().to_owned(),
            None => text,
        };
        Self::Query {
            kind: "query-value-out-of-range",
            parameter: Cow::Borrowed(key),
            detail,
        }
    }
}

/// Whether what is to be written into a picture fits into it.
///
/// # Errors
/// [`AppError::Query`] for `annotate`.
pub(crate) fn check_annotation(annotate: bool, size: [u32; 2]) -> Result<(), AppError> {
    if annotate && size.iter().any(|&side| side < MIN_ANNOTATED_SIDE) {
        let detail = format!("needs a picture of at least {MIN_ANNOTATED_SIDE} pixels a side");
        return Err(AppError::out_of_range("annotate", detail));
    }
    Ok(())
}

/// A size that is accepted.
///
/// # Errors
/// [`AppError::Query`] that names the side.
pub(crate) fn picture_size(width: u32, height: u32) -> Result<FrameSize, AppError> {
    let size = FrameSize::new(width, height)?;
    if size.pixel_count() > MAX_PIXELS {
        let detail = format!("times `height` must be at most {MAX_PIXELS} pixels");
        return Err(AppError::out_of_range("width", detail));
    }
    Ok(size)
}

/// The window of a query, or that of the case.
///
/// # Errors
/// [`AppError::Query`] that names `window`.
pub(crate) fn window_or(asked: Option<Numbers<2>>, default: Window) -> Result<Window, AppError> {
    match asked {
        Some(Numbers([centre, width])) => Ok(Window::new(centre, width)?),
        None => Ok(default),
    }
}

/// The case's own window: its ramp runs over the interval that the facts hold.
pub(crate) fn window_of(facts: &CaseFacts) -> Window {
    let half = facts.window.width / 2.0;
    Window::between(facts.window.center - half, facts.window.center + half)
}

/// A picture of the isosurface at a depth
#[utoipa::path(
    get, path = "/v1/cases/{id}/render", tag = "pictures",
    params(("id" = String, Path, description = "The case"), RenderQuery),
    responses(
        (status = 200, description = "The picture", body = Vec<u8>, content_type = "image/png", headers(
            ("X-Isocortex-Renderer" = String, description = "Who drew: `splat`, `mesh` or `trace`"),
            ("X-Isocortex-Device" = String, description = "What drew: `cpu`, or the graphics adapter; `cpu` also where that failed at this picture"),
            ("X-Isocortex-Reduction" = String, description = "Where the volume is too large for the device: how many of its voxels became one, as 2x2x1"),
            ("X-Isocortex-Depth-Mm" = f32, description = "The depth of this picture"),
            ("X-Isocortex-Depth-Clamped" = bool, description = "Whether more than the maximum was asked for"),
        )),
        (status = 304, description = "The client has it already"),
        (status = 400, description = "A key or value of the query is wrong", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "No such case", body = Problem, content_type = "application/problem+json"),
        (status = 406, description = "PNG is not accepted", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "The case is not ready", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Too much work waits", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn get_render(
    State(state): State<AppState>,
    CasePath(id): CasePath,
    ApiQuery(query): ApiQuery<RenderQuery>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    media_type(&request, &[PNG])?;
    let facts = state.ready(&id).await?;
    let drawer = Drawer::choose(query.renderer, &state.graphics).await;
    let tag = tag_of(&id, &query, &drawer);
    if tag.is_known_to(&request) {
        return Ok(not_modified(&tag, "accept", IMMUTABLE));
    }
    let model = state.model(&id).await?;
    let drawing = drawing(&state, &model, &query, drawer).await?;
    let story = Story::of(Some(&id), &drawing.request, &model.scene());
    let annotate = query.annotate;
    let work = move |is_wanted: &Wanted<'_>| {
        drawing
            .draw(is_wanted)
            .and_then(|drawn| finish(drawn, &story, annotate))
    };
    let finished = state.pool.run_while(work).await??;
    let mut headers = depth_headers(query.depth_mm, facts.max_depth_mm);
    finished.describe(&mut headers);
    Representation {
        headers,
        vary: "accept",
        ..Representation::immutable(tag_of(&id, &query, &finished.drawer), PNG, finished.png)
    }
    .respond(&request)
}

/// The tag of a picture: renderers differ in their pixels, and graphics devices, too.
fn tag_of(id: &CaseId, query: &RenderQuery, drawer: &Drawer) -> EntityTag {
    EntityTag::of_answer(id, "render", query, (&drawer.tag(), Coding::Identity))
}

/// Gets everything ready that a picture needs.
///
/// # Errors
/// When the mesh cannot be had, or too much work waits.
pub(crate) async fn drawing(
    state: &AppState,
    model: &Arc<Model>,
    query: &RenderQuery,
    drawer: Drawer,
) -> Result<Drawing, AppError> {
    let depth_mm = query.depth_mm.min(model.facts.max_depth_mm);
    let mesh = if drawer.wants_mesh() {
        let size = query.mesh_size()?;
        let kind = PathKind::from(query.paths);
        let shrunk = model.shrink(size, kind, depth_mm);
        let shrunk = if model.has_at_hand(size, kind) {
            shrunk.await?
        } else {
            state.turnstile.pass(shrunk).await??
        };
        Some((size, shrunk))
    } else {
        None
    };
    Ok(Drawing {
        case: Arc::clone(model) as Arc<dyn GpuCase>,
        request: query.request(depth_mm, window_of(&model.facts))?,
        asked: query.renderer,
        drawer,
        mesh,
    })
}

/// What every picture names as its maker.
pub(crate) const SOFTWARE: &str = concat!("Isocortex ", env!("CARGO_PKG_VERSION"));
