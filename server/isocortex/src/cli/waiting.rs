//! Waiting for a database or a bucket that does not answer.

use std::net::SocketAddr;
use std::pin::pin;
use std::time::Duration;

use axum::routing::get;
use axum::{Json, Router};
use http::listen;
use http::problem::AppError;
use http::tls::ReloadedTls;
use serde_json::json;
use tokio::sync::oneshot;

use super::process::{bind, told_to_stop};
use super::status::CliError;
use crate::config::Config;
use crate::start::StartError;

/// How long to wait before the next attempt.
const TRY_AGAIN_AFTER: Duration = Duration::from_secs(1);

/// What `open` opens, once the store can be reached; `None` if the process is told to stop before. Meanwhile it answers at `address` that it
/// lives and is not ready, and the log states the cause once.
pub(super) async fn opened<T, F>(
    config: &Config,
    address: Option<SocketAddr>,
    tls: Option<ReloadedTls>,
    open: impl Fn() -> F,
) -> Result<Option<T>, CliError>
where
    F: Future<Output = Result<T, StartError>>,
{
    let mut told = pin!(told_to_stop());
    let mut said = String::new();
    let mut answering = None;
    let result = loop {
        let opened = tokio::select! {
            opened = open() => opened,
            () = &mut told => break Ok(None),
        };
        let error = match opened {
            Err(StartError::Cases(cases::StartError::Store(error))) if error.is_away() => error,
            opened => break opened.map(Some).map_err(CliError::from),
        };
        let cause = error.cause();
        if cause != said {
            tracing::warn!(%error, cause, "waiting for the store");
            said = cause;
        }
        if let Some(address) = address
            && answering.is_none()
        {
            let (listener, _) = bind(address).await?;
            let (stop, stopped) = oneshot::channel::<()>();
            let limits = config.connection_limits();
            let stopped = async move { _ = stopped.await };
            let serving = listen::serve(listener, routes(), limits, tls.clone(), stopped);
            answering = Some((stop, tokio::spawn(serving)));
        }
        tokio::select! {
            () = tokio::time::sleep(TRY_AGAIN_AFTER) => {}
            () = &mut told => break Ok(None),
        }
    };
    if let Some((stop, serving)) = answering {
        drop(stop);
        // The port must be free again.
        let _ended = serving.await;
    }
    result
}

fn routes() -> Router {
    Router::new()
        .route("/healthz", get(|| async { Json(json!({"status": "ok"})) }))
        .fallback(|| async { AppError::from(cases::Error::Unavailable) })
}
