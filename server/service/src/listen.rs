//! From sockets to requests: time limits, a cap on connections and an orderly end.
//!
//! `axum::serve` sets no timer for the headers of a request, so that half a header holds a connection for ever; this loop does.

use std::convert::Infallible;
use std::net::IpAddr;
use std::time::Duration;

use axum::Router;
use axum::body::Body;
use axum::extract::Request;
use axum::http::{HeaderValue, header};
use axum::response::{IntoResponse as _, Response};
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::GracefulShutdown;
use tokio::net::{TcpListener, TcpStream};
use tower::ServiceExt as _;

use cases::Error;

use crate::pace::{LeastRate, PacedBody};
use crate::places::{Places, Spares};
use crate::problem::AppError;
use crate::unstalled::Unstalled;

/// How long to wait after the system refused a connection for want of descriptors.
const PAUSE_AFTER_REFUSAL: Duration = Duration::from_millis(100);

/// How long a connection beyond all places may take altogether.
const SPARE_TIME: Duration = Duration::from_secs(5);

/// What a connection beyond all places may ask for.
const SPARE_ROUTES: [&str; 3] = ["/healthz", "/readyz", "/metrics"];

/// What connections may take.
#[derive(Debug, Clone, Copy)]
pub struct ConnectionLimits {
    /// Connections at a time. Of those beyond only health checks are answered.
    pub connections: usize,
    /// Of these, how many may come from one address.
    pub connections_per_address: usize,
    /// Time for the headers of a request, and for which a connection may be idle between two.
    pub header_timeout: Duration,
    /// How fast a client must send the body of a request, and take that of an answer.
    pub least_rate: LeastRate,
    /// Time for requests at work to finish when the server stops.
    pub shutdown_grace: Duration,
}

/// Who asks: an extension of every request that came through a socket.
#[derive(Debug, Clone, Copy)]
pub struct Peer(pub IpAddr);

/// Serves `app` until `stop` resolves, then finishes the requests at work within the grace.
pub async fn serve(
    listener: TcpListener,
    app: Router,
    limits: ConnectionLimits,
    stop: impl Future<Output = ()>,
) {
    let places = Places::new(limits.connections, limits.connections_per_address);
    let mut spares = Spares::default();
    let graceful = GracefulShutdown::new();
    let mut stop = std::pin::pin!(stop);
    loop {
        let accepted = tokio::select! {
            () = &mut stop => break,
            accepted = accept(&listener) => accepted,
        };
        let Some((stream, peer)) = accepted else {
            tokio::time::sleep(PAUSE_AFTER_REFUSAL).await;
            continue;
        };
        let Some(place) = places.take(peer.0) else {
            let spare = tokio::spawn(serve_spare(stream, peer, app.clone(), limits));
            spares.add(spare.abort_handle());
            continue;
        };
        let app = app.clone();
        let answer = move |request| app.clone().oneshot(request);
        let connection = connection(http1(limits), stream, peer, limits.least_rate, answer);
        let connection = graceful.watch(connection);
        tokio::spawn(async move {
            // What fails here is the client's side: a cut connection, a timeout, a bad request line.
            if let Err(error) = connection.await {
                tracing::debug!(%error, "connection ended");
            }
            drop(place);
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

/// The next connection; `None` if the system has none to give.
async fn accept(listener: &TcpListener) -> Option<(TcpStream, Peer)> {
    match listener.accept().await {
        Ok((stream, address)) => {
            // Small answers must not wait for the acknowledgement of the one before.
            if let Err(error) = stream.set_nodelay(true) {
                tracing::debug!(%error, "TCP_NODELAY refused");
            }
            Some((stream, Peer(address.ip())))
        }
        Err(error) => {
            tracing::warn!(%error, "no connection could be accepted");
            None
        }
    }
}

fn http1(limits: ConnectionLimits) -> http1::Builder {
    let mut builder = http1::Builder::new();
    builder
        .timer(TokioTimer::new())
        .header_read_timeout(limits.header_timeout)
        .max_headers(64);
    builder
}

/// Answers one health check on a connection that is one too many, and tells other requests to come again.
async fn serve_spare(stream: TcpStream, peer: Peer, app: Router, limits: ConnectionLimits) {
    let answer = move |request: Request| {
        let app = app.clone();
        async move {
            if SPARE_ROUTES.contains(&request.uri().path()) {
                return app.oneshot(request).await;
            }
            let mut busy = AppError::from(Error::Busy).into_response();
            let close = HeaderValue::from_static("close");
            busy.headers_mut().insert(header::CONNECTION, close);
            Ok(busy)
        }
    };
    let mut builder = http1(limits);
    builder.keep_alive(false);
    let connection = connection(builder, stream, peer, limits.least_rate, answer);
    // An error, or the end of the time, is the client's loss.
    let _ = tokio::time::timeout(SPARE_TIME, connection).await;
}

fn connection<F>(
    builder: http1::Builder,
    stream: TcpStream,
    peer: Peer,
    least_rate: LeastRate,
    answer: impl Fn(Request) -> F + Clone,
) -> http1::Connection<
    TokioIo<Unstalled<TcpStream>>,
    impl hyper::service::Service<
        axum::http::Request<Incoming>,
        Response = Response,
        Error = Infallible,
        Future = F,
    >,
>
where
    F: Future<Output = Result<Response, Infallible>> + Send,
{
    let service = hyper::service::service_fn(move |request: axum::http::Request<Incoming>| {
        let mut request = request.map(|body| Body::new(PacedBody::new(body, least_rate)));
        request.extensions_mut().insert(peer);
        answer(request)
    });
    let stream = Unstalled::new(stream, least_rate);
    builder.serve_connection(TokioIo::new(stream), service)
}
