//! What is replaced by whoever knows its version: the findings of a case, and readings.

use axum::body::Bytes;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use cases::Error;
use cases::findings::NotReplaced;
use serde::Serialize;

use http::conditional::{EntityTag, REVALIDATE, Representation};
use http::negotiate::Coding;
use http::problem::{AppError, Problem};

pub(super) const JSON: &str = "application/json";

/// What is replaced by whoever knows its version.
pub(super) trait Versioned: Sized {
    /// The problem of one that is wrong.
    const INVALID: &'static str;
    /// The problem of one that has changed meanwhile, and its sentence.
    const CHANGED: (&'static str, &'static str);

    fn tag(&self) -> EntityTag;

    /// The body of an answer.
    fn shown(self) -> impl Serialize;

    /// The same with a problem.
    fn changed(self, problem: Problem) -> impl Serialize;
}

/// The strong tags of `If-Match`; `None` if there are none.
pub(super) fn known_tags(request: &HeaderMap) -> Option<Vec<&str>> {
    let tags = request.get(header::IF_MATCH)?.to_str().ok()?.split(',');
    let tags = tags.filter_map(|tag| tag.trim().strip_prefix('"')?.strip_suffix('"'));
    let tags: Vec<_> = tags.collect();
    (!tags.is_empty()).then_some(tags)
}

pub(super) fn precondition_required() -> AppError {
    AppError::new(
        StatusCode::PRECONDITION_REQUIRED,
        "if-match-missing",
        "send `If-Match` with the `ETag` of what you have changed",
    )
}

/// What is stored now, or why it was not replaced.
pub(super) fn answer<Current: Versioned>(
    replaced: Result<Current, NotReplaced<Current>>,
) -> Result<Response, AppError> {
    match replaced {
        Ok(stored) => as_json(stored)?.respond(&HeaderMap::new()),
        Err(NotReplaced::Changed(current)) => Ok(changed(current)),
        Err(NotReplaced::Refused(refused)) => Err(AppError::invalid(
            Current::INVALID,
            refused.path,
            refused.detail,
        )),
        Err(NotReplaced::Elsewhere(detail)) => Err(AppError::new(
            StatusCode::CONFLICT,
            "findings-elsewhere",
            detail,
        )),
        Err(NotReplaced::Closed(detail)) => {
            Err(AppError::new(StatusCode::CONFLICT, "closed", detail))
        }
        Err(NotReplaced::Other(error)) => Err(error.into()),
    }
}

fn changed<Current: Versioned>(current: Current) -> Response {
    let status = StatusCode::PRECONDITION_FAILED;
    let (kind, detail) = Current::CHANGED;
    let problem = AppError::new(status, kind, detail).problem();
    let tag = current.tag();
    let mut response = (status, axum::Json(current.changed(problem))).into_response();
    let headers = response.headers_mut();
    for (name, value) in [
        (
            header::CONTENT_TYPE,
            HeaderValue::from_static("application/problem+json"),
        ),
        (header::CACHE_CONTROL, HeaderValue::from_static("no-store")),
        (header::ETAG, tag.header()),
    ] {
        headers.insert(name, value);
    }
    response
}

pub(super) fn as_json(current: impl Versioned) -> Result<Representation, AppError> {
    let tag = current.tag();
    let body = serde_json::to_vec(&current.shown()).map_err(|_| Error::Internal)?;
    Ok(represented(tag, JSON, body.into()))
}

pub(super) fn represented(tag: EntityTag, media_type: &'static str, body: Bytes) -> Representation {
    Representation {
        tag,
        media_type,
        coding: Coding::Identity,
        body,
        headers: HeaderMap::new(),
        vary: "accept",
        cache_control: REVALIDATE,
    }
}
