//! Errors as clients see them: `application/problem+json` (RFC 9457) with a stable `type`.

use std::fmt::Display;

use axum::Json;
use axum::http::{HeaderName, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use case::{ErrorKind, PublicError};
use serde::Serialize;
use utoipa::ToSchema;

/// The prefix of every `type`.
const TYPE_PREFIX: &str = "urn:isocortex:problem:";

/// Seconds after which a client may repeat a request that was rejected because the server was busy.
const RETRY_SECONDS: u32 = 2;

/// The body of every error answer (RFC 9457). It contains neither patient data nor file paths.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct Problem {
    /// A stable URN, such as `urn:isocortex:problem:depth-not-a-number`.
    #[serde(rename = "type")]
    pub kind: String,
    /// The meaning of the status.
    pub title: String,
    /// The HTTP status.
    pub status: u16,
    /// One plain sentence that states what is wrong and what to do.
    pub detail: String,
    /// The key of the query or the part of the form with the error.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub parameter: Option<String>,
    /// The stable name of the reason, for translations, if it is one of several.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
}

/// Every error of a request.
#[derive(Debug, thiserror::Error)]
pub enum AppError {
    /// An error of the application.
    #[error("{}", .0.sentence())]
    Application(Box<dyn PublicError>),
    /// An error of HTTP, or of one interface alone.
    #[error("{}", .0.detail)]
    Request(Box<RequestError>),
}

/// An error that no application knows.
#[derive(Debug)]
pub struct RequestError {
    status: StatusCode,
    /// Last part of the problem's type.
    kind: &'static str,
    /// What is wrong, in one sentence.
    detail: String,
    /// The key of the query, or the place in the body, with the error.
    parameter: Option<String>,
    /// The header that belongs to the status.
    header: Option<(HeaderName, HeaderValue)>,
}

impl<E: PublicError> From<E> for AppError {
    fn from(error: E) -> Self {
        Self::Application(Box::new(error))
    }
}

impl AppError {
    /// An error of HTTP, or of one interface alone.
    pub fn new(status: StatusCode, kind: &'static str, detail: impl Into<String>) -> Self {
        Self::Request(Box::new(RequestError {
            status,
            kind,
            detail: detail.into(),
            parameter: None,
            header: None,
        }))
    }

    /// The same with a header that belongs to its status.
    #[must_use]
    pub fn with_header(mut self, name: HeaderName, value: HeaderValue) -> Self {
        if let Self::Request(error) = &mut self {
            error.header = Some((name, value));
        }
        self
    }

    /// An invalid value of a key of the query; the rule says what it must be.
    pub fn wrong_value(key: &str, rule: &str) -> Self {
        let detail = format!("`{key}` must be {rule}");
        Self::bad_request("query-value-out-of-range", detail).at(key)
    }

    /// An invalid value in the body, at a place such as `key_object.instances`; the rule says what it must be.
    pub fn wrong_in_body(place: &str, rule: &str) -> Self {
        let detail = format!("`{place}` must be {rule}");
        Self::bad_request("body-value-out-of-range", detail).at(place)
    }

    /// The same with the key of the query, or the place in the body, with the error.
    #[must_use]
    pub fn at(mut self, place: impl Into<String>) -> Self {
        if let Self::Request(error) = &mut self {
            error.parameter = Some(place.into());
        }
        self
    }

    /// What is wrong with a key of the query, or with a place in the body (`.` is the whole body): a sentence that begins with its verb.
    pub fn invalid(kind: &'static str, place: impl Into<String>, detail: impl Display) -> Self {
        let place = place.into();
        let detail = match place.as_str() {
            "." => format!("the body {detail}"),
            key => format!("`{key}` {detail}"),
        };
        Self::bad_request(kind, detail).at(place)
    }

    /// A request that is wrong.
    pub fn bad_request(kind: &'static str, detail: impl Into<String>) -> Self {
        Self::new(StatusCode::BAD_REQUEST, kind, detail)
    }

    /// What does not exist.
    pub fn not_found(kind: &'static str, detail: impl Into<String>) -> Self {
        Self::new(StatusCode::NOT_FOUND, kind, detail)
    }

    /// A value of the query that is out of its range.
    pub fn out_of_range(parameter: &'static str, detail: impl Display) -> Self {
        Self::invalid("query-value-out-of-range", parameter, detail)
    }

    /// The body is not a form.
    pub fn not_a_form() -> Self {
        let detail = "send the volume as multipart/form-data with a part named `volume`";
        let status = StatusCode::UNSUPPORTED_MEDIA_TYPE;
        Self::new(status, "unsupported-media-type", detail)
    }

    /// None of the available media types is accepted.
    pub fn not_acceptable(offered: &[&str]) -> Self {
        let offered = offered.join(", ");
        let detail =
            format!("none of the accepted media types is available; available types: {offered}");
        Self::new(StatusCode::NOT_ACCEPTABLE, "not-acceptable", detail)
    }

    /// The body is larger than allowed.
    pub fn too_large(limit_bytes: u64) -> Self {
        let detail = format!("the body is larger than the limit of {limit_bytes} bytes");
        Self::part_too_large(detail)
    }

    /// A part of the body is larger than allowed; the detail states which, and the limit.
    pub fn part_too_large(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::PAYLOAD_TOO_LARGE, "body-too-large", detail)
    }

    pub fn no_such_route() -> Self {
        let detail = "this address does not exist; /docs lists all addresses";
        Self::not_found("no-such-address", detail)
    }

    /// The address does not accept this method.
    pub fn method_not_allowed() -> Self {
        let detail = "this address does not accept this method; /docs lists the accepted methods";
        let status = StatusCode::METHOD_NOT_ALLOWED;
        Self::new(status, "method-not-allowed", detail)
    }

    /// The answer took too long, and would again. The detail states the limit, and what to do instead.
    pub fn too_slow(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::SERVICE_UNAVAILABLE, "timed-out", detail)
    }

    /// The answer took too long.
    pub fn timed_out() -> Self {
        Self::too_slow("the answer was not ready in time; try again in a moment")
            .with_header(header::RETRY_AFTER, RETRY_SECONDS.into())
    }

    /// The body of the answer.
    pub fn problem(&self) -> Problem {
        let (status, kind, parameter, reason) = match self {
            Self::Application(error) => {
                let parameter = error.parameter().map(str::to_owned);
                (
                    status_of(error.kind()),
                    error.name(),
                    parameter,
                    error.reason(),
                )
            }
            Self::Request(error) => (
                error.status,
                error.kind.into(),
                error.parameter.clone(),
                None,
            ),
        };
        Problem {
            kind: format!("{TYPE_PREFIX}{kind}"),
            title: status.canonical_reason().unwrap_or("Error").to_owned(),
            status: status.as_u16(),
            detail: self.to_string(),
            parameter,
            reason,
        }
    }
}

/// The status for each kind of error.
fn status_of(kind: ErrorKind) -> StatusCode {
    match kind {
        ErrorKind::Invalid => StatusCode::BAD_REQUEST,
        ErrorKind::NotFound => StatusCode::NOT_FOUND,
        ErrorKind::Conflict => StatusCode::CONFLICT,
        ErrorKind::NotRecognised => StatusCode::UNSUPPORTED_MEDIA_TYPE,
        ErrorKind::TooLarge => StatusCode::PAYLOAD_TOO_LARGE,
        ErrorKind::Unusable => StatusCode::UNPROCESSABLE_ENTITY,
        ErrorKind::NotSupported => StatusCode::NOT_IMPLEMENTED,
        ErrorKind::Unavailable => StatusCode::SERVICE_UNAVAILABLE,
        ErrorKind::Full => StatusCode::INSUFFICIENT_STORAGE,
        ErrorKind::Internal => StatusCode::INTERNAL_SERVER_ERROR,
    }
}

impl IntoResponse for AppError {
    fn into_response(self) -> Response {
        log(&self);
        let problem = self.problem();
        let status =
            StatusCode::from_u16(problem.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        let mut response = (status, Json(problem)).into_response();
        let headers = response.headers_mut();
        headers.insert(
            header::CONTENT_TYPE,
            HeaderValue::from_static("application/problem+json"),
        );
        headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
        if let Some((name, value)) = extra_header(self, status) {
            headers.insert(name, value);
        }
        response
    }
}

/// The header that a status asks for.
fn extra_header(error: AppError, status: StatusCode) -> Option<(HeaderName, HeaderValue)> {
    let error = match error {
        AppError::Request(error) => return error.header,
        AppError::Application(error) => error,
    };
    let seconds = match error.retry_after() {
        Some(wait) => wait.as_secs_f64().round().clamp(1.0, 60.0) as u32,
        None if status == StatusCode::SERVICE_UNAVAILABLE => RETRY_SECONDS,
        None => return None,
    };
    Some((header::RETRY_AFTER, seconds.into()))
}

/// Errors of the store are logged here, once; an error of a client appears in the line of its request.
fn log(error: &AppError) {
    if let AppError::Application(error) = error
        && let Some(cause) = error.hidden_cause()
    {
        let source = cause.source().map(ToString::to_string);
        match error.kind() {
            ErrorKind::Unavailable => tracing::warn!(%cause, source, "the store is unreachable"),
            _ => tracing::error!(%cause, source, "the store failed"),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::borrow::Cow;
    use std::time::Duration;

    use case::Failure;

    use super::*;

    /// Too much waits, for about this long.
    #[derive(Debug, thiserror::Error)]
    #[error("too much waits")]
    struct QueueFull(Duration);

    impl PublicError for QueueFull {
        fn kind(&self) -> ErrorKind {
            ErrorKind::Unavailable
        }

        fn name(&self) -> Cow<'static, str> {
            "busy".into()
        }

        fn retry_after(&self) -> Option<Duration> {
            Some(self.0)
        }
    }

    #[test]
    fn a_full_queue_says_when_to_come_again() {
        let response = AppError::from(QueueFull(Duration::from_secs(20))).into_response();
        assert_eq!(response.status(), 503);
        assert_eq!(response.headers()[header::RETRY_AFTER], "20");
    }

    #[test]
    fn a_failure_keeps_its_name_and_gets_the_status_of_its_kind() {
        let failure = Failure::unusable("mask-missing", "a mask is needed");
        let problem = AppError::from(failure).problem();
        assert_eq!(problem.kind, "urn:isocortex:problem:mask-missing");
        assert_eq!(problem.status, 422);
    }
}
