//! The whole service as one router.

use std::any::Any;

use axum::Router;
use axum::extract::FromRef as _;
use axum::http::{HeaderName, HeaderValue, Response, header};
use axum::middleware;
use axum::response::IntoResponse;
use cases::Error;
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::request_id::{PropagateRequestIdLayer, SetRequestIdLayer};
use utoipa::openapi::OpenApi;

use crate::routes;
use crate::state::AppState;
use http_support::auth::{self, Access};
use http_support::logs::{self, MakeId, REQUEST_ID};
use http_support::metrics::Metrics;
use http_support::problem::AppError;

/// Headers of every answer: nothing from another host, no frames but its own, no guessed types.
const SECURITY_HEADERS: [(HeaderName, &str); 6] = [
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "no-referrer"),
    (
        header::CONTENT_SECURITY_POLICY,
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; \
         connect-src 'self'; frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'self'",
    ),
    (
        HeaderName::from_static("cross-origin-resource-policy"),
        "same-origin",
    ),
    (
        HeaderName::from_static("cross-origin-opener-policy"),
        "same-origin",
    ),
    (
        HeaderName::from_static("permissions-policy"),
        "camera=(), geolocation=(), microphone=()",
    ),
];

/// Routes of another protocol, which stand beside those of the service and behind the same guards.
pub struct Beside {
    /// Those that need the token.
    pub guarded: Router,
    /// Their description.
    pub description: OpenApi,
}

/// Builds the whole service. Serve it, or call `oneshot` without a socket.
pub fn app(state: AppState) -> Router {
    let (routes, openapi) = routes::all(&state);
    finish(state, routes, &openapi)
}

/// As [`app`], with the routes of another protocol.
pub fn app_beside(state: AppState, beside: Beside) -> Router {
    let (routes, openapi) = routes::all(&state);
    let mut description = beside.description;
    routes::guarded::describe(&mut description);
    let guard = middleware::from_fn_with_state(Access::from_ref(&state), auth::require_token);
    let guarded = beside.guarded.route_layer(guard);
    let routes = routes.merge(guarded.with_state(()));
    finish(state, routes, &openapi.merge_from(description))
}

fn finish(state: AppState, routes: Router<AppState>, openapi: &OpenApi) -> Router {
    let (access, metrics) = (Access::from_ref(&state), Metrics::from_ref(&state));
    routes
        .merge(routes::documents::routes(openapi))
        .fallback(|| async { AppError::NoSuchRoute })
        .method_not_allowed_fallback(|| async { AppError::MethodNotAllowed })
        .layer(middleware::from_fn_with_state(access, auth::guard_origin))
        .layer(CatchPanicLayer::custom(panicked))
        .layer(middleware::map_response(add_security_headers))
        .layer(middleware::from_fn_with_state(metrics, logs::observe))
        .layer(PropagateRequestIdLayer::new(REQUEST_ID))
        .layer(SetRequestIdLayer::new(REQUEST_ID, MakeId))
        .layer(middleware::from_fn(logs::drop_bad_request_id))
        .with_state(state)
}

async fn add_security_headers<B>(mut response: Response<B>) -> Response<B> {
    for (name, value) in SECURITY_HEADERS {
        let headers = response.headers_mut();
        headers
            .entry(name)
            .or_insert(HeaderValue::from_static(value));
    }
    response
}

/// The panic hook writes the text of the panic to standard error; it never reaches the client.
fn panicked(_panic: Box<dyn Any + Send + 'static>) -> axum::response::Response {
    tracing::error!("a handler panicked");
    AppError::from(Error::Internal).into_response()
}
