//! What `isocortex work` answers: whether it lives, whether its store can be used, and its metrics. No case, so no token.

use axum::Router;
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use axum::routing::get;
use cases::Error;
use cases::ready::check_ready;
use http::metrics::{Metrics, OPEN_METRICS};
use http::problem::AppError;
use storage::Store;

use crate::figures;

/// The routes of a worker on a store.
pub(crate) fn routes(store: Store) -> Router {
    let metrics = Metrics::new();
    figures::add_store(&metrics, &store);
    Router::new()
        .route("/healthz", get(|| async { "ok\n" }))
        .route("/readyz", get(readyz).with_state(store))
        .route("/metrics", get(all).with_state(metrics))
        .fallback(|| async { AppError::no_such_route() })
        .method_not_allowed_fallback(|| async { AppError::method_not_allowed() })
}

async fn readyz(State(store): State<Store>) -> Result<Response, AppError> {
    check_ready(&store).await?;
    Ok((StatusCode::OK, "ok\n").into_response())
}

async fn all(State(metrics): State<Metrics>) -> Result<Response, AppError> {
    let text = metrics.all(0).await.map_err(|_| Error::Internal)?;
    let headers = [
        (header::CONTENT_TYPE, OPEN_METRICS),
        (header::CACHE_CONTROL, "no-store"),
    ];
    Ok((headers, text).into_response())
}
