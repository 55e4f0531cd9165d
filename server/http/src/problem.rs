//! Errors as clients see them: `application/problem+json` (RFC 9457) with a stable `type`.

use std::borrow::Cow;

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
    /// A value of the query is invalid.
    #[error("{} {detail}", named(parameter))]
    Query {
        /// Last part of the problem's type.
        kind: &'static str,
        /// The key; `.` is the whole body.
        parameter: Cow<'static, str>,
        /// What is wrong with it: a sentence that begins with its verb.
        detail: String,
    },
    /// A key of the query is unknown. It is not repeated, because it may be anything, such as the name of a patient.
    #[error("the query has an unknown key; {known}")]
    UnknownKey {
        /// The known keys, in words.
        known: String,
    },
    /// The form of an upload cannot be read.
    #[error("{detail}")]
    Upload {
        /// Last part of the problem's type.
        kind: &'static str,
        /// What is wrong, in one sentence.
        detail: String,
    },
    /// The body is not a form.
    #[error("send the volume as multipart/form-data with a part named `volume`")]
    UnsupportedMediaType,
    /// No available media type is accepted.
    #[error("none of the accepted media types is available; available types: {}", .offered.join(", "))]
    NotAcceptable {
        /// The available media types.
        offered: &'static [&'static str],
    },
    /// The body is larger than allowed.
    #[error("the body is larger than the limit of {limit_bytes} bytes")]
    TooLarge { limit_bytes: u64 },
    /// A part of the body is larger than allowed.
    #[error("{detail}")]
    PartTooLarge {
        /// Which, and the limit: one sentence.
        detail: String,
    },
    /// The range lies outside of the body.
    #[error("the range begins beyond the {length} bytes of this answer")]
    RangeNotSatisfiable {
        /// Bytes of the whole body.
        length: u64,
    },
    #[error("this address does not exist; /docs lists all addresses")]
    NoSuchRoute,
    /// The address does not accept this method.
    #[error("this address does not accept this method; /docs lists the accepted methods")]
    MethodNotAllowed,
    /// An error of one interface alone.
    #[error("{detail}")]
    Other {
        status: StatusCode,
        /// Last part of the problem's type.
        kind: &'static str,
        /// What is wrong, in one sentence.
        detail: String,
        /// The key of the query with the error.
        parameter: Option<String>,
        /// The header that belongs to the status.
        header: Option<Box<(HeaderName, HeaderValue)>>,
    },
    /// The answer took too long.
    #[error("the answer was not ready in time; try again in a moment")]
    TimedOut,
    /// The answer took too long, and would again.
    #[error("{detail}")]
    TooSlow {
        /// The limit, and what to do instead: one sentence.
        detail: String,
    },
}

impl<E: PublicError> From<E> for AppError {
    fn from(error: E) -> Self {
        Self::Application(Box::new(error))
    }
}

/// The name of the faulty part, in words.
fn named(parameter: &str) -> String {
    match parameter {
        "." => "the body".to_owned(),
        key => format!("`{key}`"),
    }
}

impl AppError {
    /// An error of one interface alone.
    pub fn new(status: StatusCode, kind: &'static str, detail: impl Into<String>) -> Self {
        Self::Other {
            status,
            kind,
            detail: detail.into(),
            parameter: None,
            header: None,
        }
    }

    /// The same with a header that belongs to its status.
    #[must_use]
    pub fn with_header(self, name: HeaderName, value: HeaderValue) -> Self {
        match self {
            Self::Other {
                status,
                kind,
                detail,
                parameter,
                ..
            } => Self::Other {
                status,
                kind,
                detail,
                parameter,
                header: Some(Box::new((name, value))),
            },
            other => other,
        }
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
    pub fn at(self, place: &str) -> Self {
        match self {
            Self::Other {
                status,
                kind,
                detail,
                header,
                ..
            } => Self::Other {
                status,
                kind,
                detail,
                parameter: Some(place.to_owned()),
                header,
            },
            other => other,
        }
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
    pub fn out_of_range(parameter: &'static str, detail: impl Into<String>) -> Self {
        Self::Query {
            kind: "query-value-out-of-range",
            parameter: parameter.into(),
            detail: detail.into(),
        }
    }

    /// The status and the last part of the problem's type.
    fn status_and_kind(&self) -> (StatusCode, Cow<'static, str>) {
        let (status, kind) = match self {
            Self::Application(error) => return (status_of(error.kind()), error.name()),
            Self::UnknownKey { .. } => (StatusCode::BAD_REQUEST, "query-unknown-key"),
            Self::Query { kind, .. } | Self::Upload { kind, .. } => {
                (StatusCode::BAD_REQUEST, *kind)
            }
            Self::UnsupportedMediaType => {
                (StatusCode::UNSUPPORTED_MEDIA_TYPE, "unsupported-media-type")
            }
            Self::NotAcceptable { .. } => (StatusCode::NOT_ACCEPTABLE, "not-acceptable"),
            Self::TooLarge { .. } | Self::PartTooLarge { .. } => {
                (StatusCode::PAYLOAD_TOO_LARGE, "body-too-large")
            }
            Self::RangeNotSatisfiable { .. } => {
                (StatusCode::RANGE_NOT_SATISFIABLE, "range-not-satisfiable")
            }
            Self::NoSuchRoute => (StatusCode::NOT_FOUND, "no-such-address"),
            Self::MethodNotAllowed => (StatusCode::METHOD_NOT_ALLOWED, "method-not-allowed"),
            Self::Other { status, kind, .. } => (*status, *kind),
            Self::TimedOut | Self::TooSlow { .. } => (StatusCode::SERVICE_UNAVAILABLE, "timed-out"),
        };
        (status, kind.into())
    }

    fn parameter(&self) -> Option<String> {
        match self {
            Self::Application(error) => error.parameter().map(str::to_owned),
            Self::Query { parameter, .. } => Some(parameter.to_string()),
            Self::Other { parameter, .. } => parameter.clone(),
            _ => None,
        }
    }

    /// The body of the answer.
    pub fn problem(&self) -> Problem {
        let (status, kind) = self.status_and_kind();
        Problem {
            kind: format!("{TYPE_PREFIX}{kind}"),
            title: status.canonical_reason().unwrap_or("Error").to_owned(),
            status: status.as_u16(),
            detail: self.to_string(),
            parameter: self.parameter(),
            reason: self.reason(),
        }
    }

    fn reason(&self) -> Option<String> {
        match self {
            Self::Application(error) => error.reason(),
            _ => None,
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
        if let Some((name, value)) = extra_header(&self, status) {
            headers.insert(name, value);
        }
        response
    }
}

/// The header that a status asks for.
fn extra_header(error: &AppError, status: StatusCode) -> Option<(HeaderName, HeaderValue)> {
    if let AppError::Application(error) = error
        && let Some(wait) = error.retry_after()
    {
        let seconds = wait.as_secs_f64().round().clamp(1.0, 60.0) as u64;
        return Some((header::RETRY_AFTER, seconds.into()));
    }
    match error {
        AppError::RangeNotSatisfiable { length } => {
            let value = HeaderValue::from_str(&format!("bytes */{length}")).ok()?;
            Some((header::CONTENT_RANGE, value))
        }
        AppError::Other {
            header: Some(header),
            ..
        } => Some((**header).clone()),
        // A repeated request would not help.
        AppError::TooSlow { .. } => None,
        _ if status == StatusCode::SERVICE_UNAVAILABLE => {
            Some((header::RETRY_AFTER, RETRY_SECONDS.into()))
        }
        _ => None,
    }
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
