//! Answers that change with time.

use axum::Json;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use serde::Serialize;

use crate::conditional::insert;

/// JSON that no cache may keep.
pub fn fresh_json(status: StatusCode, body: &impl Serialize) -> Response {
    let mut response = (status, Json(body)).into_response();
    response
        .headers_mut()
        .insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    response
}

/// Seconds to wait before the first request for the state of what is queued.
const RETRY_SECONDS: HeaderValue = HeaderValue::from_static("1");

/// The answer about what a request has made, with its address: 202 if it is queued, 200 if it was there.
pub fn made_at(address: &str, is_queued: bool, body: &impl Serialize) -> Response {
    let status = match is_queued {
        true => StatusCode::ACCEPTED,
        false => StatusCode::OK,
    };
    let mut response = fresh_json(status, body);
    let headers = response.headers_mut();
    insert(headers, header::LOCATION, address);
    if is_queued {
        headers.insert(header::RETRY_AFTER, RETRY_SECONDS);
    }
    response
}
