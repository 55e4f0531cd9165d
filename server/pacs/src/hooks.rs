//! Notices of a PACS that a series is complete there.

use axum::body::Bytes;
use axum::extract::State;
use axum::extract::rejection::BytesRejection;
use axum::response::Response;
use serde::Deserialize;
use utoipa::ToSchema;

use crate::retrievals::{RetrievalView, queue};
use crate::state::Pacs;
use http::problem::AppError;
use http::sent::json_body;

/// A series that has come to Orthanc.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct StableSeries {
    /// The name under which the configuration knows this Orthanc as a node.
    node: String,
    /// The Study Instance UID.
    #[serde(rename = "StudyInstanceUID")]
    study: String,
    /// The Series Instance UID.
    #[serde(rename = "SeriesInstanceUID")]
    series: String,
}

/// Notice of a stable series
///
/// Orthanc sends it when nothing has come for a series for a while (`OnStableSeries`). The series is then fetched. A
/// notice that comes early or twice does no harm: images that are here already change nothing, and late ones make a new
/// version of the case.
#[utoipa::path(
    post, path = "/hooks/orthanc", tag = "pacs",
    request_body = StableSeries,
    responses(
        (status = 202, description = "The series will be fetched", body = RetrievalView, headers(
            ("Location" = String, description = "The address of the retrieval"),
        )),
        (status = 400, description = "The body cannot be read"),
        (status = 404, description = "No node has this name"),
        (status = 422, description = "The node has no DICOMweb (`node-without-dicomweb`), or the server keeps no identity (`deidentified`)"),
    )
)]
pub(crate) async fn stable_series(
    State(pacs): State<Pacs>,
    body: Result<Bytes, BytesRejection>,
) -> Result<Response, AppError> {
    let notice: StableSeries = json_body(body)?;
    queue(&pacs, &notice.node, &notice.study, &notice.series).await
}
