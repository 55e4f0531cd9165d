//! What a named user has chosen and saved for themselves.

use axum::Extension;
use axum::body::Bytes;
use axum::extract::State;
use axum::extract::rejection::BytesRejection;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use cases::Cases;
use cases::preferences::{MAX_BYTES, Preferences};
use serde::Serialize;
use serde_json::{Map, Value};
use utoipa::ToSchema;

use super::readings::named;
use super::versioned::{Versioned, answer, as_json, known_tags, precondition_required};
use access::tokens::Holder;
use http::conditional::EntityTag;
use http::problem::{AppError, Problem};
use http::query::{ApiQuery, NoQuery};
use http::sent::json_body_within;

/// The answer to a client that did not know the preferences as they are: a problem, and the preferences.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct PreferencesChanged {
    #[serde(flatten)]
    problem: Problem,
    /// As they are stored.
    #[schema(value_type = Object)]
    preferences: Map<String, Value>,
}

impl Versioned for Preferences {
    const INVALID: &'static str = "preferences-invalid";
    const CHANGED: (&'static str, &'static str) = (
        "preferences-changed",
        "your preferences have changed since you read them; merge your changes with them, and send them again",
    );

    fn tag(&self) -> EntityTag {
        EntityTag::from_digest(self.version.digest())
    }

    fn shown(self) -> impl Serialize {
        self.members
    }

    fn changed(self, problem: Problem) -> impl Serialize {
        PreferencesChanged {
            problem,
            preferences: self.members,
        }
    }
}

/// One's own preferences
///
/// What the page keeps for a named user, in whatever browser they sit: choices, layouts, and steps of a reading. A JSON object, whose members the page owns;
/// empty before anything is kept. Nobody else sees it. The `ETag` is what a change must name.
#[utoipa::path(
    get, path = "/v1/preferences", tag = "service",
    responses(
        (status = 200, description = "The preferences", body = Object, headers(("ETag" = String, description = "For `If-Match` and `If-None-Match`"))),
        (status = 403, description = "Whoever asks has no name (`reader-unnamed`)"),
    )
)]
pub async fn get_preferences(
    State(cases): State<Cases>,
    Extension(holder): Extension<Holder>,
    _no_query: ApiQuery<NoQuery>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    let preferences = cases.preferences(named(&holder)?).await?;
    as_json(preferences)?.respond(&request)
}

/// Keep one's own preferences
///
/// The whole object. It must not have patient data. `If-Match` must have the `ETag` of the preferences that the client has changed; otherwise the answer is
/// 412, with the preferences as they are.
#[utoipa::path(
    put, path = "/v1/preferences", tag = "service",
    params(("If-Match" = String, Header, description = "The `ETag` of the preferences that were changed")),
    request_body = Object,
    responses(
        (status = 200, description = "The preferences as they are now", body = Object, headers(("ETag" = String, description = "The new one"))),
        (status = 400, description = "The body is no JSON object"),
        (status = 403, description = "Whoever asks has no name (`reader-unnamed`)"),
        (status = 412, description = "The preferences have changed; the answer has them as they are", body = PreferencesChanged, content_type = "application/problem+json", headers(("ETag" = String, description = "The current one"))),
        (status = 413, description = "The body is larger than 64 KiB"),
        (status = 428, description = "`If-Match` is missing"),
    )
)]
pub async fn put_preferences(
    State(cases): State<Cases>,
    Extension(holder): Extension<Holder>,
    _no_query: ApiQuery<NoQuery>,
    request: HeaderMap,
    body: Result<Bytes, BytesRejection>,
) -> Result<Response, AppError> {
    let user = named(&holder)?;
    let known = known_tags(&request).ok_or_else(precondition_required)?;
    let members: Map<String, Value> = json_body_within(MAX_BYTES, body)?;
    answer(cases.replace_preferences(user, &known, members).await)
}

/// Delete one's own preferences
#[utoipa::path(
    delete, path = "/v1/preferences", tag = "service",
    responses(
        (status = 204, description = "There are none any more"),
        (status = 403, description = "Whoever asks has no name (`reader-unnamed`)"),
    )
)]
pub async fn delete_preferences(
    State(cases): State<Cases>,
    Extension(holder): Extension<Holder>,
    _no_query: ApiQuery<NoQuery>,
) -> Result<StatusCode, AppError> {
    cases.remove_preferences(named(&holder)?).await?;
    Ok(StatusCode::NO_CONTENT)
}
