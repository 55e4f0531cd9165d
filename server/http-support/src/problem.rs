//! Errors as clients see them: `application/problem+json` (RFC 9457) with a stable `type`.

use std::borrow::Cow;

use axum::Json;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use case::{Failure, FailureKind};
use cases::Error;
use cases::models::PathsError;
use geometry::GeometryError;
use render::RenderError;
use serde::Serialize;
use storage::{ObjectError, StoreError};
use utoipa::ToSchema;

use crate::scopes::Scope;
use crate::tokens::Holder;

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
    #[error(transparent)]
    Cases(Error),
    /// The path contains no case id.
    #[error("the id of a case has 32 lower-case hexadecimal digits")]
    NotACaseId,
    /// The case was not created from DICOM.
    #[error("this case was not created from DICOM; it has no patient attributes")]
    NotDicom,
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
    /// The bearer token is missing or wrong.
    #[error("authentication required: send `Authorization: Bearer …`")]
    Unauthorized,
    /// The token was right and has ended.
    #[error("your token has ended; ask the administrator of this server for a new one")]
    TokenEnded,
    /// The headers of a proxy that signs people in are not accepted.
    #[error("the proxy in front of this server {why}; tell the administrator of this server")]
    ProxyRefused {
        /// What it did.
        why: &'static str,
    },
    /// The token does not permit this.
    #[error("the token `{}` may not do this: it lacks the scope `{scope}`", .holder.name)]
    MissingScope {
        /// Who asks.
        holder: Holder,
        /// What the route needs.
        scope: Scope,
    },
    /// The audit record cannot be written.
    #[error(
        "the audit record of this server cannot be written, so it answers nothing that the record must name; tell its administrator"
    )]
    AuditFull,
    /// A page of another site requests a change.
    #[error("requests from pages of other sites are rejected")]
    CrossSite,
    /// The Host header names another machine.
    #[error("this server accepts only localhost, 127.0.0.1 and [::1] as its host name")]
    WrongHost,
    /// No such address.
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
    },
    /// The answer took too long.
    #[error("the answer was not ready in time; try again in a moment")]
    TimedOut,
    /// Many pictures took too long together, and would again.
    #[error(
        "these pictures were not drawn within the limit of {limit_s} s; request fewer or smaller ones, in several requests"
    )]
    TooManyPictures {
        /// The time limit of an answer, in seconds.
        limit_s: u64,
    },
}

impl From<Error> for AppError {
    fn from(error: Error) -> Self {
        match error {
            Error::Parameter { kind, name, detail } => Self::Query {
                kind,
                parameter: name,
                detail,
            },
            other => Self::Cases(other),
        }
    }
}

impl From<ObjectError> for AppError {
    fn from(error: ObjectError) -> Self {
        StoreError::from(error).into()
    }
}

impl From<StoreError> for AppError {
    fn from(error: StoreError) -> Self {
        Error::from(error).into()
    }
}

impl From<Failure> for AppError {
    fn from(error: Failure) -> Self {
        Error::from(error).into()
    }
}

impl From<PathsError> for AppError {
    fn from(error: PathsError) -> Self {
        Error::from(error).into()
    }
}

impl From<GeometryError> for AppError {
    fn from(error: GeometryError) -> Self {
        Error::from(error).into()
    }
}

impl From<RenderError> for AppError {
    fn from(error: RenderError) -> Self {
        Error::from(error).into()
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
                ..
            } => Self::Other {
                status,
                kind,
                detail,
                parameter: Some(place.to_owned()),
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
            Self::Cases(error) => return of_cases(error),
            Self::NotACaseId => (StatusCode::NOT_FOUND, "not-a-case-id"),
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
            Self::Unauthorized => (StatusCode::UNAUTHORIZED, "unauthorized"),
            Self::ProxyRefused { .. } => (StatusCode::UNAUTHORIZED, "proxy-refused"),
            Self::TokenEnded => (StatusCode::UNAUTHORIZED, "token-ended"),
            Self::MissingScope { .. } => (StatusCode::FORBIDDEN, "missing-scope"),
            Self::AuditFull => (StatusCode::INSUFFICIENT_STORAGE, "audit-full"),
            Self::CrossSite => (StatusCode::FORBIDDEN, "cross-site"),
            Self::WrongHost => (StatusCode::MISDIRECTED_REQUEST, "wrong-host"),
            Self::NotDicom => (StatusCode::NOT_FOUND, "not-dicom"),
            Self::NoSuchRoute => (StatusCode::NOT_FOUND, "no-such-address"),
            Self::MethodNotAllowed => (StatusCode::METHOD_NOT_ALLOWED, "method-not-allowed"),
            Self::Other { status, kind, .. } => (*status, *kind),
            Self::TimedOut | Self::TooManyPictures { .. } => {
                (StatusCode::SERVICE_UNAVAILABLE, "timed-out")
            }
        };
        (status, kind.into())
    }

    /// The sentence for the client.
    fn detail(&self) -> String {
        match self {
            // Messages about the disk may contain paths, so they belong in the log.
            Self::Cases(Error::Store(_)) => Error::Internal.to_string(),
            other => other.to_string(),
        }
    }

    fn parameter(&self) -> Option<String> {
        match self {
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
            detail: self.detail(),
            parameter: self.parameter(),
            reason: self.reason(),
        }
    }

    fn reason(&self) -> Option<String> {
        match self {
            Self::Cases(Error::NoSurfaces(reason)) => Some(reason.code.to_string()),
            _ => None,
        }
    }
}

/// The status and the last part of the problem's type for each error of the application.
fn of_cases(error: &Error) -> (StatusCode, Cow<'static, str>) {
    let (status, kind) = match error {
        Error::NoSuchCase => (StatusCode::NOT_FOUND, "no-such-case"),
        Error::NotReady { .. } => (StatusCode::CONFLICT, "case-not-ready"),
        Error::LayerNotReady => (StatusCode::CONFLICT, "layer-not-ready"),
        Error::LayerClosed(_) => (StatusCode::CONFLICT, "closed"),
        Error::NoSuchLayer => (StatusCode::NOT_FOUND, "no-such-layer"),
        Error::TooManyLayers { .. } => (StatusCode::CONFLICT, "too-many-layers"),
        Error::LayerNameTaken => (StatusCode::CONFLICT, "layer-name-taken"),
        Error::MapsUndefined(_) => (StatusCode::CONFLICT, "maps-undefined"),
        Error::NoSurfaces(_) => (StatusCode::CONFLICT, "no-surfaces"),
        Error::Failure(failure) => return (status_of(failure.kind), failure.name.clone().into()),
        Error::Parameter { kind, .. } => (StatusCode::BAD_REQUEST, *kind),
        Error::Geometry(_) => (StatusCode::UNPROCESSABLE_ENTITY, "geometry"),
        Error::Busy | Error::BusyFor(_) => (StatusCode::SERVICE_UNAVAILABLE, "busy"),
        Error::Unavailable | Error::Mismatch(_) => (StatusCode::SERVICE_UNAVAILABLE, "unavailable"),
        Error::SourceMissing => (StatusCode::SERVICE_UNAVAILABLE, case::SOURCE_MISSING),
        Error::StorageFull => (StatusCode::INSUFFICIENT_STORAGE, "storage-full"),
        Error::StorageFailed(_) => (StatusCode::INSUFFICIENT_STORAGE, "storage-failed"),
        Error::Store(_) => (StatusCode::INTERNAL_SERVER_ERROR, "store"),
        Error::Internal => (StatusCode::INTERNAL_SERVER_ERROR, "internal"),
    };
    (status, kind.into())
}

/// The status for each kind of failure.
fn status_of(kind: FailureKind) -> StatusCode {
    match kind {
        FailureKind::NotRecognised => StatusCode::UNSUPPORTED_MEDIA_TYPE,
        FailureKind::TooLarge => StatusCode::PAYLOAD_TOO_LARGE,
        FailureKind::Unusable => StatusCode::UNPROCESSABLE_ENTITY,
        FailureKind::NotSupported => StatusCode::NOT_IMPLEMENTED,
        FailureKind::OutOfMemory => StatusCode::SERVICE_UNAVAILABLE,
        FailureKind::Cancelled => StatusCode::CONFLICT,
        FailureKind::Internal => StatusCode::INTERNAL_SERVER_ERROR,
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
fn extra_header(error: &AppError, status: StatusCode) -> Option<(header::HeaderName, HeaderValue)> {
    match error {
        AppError::Unauthorized | AppError::ProxyRefused { .. } => Some((
            header::WWW_AUTHENTICATE,
            HeaderValue::from_static("Bearer realm=\"isocortex\""),
        )),
        AppError::TokenEnded => Some((
            header::WWW_AUTHENTICATE,
            HeaderValue::from_static(
                "Bearer realm=\"isocortex\", error=\"invalid_token\", error_description=\"the token has ended\"",
            ),
        )),
        AppError::MissingScope { scope, .. } => {
            let challenge = format!(
                "Bearer realm=\"isocortex\", error=\"insufficient_scope\", scope=\"{scope}\""
            );
            Some((
                header::WWW_AUTHENTICATE,
                HeaderValue::from_str(&challenge).ok()?,
            ))
        }
        AppError::RangeNotSatisfiable { length } => {
            let value = HeaderValue::from_str(&format!("bytes */{length}")).ok()?;
            Some((header::CONTENT_RANGE, value))
        }
        AppError::Cases(Error::NotReady { .. } | Error::LayerNotReady) => {
            Some((header::RETRY_AFTER, RETRY_SECONDS.into()))
        }
        AppError::Cases(Error::BusyFor(wait)) => {
            let seconds = wait.as_secs_f64().round().clamp(1.0, 60.0) as u64;
            Some((header::RETRY_AFTER, seconds.into()))
        }
        // A repeated request would not help.
        AppError::TooManyPictures { .. } => None,
        _ if status == StatusCode::SERVICE_UNAVAILABLE => {
            Some((header::RETRY_AFTER, RETRY_SECONDS.into()))
        }
        _ => None,
    }
}

/// Errors of the store are logged here, once; an error of a client appears in the line of its request.
fn log(error: &AppError) {
    if let AppError::Cases(Error::Store(cause) | Error::StorageFailed(cause)) = error {
        let source = std::error::Error::source(cause).map(ToString::to_string);
        tracing::error!(%cause, source, "the store failed");
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_failing_disk_shows_no_path() {
        let disk = std::io::Error::other("/home/someone/store is full");
        let problem = AppError::from(StoreError::Disk(disk)).problem();
        assert_eq!(problem.status, 507);
        assert_eq!(problem.kind, "urn:isocortex:problem:storage-failed");
        assert!(!problem.detail.contains("/home"));
    }

    #[test]
    fn a_failure_keeps_its_name_and_gets_the_status_of_its_kind() {
        let failure = Failure::unusable("mask-missing", "a mask is needed");
        let problem = AppError::from(failure).problem();
        assert_eq!(problem.kind, "urn:isocortex:problem:mask-missing");
        assert_eq!(problem.status, 422);
    }

    #[test]
    fn a_full_queue_says_when_to_come_again() {
        let response =
            AppError::from(StoreError::QueueFull(Duration::from_secs(20))).into_response();
        assert_eq!(response.status(), 503);
        assert_eq!(response.headers()[header::RETRY_AFTER], "20");
    }
}
