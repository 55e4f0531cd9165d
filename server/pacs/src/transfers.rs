//! The lists of retrievals and of results that are sent, for operators.

use axum::extract::Query;
use axum::extract::rejection::QueryRejection;
use axum::http::StatusCode;
use axum::response::Response;
use case::{CaseId, JobState};
use serde::{Deserialize, Serialize};
use storage::JobQuery;
use storage::arrivals::{ArrivalCursor, TransferQuery};
use utoipa::{IntoParams, ToSchema};

use crate::fetch::{FETCH, Wanted};
use crate::results::ResultView;
use crate::retrievals::{self, RetrievalView};
use crate::state::{InProject, Pacs};
use http_support::fresh::fresh_json;
use http_support::problem::AppError;

/// The largest number of entries on a page.
const MAX_PAGE: usize = 200;

/// The number of entries on a page, if none is requested.
const USUAL_PAGE: usize = 50;

/// Which entries, and which page.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(crate) struct ListQuery {
    /// The case that a result was made from, or that a retrieved series became.
    case: Option<String>,
    /// `queued`, `running`, `done` or `failed`.
    state: Option<String>,
    /// The number of entries, 1 to 200. Default: 50.
    limit: Option<usize>,
    /// `next` of the page before.
    after: Option<String>,
}

/// A page of results that are sent.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct SentResultList {
    /// Newest first.
    results: Vec<ResultView>,
    /// The value of `after` for the next page; absent on the last one.
    #[serde(skip_serializing_if = "Option::is_none")]
    next: Option<String>,
}

/// A page of retrievals.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct RetrievalList {
    /// Newest first.
    retrievals: Vec<RetrievalView>,
    /// The value of `after` for the next page; absent on the last one.
    #[serde(skip_serializing_if = "Option::is_none")]
    next: Option<String>,
}

type Asked = Result<Query<ListQuery>, QueryRejection>;

/// A query whose values are valid.
struct Checked {
    of: TransferQuery,
    after: Option<ArrivalCursor>,
    limit: usize,
}

fn checked(pacs: &Pacs, asked: Asked) -> Result<Checked, AppError> {
    let Query(asked) = asked.map_err(|_| {
        AppError::bad_request(
            "query-unreadable",
            "the query cannot be read; known keys: `case`, `state`, `limit` and `after`",
        )
    })?;
    // What the client wrote may be anything, so it is not repeated.
    let wrong = AppError::wrong_value;
    let case = asked.case.map(|text| {
        let id = CaseId::parse(&text);
        id.map(|id| id.in_project(pacs.project()))
            .ok_or_else(|| wrong("case", "the id of a case: 32 hexadecimal digits"))
    });
    let state = asked.state.map(|text| {
        JobState::from_name(&text)
            .ok_or_else(|| wrong("state", "`queued`, `running`, `done` or `failed`"))
    });
    let after = asked.after.map(|text| {
        ArrivalCursor::parse(&text).ok_or_else(|| wrong("after", "`next` of the page before"))
    });
    let limit = asked.limit.unwrap_or(USUAL_PAGE);
    if !(1..=MAX_PAGE).contains(&limit) {
        return Err(wrong("limit", &format!("1 to {MAX_PAGE}")));
    }
    Ok(Checked {
        of: TransferQuery {
            case: case.transpose()?,
            state: state.transpose()?,
        },
        after: after.transpose()?,
        limit,
    })
}

/// List results
///
/// The results that are sent to nodes, or were in the last days, by case and by state.
#[utoipa::path(
    get, path = "/v1/dicom-results", tag = "pacs", params(ListQuery),
    responses(
        (status = 200, description = "A page of results", body = SentResultList),
        (status = 400, description = "A key of the query is unknown or its value invalid"),
    )
)]
pub(crate) async fn list_results(
    InProject(pacs): InProject,
    asked: Asked,
) -> Result<Response, AppError> {
    results(&pacs, asked).await
}

async fn results(pacs: &Pacs, asked: Asked) -> Result<Response, AppError> {
    let asked = checked(pacs, asked)?;
    let store = pacs.cases().store();
    let (results, next) = store
        .results(&asked.of, asked.after.as_ref(), asked.limit)
        .await?;
    let page = SentResultList {
        results: results.into_iter().map(Into::into).collect(),
        next: next.map(|cursor| cursor.to_string()),
    };
    Ok(fresh_json(StatusCode::OK, &page))
}

/// List retrievals
///
/// The series that are fetched from nodes, or were in the last days, by case and by state.
#[utoipa::path(
    get, path = "/v1/retrievals", tag = "pacs", params(ListQuery),
    responses(
        (status = 200, description = "A page of retrievals", body = RetrievalList),
        (status = 400, description = "A key of the query is unknown or its value invalid"),
    )
)]
pub(crate) async fn list_retrievals(
    InProject(pacs): InProject,
    asked: Asked,
) -> Result<Response, AppError> {
    retrieved(&pacs, asked).await
}

async fn retrieved(pacs: &Pacs, asked: Asked) -> Result<Response, AppError> {
    let asked = checked(pacs, asked)?;
    let store = pacs.cases().store();
    let mut page = RetrievalList {
        retrievals: Vec::new(),
        next: None,
    };
    let key_prefix = match asked.of.case {
        None => String::new(),
        Some(case) => match store.series_of(&case).await? {
            Some(series) => Wanted::key_prefix(pacs.project(), &series.uids),
            // It did not come from a node.
            None => return Ok(fresh_json(StatusCode::OK, &page)),
        },
    };
    let query = JobQuery {
        kind: FETCH,
        state: asked.of.state,
        key_prefix,
    };
    let (found, next) = store
        .jobs(&query, asked.after.as_ref(), asked.limit)
        .await?;
    page.next = next.map(|cursor| cursor.to_string());
    for retrieval in found {
        page.retrievals
            .push(retrievals::view(pacs, retrieval).await?);
    }
    Ok(fresh_json(StatusCode::OK, &page))
}
