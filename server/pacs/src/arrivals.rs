//! The list of series that came.

use axum::extract::rejection::QueryRejection;
use axum::extract::{Path, Query, State};
use axum::http::StatusCode;
use axum::response::Response;
use case::CaseId;
use serde::{Deserialize, Serialize};
use storage::arrivals::{Arrival, ArrivalCursor, BECAME_LAYER, is_id};
use utoipa::{IntoParams, ToSchema};

use crate::error::{PacsError, ReasonView};
use crate::state::{Pacs, fresh_json};

/// The largest number of series on a page.
const MAX_PAGE: usize = 200;

/// The number of series on a page, if none is requested.
const USUAL_PAGE: usize = 50;

/// A series that came from a PACS. Its UIDs are patient data.
#[derive(Debug, Clone, Serialize, ToSchema)]
#[schema(as = Arrival)]
pub(crate) struct ArrivalView {
    /// Its name in addresses.
    id: String,
    /// The Study Instance UID.
    study: String,
    /// The Series Instance UID.
    series: String,
    /// `stow`, `c-store` or `retrieval`.
    source: &'static str,
    /// `receiving` until nothing has come for a while, then `case`, `layer` or `nothing`.
    state: &'static str,
    /// The reason, if it became a layer or nothing.
    #[serde(skip_serializing_if = "Option::is_none")]
    reason: Option<ReasonView>,
    /// The case that it became last, or that has it as a layer.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>)]
    case: Option<CaseId>,
    /// Images so far.
    instances: usize,
    /// Images that took the place of others with the same UID since the series was read before.
    superseded: usize,
    /// Objects that are no images and were not kept.
    ignored: usize,
    /// How many there are, if the sender has stated it.
    #[serde(skip_serializing_if = "Option::is_none")]
    expected: Option<usize>,
    /// When its first image came (RFC 3339).
    first_at: String,
    /// When its last image came (RFC 3339).
    last_at: String,
}

impl From<Arrival> for ArrivalView {
    fn from(arrival: Arrival) -> Self {
        Self {
            id: arrival.id,
            study: arrival.uids.study.as_str().to_owned(),
            series: arrival.uids.series.as_str().to_owned(),
            source: arrival.source.name(),
            state: match &arrival.reason {
                Some(reason) if reason.name == BECAME_LAYER => "layer",
                _ => arrival.state.name(),
            },
            reason: arrival.reason.map(Into::into),
            case: arrival.case,
            instances: arrival.instances,
            superseded: arrival.superseded,
            ignored: arrival.ignored,
            expected: arrival.expected,
            first_at: arrival.first_at.to_string(),
            last_at: arrival.last_at.to_string(),
        }
    }
}

/// A page of series.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub(crate) struct ArrivalList {
    /// Newest first.
    arrivals: Vec<ArrivalView>,
    /// The value of `after` for the next page; absent on the last one.
    #[serde(skip_serializing_if = "Option::is_none")]
    next: Option<String>,
}

/// Which page.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(crate) struct PageQuery {
    /// The number of series, 1 to 200. Default: 50.
    limit: Option<usize>,
    /// `next` of the page before.
    after: Option<String>,
}

impl PageQuery {
    fn checked(self) -> Result<(usize, Option<ArrivalCursor>), PacsError> {
        let limit = self.limit.unwrap_or(USUAL_PAGE);
        if !(1..=MAX_PAGE).contains(&limit) {
            return Err(PacsError::bad_request(
                "query-value-out-of-range",
                format!("`limit` must be 1 to {MAX_PAGE}"),
            ));
        }
        let after = self.after.map(|text| ArrivalCursor::parse(&text));
        if after == Some(None) {
            return Err(PacsError::bad_request(
                "query-value-out-of-range",
                "`after` must be `next` of the page before",
            ));
        }
        Ok((limit, after.flatten()))
    }
}

/// List series from a PACS
///
/// Every series that came in the last days, what became of it, and why. Its UIDs are patient data; no cache may store them.
#[utoipa::path(
    get, path = "/v1/arrivals", tag = "pacs", params(PageQuery),
    responses(
        (status = 200, description = "A page of series", body = ArrivalList),
        (status = 400, description = "A key of the query is unknown or its value invalid"),
    )
)]
pub(crate) async fn list_arrivals(
    State(pacs): State<Pacs>,
    query: Result<Query<PageQuery>, QueryRejection>,
) -> Response {
    let listed = list(&pacs, query).await;
    pacs.answer(listed)
}

async fn list(
    pacs: &Pacs,
    query: Result<Query<PageQuery>, QueryRejection>,
) -> Result<Response, PacsError> {
    let Query(query) = query.map_err(|_| {
        PacsError::bad_request(
            "query-unreadable",
            "the query cannot be read; known keys: `limit` and `after`",
        )
    })?;
    let (limit, after) = query.checked()?;
    let store = pacs.cases().store();
    let (arrivals, next) = store.arrivals(after.as_ref(), limit).await?;
    let page = ArrivalList {
        arrivals: arrivals.into_iter().map(Into::into).collect(),
        next: next.map(|cursor| cursor.to_string()),
    };
    Ok(fresh_json(StatusCode::OK, &page))
}

/// Get a series from a PACS
#[utoipa::path(
    get, path = "/v1/arrivals/{id}", tag = "pacs",
    params(("id" = String, Path, description = "The arrival")),
    responses(
        (status = 200, description = "The series", body = ArrivalView),
        (status = 404, description = "No such arrival"),
    )
)]
pub(crate) async fn get_arrival(State(pacs): State<Pacs>, Path(id): Path<String>) -> Response {
    let found = get(&pacs, &id).await;
    pacs.answer(found)
}

async fn get(pacs: &Pacs, id: &str) -> Result<Response, PacsError> {
    let missing = || {
        PacsError::not_found(
            "no-such-arrival",
            "there is no arrival with this id; arrivals are forgotten after some days",
        )
    };
    if !is_id(id) {
        return Err(missing());
    }
    let arrival = pacs.cases().store().arrival(id).await?;
    let view = ArrivalView::from(arrival.ok_or_else(missing)?);
    Ok(fresh_json(StatusCode::OK, &view))
}
