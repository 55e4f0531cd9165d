//! The server's own state.

use axum::Json;
use axum::extract::State;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use cases::Error;
use cases::ready::check_ready;
use serde::Serialize;
use utoipa::ToSchema;

use crate::state::AppState;
use access::AccessError;
use cases::pictures::GraphicsState;
use http::fresh::fresh_json;
use http::metrics::{Metrics, OPEN_METRICS};
use http::problem::{AppError, Problem};
use http::query::{ApiQuery, NoQuery};

/// The state of the process.
#[derive(Debug, Serialize, ToSchema)]
pub struct Health {
    /// `ok`.
    status: &'static str,
}

/// The version of the server.
#[derive(Debug, Serialize, ToSchema)]
pub struct Version {
    /// `isocortex`.
    name: &'static str,
    /// The version of the program.
    version: &'static str,
    /// The available renderers.
    renderers: [&'static str; 3],
    /// The graphics device, the reason why there is none, or that its driver has not answered yet.
    graphics: String,
    /// The notice.
    notice: &'static str,
}

/// Whether the server is alive
#[utoipa::path(get, path = "/healthz", tag = "service", responses((status = 200, description = "The server is alive", body = Health)))]
pub async fn healthz(_no_query: ApiQuery<NoQuery>) -> Response {
    fresh_json(StatusCode::OK, &Health { status: "ok" })
}

/// Whether the store can be reached and has room
#[utoipa::path(get, path = "/readyz", tag = "service", responses(
    (status = 200, description = "The store is reachable and has room", body = Health),
    (status = 503, description = "The store is unreachable", body = Problem, content_type = "application/problem+json"),
    (status = 507, description = "The disk is full or failed: cases can be viewed, but not uploaded; or the audit record cannot be written, and nothing can be viewed", body = Problem, content_type = "application/problem+json"),
))]
pub async fn readyz(
    State(state): State<AppState>,
    _no_query: ApiQuery<NoQuery>,
) -> Result<Response, AppError> {
    check_ready(state.cases.store()).await?;
    if state.audit().is_full() {
        return Err(AccessError::AuditFull.into());
    }
    Ok(fresh_json(StatusCode::OK, &Health { status: "ok" }))
}

/// Counts and times for Prometheus
#[utoipa::path(get, path = "/metrics", tag = "service", responses(
    (status = 200, description = "OpenMetrics text", body = String, content_type = "application/openmetrics-text"),
))]
pub async fn metrics(
    State(metrics): State<Metrics>,
    State(AppState { cases, .. }): State<AppState>,
    _no_query: ApiQuery<NoQuery>,
) -> Result<Response, AppError> {
    let text = metrics.all(cases.queue.waiting()).await;
    let text = text.map_err(|_| Error::Internal)?;
    let kind = HeaderValue::from_static(OPEN_METRICS);
    let fresh = HeaderValue::from_static("no-store");
    let headers = [(header::CONTENT_TYPE, kind), (header::CACHE_CONTROL, fresh)];
    Ok((headers, text).into_response())
}

/// The version of the server
#[utoipa::path(get, path = "/version", tag = "service", responses((status = 200, description = "Name and version", body = Version)))]
pub async fn version(
    State(AppState { cases, .. }): State<AppState>,
    _no_query: ApiQuery<NoQuery>,
) -> Json<Version> {
    let graphics = match cases.graphics.state() {
        GraphicsState::Starting => "starting".to_owned(),
        GraphicsState::Absent(why) => format!("none: {why}"),
        GraphicsState::Present(adapter) => adapter.line(),
    };
    Json(Version {
        name: "isocortex",
        version: env!("CARGO_PKG_VERSION"),
        renderers: ["splat", "mesh", "trace"],
        graphics,
        notice: render::RESEARCH_USE_NOTICE,
    })
}
