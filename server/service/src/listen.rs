//! From sockets to requests: time limits, a cap on connections and an orderly end.
//!
//! `axum::serve` sets no timer for the headers of a request, so that half a header holds a connection for ever; this loop does.

use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::body::Body;
use axum::http::Request;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::GracefulShutdown;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tower::ServiceExt as _;

use crate::unstalled::Unstalled;

/// How long to wait after the system refused a connection for want of descriptors.
const PAUSE_AFTER_REFUSAL: Duration = Duration::from_millis(100);

/// What connections may take.
#[derive(Debug, Clone, Copy)]
pub struct ConnectionLimits {
    /// Connections at a time; more wait in the system's queue.
    pub connections: usize,
    /// Time for the headers of a request, and for which a connection may be idle between two.
    pub header_timeout: Duration,
    /// Time within which a client must take the next bytes of an answer.
    pub write_timeout: Duration,
    /// Time for requests at work to finish when the server stops.
    pub shutdown_grace: Duration,
}

/// Serves `app` until `stop` resolves, then finishes the requests at work within the grace.
pub async fn serve(
    listener: TcpListener,
    app: Router,
    limits: ConnectionLimits,
    stop: impl Future<Output = ()>,
) {
    let room = Arc::new(Semaphore::new(limits.connections));
    let graceful = GracefulShutdown::new();
    let mut stop = std::pin::pin!(stop);
    loop {
        let accepted = tokio::select! {
            () = &mut stop => break,
            accepted = accept(&listener, &room) => accepted,
        };
        let Some((stream, permit)) = accepted else {
            tokio::time::sleep(PAUSE_AFTER_REFUSAL).await;
            continue;
        };
        let stream = Unstalled::new(stream, limits.write_timeout);
        let connection = connection(stream, app.clone(), limits.header_timeout);
        let connection = graceful.watch(connection);
        tokio::spawn(async move {
            // What fails here is the client's side: a cut connection, a timeout, a bad request line.
            if let Err(error) = connection.await {
                tracing::debug!(%error, "connection ended");
            }
            drop(permit);
        });
    }
    drop(listener);
    if tokio::time::timeout(limits.shutdown_grace, graceful.shutdown())
        .await
        .is_err()
    {
        tracing::warn!("stopped before every request was answered");
    }
}

/// The next connection, once there is room for it; `None` where the system has none to give.
async fn accept(
    listener: &TcpListener,
    room: &Arc<Semaphore>,
) -> Option<(TcpStream, OwnedSemaphorePermit)> {
    let permit = Arc::clone(room).acquire_owned().await.ok()?;
    match listener.accept().await {
        Ok((stream, _)) => {
            // Small answers must not wait for the acknowledgement of the one before.
            if let Err(error) = stream.set_nodelay(true) {
                tracing::debug!(%error, "TCP_NODELAY refused");
            }
            Some((stream, permit))
        }
        Err(error) => {
            tracing::warn!(%error, "no connection could be accepted");
            None
        }
    }
}

fn connection(
    stream: Unstalled<TcpStream>,
    app: Router,
    header_timeout: Duration,
) -> http1::Connection<
    TokioIo<Unstalled<TcpStream>>,
    impl hyper::service::Service<
        Request<hyper::body::Incoming>,
        Response = axum::response::Response,
        Error = Infallible,
        Future: Send,
    >,
> {
    let service = hyper::service::service_fn(move |request: Request<hyper::body::Incoming>| {
        app.clone().oneshot(request.map(Body::new))
    });
    http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(header_timeout)
        .max_headers(64)
        .serve_connection(TokioIo::new(stream), service)
}
