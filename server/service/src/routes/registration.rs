//! The registration of two cases.

use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use bytes::Bytes;
use serde::{Deserialize, Serialize};
use utoipa::IntoParams;

use crate::routes::asked::{CasePath, Question};
use case::{CaseId, CaseRegistration};
use cases::{Cases, Error};
use http::conditional::Format;
use http::problem::AppError;
use http::query::{ApiQuery, Asked};

/// The query for a registration.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct RegistrationQuery {
    /// The other case.
    #[param(value_type = String)]
    with: CaseId,
}

impl Asked for RegistrationQuery {
    type Values = ();

    fn checked(&self) -> Result<(), AppError> {
        Ok(())
    }
}

/// The place of another case in the patient space of this case
///
/// Registers two cases rigidly by normalised mutual information, in the same way as layers. The cases may be two time
/// points of one head. Two different heads can only be aligned roughly (`verdict` is `rough`). The request takes about a
/// second.
#[utoipa::path(
    get, path = "/v1/cases/{id}/registration", tag = "cases",
    params(("id" = String, Path, description = "The case"), RegistrationQuery),
    responses(
        (status = 200, description = "The transform, and whether it can be trusted", body = CaseRegistration),
        (status = 304, description = "The client already has this answer"),
        (status = 404, description = "One of the cases does not exist"),
        (status = 409, description = "One of the cases is not ready"),
        (status = 422, description = "One of the cases could not be prepared"),
        (status = 503, description = "Too much work is waiting (`busy`), or the stored upload is missing (`source-missing`)"),
    )
)]
pub async fn get_registration(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    ApiQuery { asked: query, .. }: ApiQuery<RegistrationQuery>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    // The answer may be known to the client although the other case is gone.
    let with = query.with;
    cases.ready(&with).await?;
    let question = Question::new(id, "registration", &query, &request);
    let format = Format::of("application/json").revalidated();
    let work = async |_| {
        let found = cases.registration(&id, &with).await?;
        let body = serde_json::to_vec(&found).map_err(|_| Error::Internal)?;
        Ok(Bytes::from(body).into())
    };
    question.answer(&cases, format, work).await
}
