//! Requests to fetch series from a node.

use axum::body::Bytes;
use axum::extract::rejection::BytesRejection;
use axum::extract::{Path, State};
use axum::http::StatusCode;
use axum::response::Response;
use case::series::{SeriesQuery, SeriesUids, Uid};
use case::{CaseId, JobState};
use serde::{Deserialize, Serialize};
use storage::tables::jobs;
use storage::{Job, is_id};
use utoipa::ToSchema;

use crate::error::ReasonView;
use crate::fetch::{FETCH, Received, Wanted};
use crate::state::Pacs;
use crate::values::ArrivalState;
use http::fresh::{fresh_json, made_at};
use http::problem::AppError;
use http::sent::json_body;

/// A series to be fetched.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct RetrievalRequest {
    /// The name of a node in the configuration.
    node: String,
    /// The Study Instance UID.
    study: String,
    /// The Series Instance UID.
    series: String,
}

/// A retrieval and how far it is. Its UIDs are patient data.
#[derive(Debug, Clone, Serialize, ToSchema)]
#[schema(as = Retrieval)]
pub(crate) struct RetrievalView {
    /// Its name in addresses.
    id: String,
    /// The node.
    node: String,
    /// The Study Instance UID.
    study: String,
    /// The Series Instance UID.
    series: String,
    /// `queued`, `running`, `done` or `failed`.
    state: &'static str,
    /// The reason, if it failed, or if nothing became of the series that it fetched, such as `rejected`.
    #[serde(skip_serializing_if = "Option::is_none")]
    reason: Option<ReasonView>,
    /// Attempts so far.
    attempts: u32,
    /// Images so far.
    received: usize,
    /// How many the node has, once it is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    expected: Option<usize>,
    /// The series that came.
    #[serde(skip_serializing_if = "Option::is_none")]
    arrival: Option<String>,
    /// The case that the series became, or of which it became a layer, once it was fetched and read. Absent while the series is
    /// still read, if nothing became of it, and if the case is closed.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>)]
    case: Option<CaseId>,
}

/// Fetch a series
///
/// Queues the retrieval of a series from a node of the configuration, by QIDO-RS and WADO-RS.
#[utoipa::path(
    post, path = "/v1/retrievals", tag = "pacs",
    request_body = RetrievalRequest,
    responses(
        (status = 202, description = "It is queued, or was already", body = RetrievalView, headers(
            ("Location" = String, description = "The address of its state"), ("Retry-After" = u32, description = "Seconds to wait before the first request for it"),
        )),
        (status = 400, description = "The body cannot be read"),
        (status = 404, description = "No node has this name"),
        (status = 422, description = "The node has no DICOMweb (`node-without-dicomweb`), or the server keeps no identity (`deidentified`)"),
    )
)]
pub(crate) async fn create_retrieval(
    State(pacs): State<Pacs>,
    body: Result<Bytes, BytesRejection>,
) -> Result<Response, AppError> {
    let wanted: RetrievalRequest = json_body(body)?;
    queue(&pacs, &wanted.node, &wanted.study, &wanted.series).await
}

/// Queues a retrieval and answers with its address.
pub(crate) async fn queue(
    pacs: &Pacs,
    node: &str,
    study: &str,
    series: &str,
) -> Result<Response, AppError> {
    pacs.needs_identity()?;
    let node = pacs.named_node(node)?;
    if node.web().is_none() {
        return Err(AppError::new(
            StatusCode::UNPROCESSABLE_ENTITY,
            "node-without-dicomweb",
            "series are fetched by DICOMweb, and this node is only sent results; add its `url` to `pacs.nodes`",
        ));
    }
    // The UIDs are not repeated, because they may be anything.
    let uid = |text: &str, name: &str| {
        Uid::parse(text).ok_or_else(|| {
            AppError::bad_request(
                "not-a-uid",
                format!("`{name}` must be a UID: digits and points, at most 64"),
            )
            .at(name)
        })
    };
    let uids = SeriesUids {
        study: uid(study, "study")?,
        series: uid(series, "series")?,
    };
    let wanted = Wanted::new(node.name(), &uids);
    let store = pacs.cases().store();
    let mut new = wanted.job();
    let latest = jobs::latest(&mut store.connect().await?, FETCH, &new.key).await?;
    // A request while it is fetched may be about images that came since it began.
    if latest.is_some_and(|job| job.state == JobState::Running) {
        new.key.push_str(" again");
    }
    let job = store.enqueue(&new).await?;
    let job = job.ok_or(cases::Error::Internal)?;
    let address = format!("/v1/retrievals/{}", job.id);
    let view = view(pacs, job).await?;
    Ok(made_at(&address, true, &view))
}

/// Get a retrieval
#[utoipa::path(
    get, path = "/v1/retrievals/{id}", tag = "pacs",
    params(("id" = String, Path, description = "The retrieval")),
    responses(
        (status = 200, description = "How far it is", body = RetrievalView),
        (status = 404, description = "No such retrieval"),
    )
)]
pub(crate) async fn get_retrieval(
    State(pacs): State<Pacs>,
    Path(id): Path<String>,
) -> Result<Response, AppError> {
    let missing = || {
        AppError::not_found(
            "no-such-retrieval",
            "there is no retrieval with this id; retrievals are forgotten after some days",
        )
    };
    if !is_id(&id) {
        return Err(missing());
    }
    let job = jobs::one(&mut pacs.cases().store().connect().await?, &id).await?;
    let job = job.filter(|job| job.kind == FETCH.name());
    let view = view(&pacs, job.ok_or_else(missing)?).await?;
    Ok(fresh_json(StatusCode::OK, &view))
}

pub(crate) async fn view(pacs: &Pacs, job: Job) -> Result<RetrievalView, AppError> {
    let wanted = Wanted::of(&job.payload).ok_or(cases::Error::Internal)?;
    let uids = wanted.uids().ok_or(cases::Error::Internal)?;
    let query = SeriesQuery::Study(uids.study.clone(), Some(uids.series.clone()));
    let arrivals = pacs.store().arrivals_of(&query).await?;
    let arrival = arrivals.into_iter().next();
    // A series that was here before may still be what it was before.
    let is_done = job.state == JobState::Done;
    let ended = arrival.as_ref().filter(|_| is_done);
    let became =
        ended.filter(|arrival| matches!(arrival.state, ArrivalState::Case | ArrivalState::Layer));
    let case = match became.and_then(|arrival| arrival.case) {
        Some(id) => pacs.cases().store().case(&id).await?,
        None => None,
    };
    let case = case.filter(|case| case.closed.is_none());
    let nothing = ended.filter(|arrival| arrival.state == ArrivalState::Nothing);
    let nothing = nothing.and_then(|arrival| arrival.reason.clone());
    let progress = job.progress.as_deref();
    let progress = progress.and_then(|progress| serde_json::from_str(progress).ok());
    let Received { received, expected } = progress.unwrap_or_default();
    let failure = job.failure.filter(|_| job.state == JobState::Failed);
    let failure = failure.or(nothing);
    Ok(RetrievalView {
        study: uids.study.as_str().to_owned(),
        series: uids.series.as_str().to_owned(),
        id: job.id,
        node: wanted.node,
        state: job.state.name(),
        reason: failure.map(Into::into),
        attempts: job.attempts,
        received,
        expected,
        case: case.map(|case| case.id),
        arrival: arrival.map(|arrival| arrival.id),
    })
}
