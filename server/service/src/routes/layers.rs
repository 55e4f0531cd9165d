//! The layers of a case, at present its maps: as a list, as voxels and as NIfTI.

use std::sync::Arc;

use axum::extract::{RawPathParams, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::Response;
use bytes::Bytes;
use serde::Serialize;
use utoipa::ToSchema;

use super::bodies::{Bodies, BodyKey, BodyKind};
use super::fresh::fresh_json;
use super::query::{ApiQuery, CasePath, NoQuery};
use super::textures::{MEDIA_TYPE, layout};
use crate::conditional::{self, Content, Format, Question};
use crate::negotiate::{GZIP, media_type};
use crate::problem::{AppError, Problem};
use crate::wire;
use case::MapName;
use cases::library::{LoadedMaps, MapsState};
use cases::pictures::{MAPS_OFF, MapStyle, maps_of};
use cases::{Cases, Error};
use pipeline::maps::{MAPS_FORMAT, map_unit};
use render::{ColorMap, LayerValues};

/// The layers of a case.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct LayerList {
    /// The layers that `layer` and `overlay` can show in pictures.
    layers: Vec<LayerView>,
}

/// A layer of a case.
#[derive(Debug, Clone, Serialize, ToSchema)]
#[schema(as = Layer)]
pub struct LayerView {
    /// The name for `layer`, `overlay` and addresses.
    name: MapName,
    /// `map`: computed from the case itself.
    kind: &'static str,
    /// The unit of its values: `1/mm`, `z`, or empty.
    unit: &'static str,
    /// `ready`, `making`, `undefined` or `off`.
    state: MapsStateName,
    /// The reason why it is undefined or off.
    #[serde(skip_serializing_if = "Option::is_none")]
    reason: Option<String>,
    /// The default values of the first and the last colour.
    window: [f64; 2],
    /// Its default colours.
    colormap: ColorMap,
    /// The default threshold: values up to this are transparent; for diverging colours, magnitudes. Absent if every
    /// value is shown.
    #[serde(skip_serializing_if = "Option::is_none")]
    threshold: Option<f64>,
    /// The default opacity.
    opacity: f64,
    /// The version of the maps.
    format: u32,
}

/// The state of the maps of a case.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum MapsStateName {
    /// They are available.
    Ready,
    /// They are being computed; try again in a moment.
    Making,
    /// They are undefined for this head.
    Undefined,
    /// This server computes none.
    Off,
}

/// The state of the maps of a case, and the reason if there are none.
#[derive(Debug, Clone, Serialize, ToSchema)]
#[schema(as = MapsState)]
pub struct MapsView {
    /// `ready`, `making`, `undefined` or `off`.
    state: MapsStateName,
    /// The reason why they are undefined or off.
    #[serde(skip_serializing_if = "Option::is_none")]
    reason: Option<String>,
}

impl From<&MapsState> for MapsView {
    fn from(state: &MapsState) -> Self {
        let (state, reason) = match state {
            MapsState::Ready(_) => (MapsStateName::Ready, None),
            MapsState::Making => (MapsStateName::Making, None),
            MapsState::Undefined(reason) => (MapsStateName::Undefined, Some(reason.to_string())),
            MapsState::Off => (MapsStateName::Off, Some(MAPS_OFF.to_owned())),
        };
        Self { state, reason }
    }
}

/// The layers of a case
///
/// The maps of the junction of grey and white matter, which are computed once after the case is ready.
#[utoipa::path(
    get, path = "/v1/cases/{id}/layers", tag = "layers",
    params(("id" = String, Path, description = "The case")),
    responses(
        (status = 200, description = "The layers", body = LayerList),
        (status = 404, description = "No such case", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "The case is not ready", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn list_layers(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    _no_query: ApiQuery<NoQuery>,
) -> Result<Response, AppError> {
    cases.ready(&id).await?;
    let state = MapsView::from(&cases.library.maps(&id).await?);
    let layers = MapName::ALL.map(|name| LayerView::of(name, &state)).into();
    Ok(fresh_json(StatusCode::OK, &LayerList { layers }))
}

/// A layer of a case
#[utoipa::path(
    get, path = "/v1/cases/{id}/layers/{layer}", tag = "layers",
    params(
        ("id" = String, Path, description = "The case"),
        ("layer" = inline(MapName), Path, description = "The layer"),
    ),
    responses(
        (status = 200, description = "The layer", body = LayerView),
        (status = 404, description = "No such case or layer", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "The case is not ready", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn get_layer(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    path: RawPathParams,
    _no_query: ApiQuery<NoQuery>,
) -> Result<Response, AppError> {
    let name = layer_of(&path)?;
    cases.ready(&id).await?;
    let state = MapsView::from(&cases.library.maps(&id).await?);
    Ok(fresh_json(StatusCode::OK, &LayerView::of(name, &state)))
}

impl LayerView {
    fn of(name: MapName, maps: &MapsView) -> Self {
        let style = MapStyle::of(name);
        Self {
            name,
            kind: "map",
            unit: map_unit(name),
            state: maps.state,
            reason: maps.reason.clone(),
            window: style.window,
            colormap: style.colormap,
            threshold: style.threshold,
            opacity: style.opacity,
            format: MAPS_FORMAT,
        }
    }
}

/// The layer that the path names.
fn layer_of(path: &RawPathParams) -> Result<MapName, AppError> {
    let layer = path.iter().find(|(name, _)| *name == "layer");
    let layer = layer.and_then(|(_, text)| MapName::from_name(text));
    layer.ok_or(AppError::NoSuchLayer)
}

/// The voxels of a layer
///
/// One byte per voxel, x-fastest, on a block of the grid of the volume: 0 is undefined, and a code of 1 to 255 has the value code
/// × scale + offset. The headers give scale and offset. Interpolate between defined voxels only.
#[utoipa::path(
    get, path = "/v1/cases/{id}/layers/{layer}/volume", tag = "layers",
    params(
        ("id" = String, Path, description = "The case"),
        ("layer" = inline(MapName), Path, description = "The layer"),
    ),
    responses(
        (status = 200, description = "The voxels", body = Vec<u8>, content_type = "application/octet-stream", headers(
            ("X-Isocortex-Size" = String, description = "Voxels along x, y and z: `181,217,181`"),
            ("X-Isocortex-Format" = String, description = "`u8`"),
            ("X-Isocortex-Scale" = f32, description = "Value of a step from one code to the next"),
            ("X-Isocortex-Offset" = f32, description = "Value that code 0 would have, although it means undefined"),
            ("X-Isocortex-Undefined" = u8, description = "The code of undefined voxels: 0"),
            ("X-Isocortex-Patient-From-Voxel" = String, description = "Three rows of the affine from voxel centres to LPS mm"),
        )),
        (status = 206, description = "The requested range"),
        (status = 304, description = "The client already has this answer"),
        (status = 404, description = "No such case or layer", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "The case or the layer is not ready, or the layer is undefined", body = Problem, content_type = "application/problem+json"),
        (status = 416, description = "The range begins beyond the end", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Too much work is waiting", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn get_layer_volume(
    State(cases): State<Cases>,
    State(bodies): State<Bodies>,
    CasePath(id): CasePath,
    path: RawPathParams,
    ApiQuery { asked: query, .. }: ApiQuery<NoQuery>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    let name = layer_of(&path)?;
    media_type(&request, &[MEDIA_TYPE])?;
    let question = Question {
        id,
        route: "layers/volume",
        query: &query,
        request: &request,
    };
    let format = Format::compressed(MEDIA_TYPE, &request)
        .variant(variant(name))
        .revalidated();
    let coding = format.coding();
    let work = async |_| {
        let maps = maps_of(&cases.library, &id).await?;
        let texture = wire::layer_texture(maps.grid(), maps.layer(name));
        let mut headers = layout(&texture);
        let undefined = header::HeaderName::from_static("x-isocortex-undefined");
        conditional::insert(&mut headers, undefined, "0");
        let key = BodyKey {
            id,
            kind: BodyKind::Layer(name),
            coding,
        };
        let voxels = std::future::ready(Ok::<_, AppError>(texture.voxels));
        let body = bodies.get(key, voxels, wire::Voxels::bytes).await?;
        Ok(Content {
            headers,
            ..body.into()
        })
    };
    question.answer(&cases, format, work).await
}

/// Distinguishes answers with different versions of a map.
fn variant(name: MapName) -> String {
    format!("{} {MAPS_FORMAT}", name.name())
}

/// A layer as NIfTI
///
/// A gzipped NIfTI-1 file on a block of the grid of the volume, in single precision, NaN if undefined, positioned in the patient.
#[utoipa::path(
    get, path = "/v1/cases/{id}/layers/{layer}/nifti", tag = "layers",
    params(
        ("id" = String, Path, description = "The case"),
        ("layer" = inline(MapName), Path, description = "The layer"),
    ),
    responses(
        (status = 200, description = "The layer (.nii.gz)", body = Vec<u8>, content_type = "application/gzip"),
        (status = 206, description = "The requested range"),
        (status = 304, description = "The client already has this answer"),
        (status = 404, description = "No such case or layer", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "The case or the layer is not ready, or the layer is undefined", body = Problem, content_type = "application/problem+json"),
        (status = 416, description = "The range begins beyond the end", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Too much work is waiting", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn get_layer_nifti(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    path: RawPathParams,
    ApiQuery { asked: query, .. }: ApiQuery<NoQuery>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    let name = layer_of(&path)?;
    media_type(&request, &[GZIP])?;
    let question = Question {
        id,
        route: "layers/nifti",
        query: &query,
        request: &request,
    };
    let format = Format::of(GZIP).variant(variant(name)).revalidated();
    let work = async |_| {
        let maps = maps_of(&cases.library, &id).await?;
        let file = cases.queue.run(move || nifti(&maps, name)).await??;
        let mut headers = HeaderMap::new();
        let disposition = format!("attachment; filename=\"{}.nii.gz\"", name.name());
        conditional::insert(&mut headers, header::CONTENT_DISPOSITION, &disposition);
        Ok(Content {
            headers,
            ..Bytes::from(file).into()
        })
    };
    question.answer(&cases, format, work).await
}

fn nifti(maps: &Arc<LoadedMaps>, name: MapName) -> Result<Vec<u8>, Error> {
    let numbers = match maps.layer(name).values() {
        LayerValues::Numbers(numbers) => numbers.clone(),
        LayerValues::Codes { codes, least, step } => {
            let value = |&code: &u8| match code {
                0 => f32::NAN,
                code => least + f32::from(code - 1) * step,
            };
            codes.iter().map(value).collect()
        }
    };
    imaging::nifti::write_numbers(maps.grid(), &numbers).map_err(|_| Error::Internal)
}
