//! Requests to fetch series from a node.

use axum::extract::{Path, Request, State};
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::Response;
use case::{CaseId, JobState};
use serde::{Deserialize, Serialize};
use serde_path_to_error::Segment;
use storage::Job;
use storage::arrivals::{SeriesQuery, SeriesUids, Uid, is_id};
use utoipa::ToSchema;

use crate::error::{PacsError, ReasonView};
use crate::fetch::{FETCH, Received, Wanted};
use crate::state::{Pacs, fresh_json};

/// The largest body of a request.
const MAX_BODY_BYTES: usize = 16 << 10;

/// Seconds to wait before the first request for the state.
const RETRY_SECONDS: HeaderValue = HeaderValue::from_static("1");

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
    /// The reason, if it failed.
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
    /// The case that it became.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>)]
    case: Option<CaseId>,
}

/// Reads a short JSON body.
pub(crate) async fn read_json<T: serde::de::DeserializeOwned>(
    request: Request,
    known: &str,
) -> Result<T, PacsError> {
    let unreadable = |what: &str| {
        PacsError::bad_request(
            "body-unreadable",
            format!("the body {what}; send JSON with {known}"),
        )
    };
    let body = axum::body::to_bytes(request.into_body(), MAX_BODY_BYTES).await;
    let body = body.map_err(|_| unreadable("is too large or cut off"))?;
    let mut json = serde_json::Deserializer::from_slice(&body);
    let read = serde_path_to_error::deserialize(&mut json);
    // The messages of the parser may repeat values, which may be anything.
    let read = read.map_err(|error| match place(&error).as_str() {
        "" => unreadable("cannot be read"),
        place => unreadable(&format!("cannot be read at `{place}`")),
    })?;
    json.end()
        .map_err(|_| unreadable("goes on after its JSON"))?;
    Ok(read)
}

/// Where a body cannot be read, in keys that we know. Those that we do not know may be anything.
fn place(error: &serde_path_to_error::Error<serde_json::Error>) -> String {
    let mut segments: Vec<_> = error.path().iter().collect();
    if error.inner().to_string().starts_with("unknown field") {
        segments.pop();
    }
    let keys = segments.iter().filter_map(|segment| match segment {
        Segment::Map { key } => Some(key.as_str()),
        _ => None,
    });
    keys.collect::<Vec<_>>().join(".")
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
pub(crate) async fn create_retrieval(State(pacs): State<Pacs>, request: Request) -> Response {
    let queued = async {
        let known = "`node`, `study` and `series`";
        let wanted: RetrievalRequest = read_json(request, known).await?;
        queue(&pacs, &wanted.node, &wanted.study, &wanted.series).await
    };
    let queued = queued.await;
    pacs.answer(queued)
}

/// Queues a retrieval and answers with its address.
pub(crate) async fn queue(
    pacs: &Pacs,
    node: &str,
    study: &str,
    series: &str,
) -> Result<Response, PacsError> {
    pacs.needs_identity()?;
    let node = pacs.named_node(node)?;
    if node.web().is_none() {
        return Err(PacsError::new(
            StatusCode::UNPROCESSABLE_ENTITY,
            "node-without-dicomweb",
            "series are fetched by DICOMweb, and this node is only sent results; add its `url` to `pacs.nodes`",
        ));
    }
    // The UIDs are not repeated, because they may be anything.
    let uid = |text: &str, name: &str| {
        Uid::parse(text).ok_or_else(|| {
            PacsError::bad_request(
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
    let latest = store.latest_job(FETCH, &new.key).await?;
    // A request while it is fetched may be about images that came since it began.
    if latest.is_some_and(|job| job.state == JobState::Running) {
        new.key.push_str(" again");
    }
    let job = store.enqueue(&new).await?;
    let job = job.ok_or(cases::Error::Internal)?;
    let address = format!("/v1/retrievals/{}", job.id);
    let view = view(pacs, job).await?;
    let mut response = fresh_json(StatusCode::ACCEPTED, &view);
    let headers = response.headers_mut();
    if let Ok(address) = HeaderValue::from_str(&address) {
        headers.insert(header::LOCATION, address);
    }
    headers.insert(header::RETRY_AFTER, RETRY_SECONDS);
    Ok(response)
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
pub(crate) async fn get_retrieval(State(pacs): State<Pacs>, Path(id): Path<String>) -> Response {
    let found = get(&pacs, &id).await;
    pacs.answer(found)
}

async fn get(pacs: &Pacs, id: &str) -> Result<Response, PacsError> {
    let missing = || {
        PacsError::not_found(
            "no-such-retrieval",
            "there is no retrieval with this id; retrievals are forgotten after some days",
        )
    };
    if !is_id(id) {
        return Err(missing());
    }
    let job = pacs.cases().store().job(id).await?;
    let job = job.filter(|job| job.kind == FETCH.name());
    let view = view(pacs, job.ok_or_else(missing)?).await?;
    Ok(fresh_json(StatusCode::OK, &view))
}

pub(crate) async fn view(pacs: &Pacs, job: Job) -> Result<RetrievalView, PacsError> {
    let wanted = Wanted::of(&job.payload).ok_or(cases::Error::Internal)?;
    let uids = wanted.uids().ok_or(cases::Error::Internal)?;
    let query = SeriesQuery::Study(uids.study.clone(), Some(uids.series.clone()));
    let arrivals = pacs.cases().store().arrivals_of(&query).await?;
    let arrival = arrivals.into_iter().next();
    let progress = job.progress.as_deref();
    let progress = progress.and_then(|progress| serde_json::from_str(progress).ok());
    let Received { received, expected } = progress.unwrap_or_default();
    let failure = job.failure.filter(|_| job.state == JobState::Failed);
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
        case: arrival.as_ref().and_then(|arrival| arrival.case),
        arrival: arrival.map(|arrival| arrival.id),
    })
}
