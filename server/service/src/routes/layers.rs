//! The layers of a case: its maps and the volumes that were added, as a list, as voxels and as NIfTI.

mod events;
mod view;
mod voxels;

use axum::body::Bytes;
use axum::extract::rejection::BytesRejection;
use axum::extract::{RawPathParams, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse as _, Response};
use case::{JunctionBandFacts, Layer, LayerChange, MapName, QualityState};
use cases::library::{FlairState, MapsState};
use cases::pictures::{LayerRef, NO_FLAIR};
use cases::{Cases, Error};
use serde::Serialize;
use utoipa::ToSchema;

use crate::routes::asked::CasePath;
use http::fresh::fresh_json;
use http::problem::AppError;
use http::query::{ApiQuery, NoQuery};
use http::sent::json_body;

pub use self::events::{__path_get_layer_events, get_layer_events};
pub use self::view::{LayerGrid, LayerState, LayerView, MapsStateName, MapsView};
pub use self::voxels::{
    __path_get_layer_nifti, __path_get_layer_volume, get_layer_nifti, get_layer_volume,
};

/// The layers of a case.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct LayerList {
    /// The layers that `layer` and `overlay` can show in pictures: the maps, `flair` only if a layer is one, then the added layers
    /// in their order.
    layers: Vec<LayerView>,
    /// How slantwise the isosurfaces meet the junction of grey and white matter of the cerebrum, from the surface inwards. Empty
    /// until the maps are ready. If the regions are in doubt, the whole brain counts.
    junction_by_depth: Vec<JunctionBandFacts>,
    /// The share of that junction that isosurfaces meet at less than 30° or that lies deeper than 30 mm, 0 to 1. Absent until the
    /// maps are ready, and if the regions are in doubt.
    #[serde(skip_serializing_if = "Option::is_none")]
    junction_poorly_met: Option<f32>,
}

/// The layers of a case
///
/// The maps of the junction of grey and white matter, which are computed once after the case is ready, the map of the newest
/// FLAIR, if there is one, and the layers that were added, in their order. While the case is being prepared, all of them wait.
#[utoipa::path(
    get, path = "/v1/cases/{id}/layers", tag = "layers",
    params(("id" = String, Path, description = "The case")),
    responses(
        (status = 200, description = "The layers", body = LayerList),
        (status = 422, description = "The case could not be prepared"),
    )
)]
pub async fn list_layers(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    _no_query: ApiQuery<NoQuery>,
) -> Result<Response, AppError> {
    let (maps, flair) = match cases.ready(&id).await {
        Ok(_) => (
            cases.library.maps(&id).await?,
            cases.library.flair(&id).await?,
        ),
        // Layers that wait for the case are listed, too.
        Err(Error::NotReady { .. }) => (MapsState::Making, None),
        Err(error) => return Err(error.into()),
    };
    let (junction_by_depth, junction_poorly_met) = match &maps {
        MapsState::Ready(maps) => {
            let bands = maps.junction_by_depth.clone();
            let is_known = maps.regions.state == QualityState::Ok;
            let share = JunctionBandFacts::poorly_met_share(&bands);
            (bands, share.filter(|_| is_known))
        }
        _ => (Vec::new(), None),
    };
    let state = MapsView::from(&maps);
    let maps = MapName::OF_CASE.map(|name| LayerView::of_map((&id, name), &state));
    let flair = flair.map(|flair| LayerView::of_flair(&id, &flair));
    let added = cases.layers(&id).await?;
    let added = added.iter().map(LayerView::of_layer);
    let layers = maps.into_iter().chain(flair).chain(added).collect();
    let list = LayerList {
        layers,
        junction_by_depth,
        junction_poorly_met,
    };
    Ok(fresh_json(StatusCode::OK, &list))
}

/// A layer of a case
#[utoipa::path(
    get, path = "/v1/cases/{id}/layers/{layer}", tag = "layers",
    params(
        ("id" = String, Path, description = "The case"),
        ("layer" = String, Path, description = "The name of a map, or the id or name of an added layer"),
    ),
    responses(
        (status = 200, description = "The layer", body = LayerView),
        (status = 404, description = "No such case or layer"),
        (status = 409, description = "The case is not ready"),
    )
)]
pub async fn get_layer(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    path: RawPathParams,
    _no_query: ApiQuery<NoQuery>,
) -> Result<Response, AppError> {
    let view = match map_of(&path) {
        Some(MapName::Flair) => {
            cases.ready(&id).await?;
            let none = || FlairState {
                layer: None,
                state: MapsState::Undefined(NO_FLAIR),
            };
            let flair = cases.library.flair(&id).await?;
            LayerView::of_flair(&id, &flair.unwrap_or_else(none))
        }
        Some(name) => {
            cases.ready(&id).await?;
            let state = MapsView::from(&cases.library.maps(&id).await?);
            LayerView::of_map((&id, name), &state)
        }
        None => LayerView::of_layer(&cases.layer(&id, &layer_of(&path)?).await?),
    };
    Ok(fresh_json(StatusCode::OK, &view))
}

/// Rename or move a layer, or state its contrast
///
/// Another name, another place in the list, or another contrast. Another placement in the head is another layer: add it again with its
/// `transform`.
#[utoipa::path(
    patch, path = "/v1/cases/{id}/layers/{layer}", tag = "layers",
    params(
        ("id" = String, Path, description = "The case"),
        ("layer" = String, Path, description = "The id or name of an added layer"),
    ),
    request_body = LayerChange,
    responses(
        (status = 200, description = "The layer as it is now", body = LayerView),
        (status = 400, description = "The body is invalid"),
        (status = 404, description = "No such case or added layer"),
        (status = 409, description = "Another layer of the case has the name"),
        (status = 422, description = "The name cannot be used, or the layer has no contrast because it is not MR"),
    )
)]
pub async fn patch_layer(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    path: RawPathParams,
    _no_query: ApiQuery<NoQuery>,
    body: Result<Bytes, BytesRejection>,
) -> Result<Response, AppError> {
    let layer = cases.layer(&id, &layer_of(&path)?).await?;
    let change: LayerChange = json_body(body)?;
    let changed = cases.change_layer(&id, &layer.id, &change).await?;
    Ok(fresh_json(StatusCode::OK, &LayerView::of_layer(&changed)))
}

/// Delete a layer
///
/// Removes an added layer. Pictures that are being drawn with it are finished.
#[utoipa::path(
    delete, path = "/v1/cases/{id}/layers/{layer}", tag = "layers",
    params(
        ("id" = String, Path, description = "The case"),
        ("layer" = String, Path, description = "The id or name of an added layer"),
    ),
    responses(
        (status = 204, description = "It is removed"),
        (status = 404, description = "No such case or added layer"),
    )
)]
pub async fn delete_layer(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    path: RawPathParams,
    _no_query: ApiQuery<NoQuery>,
) -> Result<Response, AppError> {
    let layer = cases.layer(&id, &layer_of(&path)?).await?;
    cases.delete_layer(&id, &layer.id).await?;
    Ok(StatusCode::NO_CONTENT.into_response())
}

/// The address of an added layer.
pub(super) fn address_of(layer: &Layer) -> String {
    format!("/v1/cases/{}/layers/{}", layer.case, layer.id)
}

fn text_of(path: &RawPathParams) -> &str {
    let layer = path.iter().find(|(name, _)| *name == "layer");
    layer.map_or("", |(_, text)| text)
}

/// The map that the path names, if it names one.
fn map_of(path: &RawPathParams) -> Option<MapName> {
    MapName::from_name(text_of(path))
}

/// The layer that the path names.
fn layer_of(path: &RawPathParams) -> Result<LayerRef, AppError> {
    let name = text_of(path).parse();
    Ok(name.map_err(|_| Error::NoSuchLayer)?)
}
