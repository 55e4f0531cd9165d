//! The lists of retrievals and of results that are sent, for operators.

use axum::extract::State;
use axum::http::StatusCode;
use axum::response::Response;
use case::{CaseId, JobState};
use serde::{Deserialize, Serialize};
use storage::JobQuery;
use storage::tables::{jobs, series};
use utoipa::{IntoParams, ToSchema};

use crate::arrivals::{Checked, value};
use crate::fetch::{FETCH, Wanted};
use crate::results::ResultView;
use crate::retrievals::{self, RetrievalView};
use crate::state::Pacs;
use crate::values::TransferQuery;
use http::fresh::fresh_json;
use http::problem::AppError;
use http::query::{ApiQuery, Asked, usual_page};

/// Which entries, and which page.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(crate) struct ListQuery {
    /// The case that a result was made from, or that a retrieved series became.
    case: Option<String>,
    /// `queued`, `running`, `done` or `failed`.
    state: Option<String>,
    /// The number of entries.
    #[serde(default = "usual_page")]
    #[param(minimum = 1, maximum = 200, default = 50)]
    limit: usize,
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

impl Asked for ListQuery {
    type Values = Checked<TransferQuery>;

    fn checked(&self) -> Result<Self::Values, AppError> {
        let a_case = "the id of a case: 32 hexadecimal digits";
        let a_state = "`queued`, `running`, `done` or `failed`";
        let of = TransferQuery {
            case: value("case", &self.case, a_case, CaseId::parse)?,
            state: value("state", &self.state, a_state, JobState::from_name)?,
        };
        Checked::new(of, &self.after, self.limit)
    }
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
    State(pacs): State<Pacs>,
    ApiQuery { values: asked, .. }: ApiQuery<ListQuery>,
) -> Result<Response, AppError> {
    let store = pacs.store();
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
    State(pacs): State<Pacs>,
    ApiQuery { values: asked, .. }: ApiQuery<ListQuery>,
) -> Result<Response, AppError> {
    let mut connection = pacs.cases().store().connect().await?;
    let mut page = RetrievalList {
        retrievals: Vec::new(),
        next: None,
    };
    let key_prefix = match asked.of.case {
        None => String::new(),
        Some(case) => match series::of_case(&mut connection, &case).await? {
            Some(series) => Wanted::key_prefix(&series.uids),
            // It did not come from a node.
            None => return Ok(fresh_json(StatusCode::OK, &page)),
        },
    };
    let query = JobQuery {
        kind: FETCH,
        state: asked.of.state,
        key_prefix,
    };
    let after = asked.after.as_ref();
    let (found, next) = jobs::page(&mut connection, &query, after, asked.limit).await?;
    drop(connection);
    page.next = next.map(|cursor| cursor.to_string());
    for retrieval in found {
        page.retrievals
            .push(retrievals::view(&pacs, retrieval).await?);
    }
    Ok(fresh_json(StatusCode::OK, &page))
}
