//! Pictures of slices with the contours of isosurfaces.

use std::sync::Arc;

use axum::extract::{RawPathParams, State};
use axum::http::HeaderMap;
use axum::response::Response;
use bytes::Bytes;
use render::{ColorMap, Scene, SliceConvention, SliceParameters, SlicePlane, SliceRequest, Window};
use serde::{Deserialize, Serialize};
use utoipa::IntoParams;

use super::query::{ApiQuery, Asked, CasePath};
use super::render::{PNG, format_with_layers};
use case::CaseFacts;
use cases::Cases;
use cases::pictures::{
    DepthMm, LayerChoice, LayerRef, NumberList, Numbers, PictureLayers, check_annotation,
    default_side, default_zoom, picture_size, window_of, window_of_numbers,
};
use http_support::conditional::Question;
use http_support::negotiate::media_type;
use http_support::problem::{AppError, Problem};

/// A picture of a slice.
#[derive(Debug, Clone, Serialize, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct SliceQuery {
    /// The LPS coordinate across the plane, in mm; by default the middle of the grid.
    position_mm: Option<f64>,
    /// Depths in mm of the contours: at most 16, separated by commas.
    #[serde(default)]
    #[param(value_type = Option<String>, example = "5,10")]
    depth_mm: NumberList,
    /// Width in pixels.
    #[serde(default = "default_side")]
    #[param(minimum = 1, maximum = 4096, default = 512)]
    width: u32,
    /// Height in pixels.
    #[serde(default = "default_side")]
    #[param(minimum = 1, maximum = 4096, default = 512)]
    height: u32,
    /// 1 shows the slice at the scale of a render.
    #[serde(default = "default_zoom")]
    #[param(minimum = 0.01, maximum = 100, default = 1)]
    zoom: f64,
    /// The shift of the slice to the right and up, in mm: `x,y`.
    #[param(value_type = Option<String>, example = "0,0")]
    pan: Option<Numbers<2>>,
    /// Window centre and width, in intensities: `c,w`; by default from the case. As in DICOM (LINEAR), the ramp from
    /// black to white is `w - 1` long and its middle is `c - 0.5`: 0 is black and 0.25 white in `0.625,1.25`. The width
    /// is at least 1.
    #[param(value_type = Option<String>, example = "80,120")]
    window: Option<Numbers<2>>,
    /// The colour map.
    #[serde(default)]
    #[param(inline)]
    colormap: ColorMap,
    /// On which side of axial and coronal slices the patient's left is: at the right (radiological) or at the left.
    #[serde(default, skip_serializing_if = "SliceConvention::is_default")]
    #[param(inline)]
    convention: SliceConvention,
    /// Whether to draw the label, day and short id of the case, position, window, scale, depths of the contours,
    /// directions and the notice into the picture.
    #[serde(default)]
    #[param(default = false)]
    annotate: bool,
    /// The layer to show instead of the intensities: the name of a map, or the name or id of an added layer. `window`
    /// then refers to its values.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[param(value_type = Option<String>, example = "FLAIR")]
    layer: Option<LayerRef>,
    /// The layer to show in colours over the grey texture: the name of a map, or the name or id of an added layer.
    /// Undefined parts are transparent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[param(value_type = Option<String>, example = "blur")]
    overlay: Option<LayerRef>,
    /// The values of the first and last colour of the overlay: `low,high`; by default from the layer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[param(value_type = Option<String>, example = "2.5,5")]
    overlay_window: Option<Numbers<2>>,
    /// The colours of the overlay; by default from the layer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[param(inline)]
    overlay_colormap: Option<ColorMap>,
    /// Values of the overlay up to this are transparent; for diverging colours, magnitudes. Above it, the overlay fades
    /// in over a tenth of its window. By default from the layer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    overlay_threshold: Option<f64>,
    /// The opacity of the overlay, 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[param(minimum = 0, maximum = 1)]
    overlay_opacity: Option<f64>,
    /// Whether the overlay is drawn as its edges alone: lines where its values rise steepest within its window. Its
    /// colours, threshold and opacity do not matter then. A label map has no edges.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    #[param(default = false)]
    edges: bool,
}

impl SliceQuery {
    fn layers(&self) -> LayerChoice {
        LayerChoice {
            layer: self.layer.clone(),
            overlay: self.overlay.clone(),
            overlay_window: self.overlay_window,
            overlay_colormap: self.overlay_colormap,
            overlay_threshold: self.overlay_threshold,
            overlay_opacity: self.overlay_opacity,
        }
    }
}

/// A checked request for a slice.
#[derive(Debug)]
pub struct SliceValues {
    /// The position; by default the middle of the case.
    position_mm: Option<f64>,
    /// The window; by default from the layer or the case.
    window: Option<Window>,
    /// The layers.
    layers: LayerChoice,
    /// All other values, for the axial plane through the origin.
    request: SliceRequest,
}

impl Asked for SliceQuery {
    type Values = SliceValues;

    fn checked(&self) -> Result<SliceValues, AppError> {
        if self.position_mm.is_some_and(|mm| !mm.is_finite()) {
            let detail = "must be a finite number of mm";
            return Err(AppError::out_of_range("position_mm", detail));
        }
        for &depth_mm in &self.depth_mm.0 {
            DepthMm::check_sign(depth_mm)?;
        }
        check_annotation(self.annotate, [self.width, self.height])?;
        let layers = self.layers();
        layers.check()?;
        if self.edges && self.overlay.is_none() {
            return Err(AppError::out_of_range("edges", "needs `overlay`"));
        }
        let window = self.window.map(window_of_numbers).transpose()?;
        let request = SliceRequest::new(SliceParameters {
            plane: SlicePlane::Axial,
            convention: self.convention,
            position_mm: self.position_mm.unwrap_or(0.0),
            depths_mm: self.depth_mm.0.clone(),
            zoom: self.zoom,
            pan_mm: self.pan.map_or([0.0; 2], |Numbers(pan)| pan),
            size: picture_size(self.width, self.height)?,
            window: window.unwrap_or_else(|| Window::between(0.0, 1.0)),
            colormap: self.colormap,
            has_edges: self.edges,
        })?;
        Ok(SliceValues {
            position_mm: self.position_mm,
            window,
            layers,
            request,
        })
    }
}

impl SliceValues {
    /// The slice of a case.
    fn of_case(self, plane: SlicePlane, facts: &CaseFacts, layers: &PictureLayers) -> SliceRequest {
        let middle_mm = || middle_mm(facts, plane.axis());
        let position_mm = self.position_mm.unwrap_or_else(middle_mm);
        let usual = || layers.window.unwrap_or_else(|| window_of(facts));
        let window = self.window.unwrap_or_else(usual);
        self.request.shown(plane, position_mm, window)
    }
}

/// The coordinate of the middle of the working grid along a patient axis.
fn middle_mm(facts: &CaseFacts, axis: usize) -> f64 {
    let row = facts.patient_from_voxel[axis];
    let centres = facts.grid_size.map(|side| (side - 1) as f64 / 2.0);
    row[0] * centres[0] + row[1] * centres[1] + row[2] * centres[2] + row[3]
}

/// A slice through the whole acquired volume, with the contours of isosurfaces
#[utoipa::path(
    get, path = "/v1/cases/{id}/slices/{plane}", tag = "pictures",
    params(
        ("id" = String, Path, description = "The case"),
        ("plane" = inline(SlicePlane), Path, description = "The orientation of the slice"),
        SliceQuery,
    ),
    responses(
        (status = 200, description = "The picture", body = Vec<u8>, content_type = "image/png"),
        (status = 304, description = "The client already has this answer"),
        (status = 400, description = "A key or value of the query is invalid", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "No such case or plane", body = Problem, content_type = "application/problem+json"),
        (status = 406, description = "PNG is not accepted", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "The case is not ready", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Too much work is waiting", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn get_slice(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    path: RawPathParams,
    ApiQuery { asked, values }: ApiQuery<SliceQuery>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    media_type(&request, &[PNG])?;
    let plane = plane_of(&path)?;
    let question = Question {
        id,
        route: "slices",
        query: &asked,
        request: &request,
    };
    let named = cases.identity(&id, asked.annotate).await?;
    let chosen = values.layers.of_case(&cases.library, &id).await?;
    if asked.edges && chosen.has_labels_above() {
        let detail = "is not possible for a label map, because labels have no edges; choose another `overlay`";
        return Err(AppError::out_of_range("edges", detail));
    }
    let work = async |facts: Arc<CaseFacts>| {
        let layers = chosen.load(&cases.library, &id).await?;
        let slice = values.of_case(plane, &facts, &layers);
        let layers = layers.keyed;
        let model = cases.model(&id).await?;
        let volume = cases.whole_volume(&id).await?;
        let (case, named) = (id.to_string(), named.clone());
        let picture = cases.queue.run(move || {
            let scene = Scene {
                volume: &volume,
                ..model.scene().with_layers(layers.layers())
            };
            draw(&scene, (&case, &slice), named.as_deref())
        });
        Ok(Bytes::from(picture.await??).into())
    };
    let format = format_with_layers(plane.name().to_owned(), chosen.version()).named(named.clone());
    question.answer(&cases, format, work).await
}

/// The plane that a path names.
pub(super) fn plane_of(path: &RawPathParams) -> Result<SlicePlane, AppError> {
    let plane = path.iter().find(|(name, _)| *name == "plane");
    plane
        .and_then(|(_, text)| text.parse().ok())
        .ok_or(AppError::NoSuchRoute)
}

/// Draws a slice; with `named`, annotated.
fn draw(
    scene: &Scene<'_>,
    (case, request): (&str, &SliceRequest),
    named: Option<&str>,
) -> Result<Vec<u8>, AppError> {
    let mut frame = render::draw_slice(scene, request);
    if named.is_some() {
        frame = render::annotate_slice(
            frame,
            request,
            &request.projection(&scene.bounds),
            &scene.layers,
            named,
        );
    }
    let mut texts = render::slice_texts(case, request, &scene.layers);
    texts.retain(|(_, text)| !text.is_empty());
    Ok(render::encode_png(&frame, &texts)?)
}
