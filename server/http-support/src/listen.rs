//! Accepts connections: time limits, a cap on connections and an orderly shutdown.
//!
//! `axum::serve` has no timeout for the headers of a request, so that half a header holds a connection for ever; this
//! loop has one.

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
use crate::places::{Places, Spares, network_of};
use crate::problem::AppError;
use crate::unstalled::Unstalled;

/// How long to wait after the system is out of descriptors.
const PAUSE_AFTER_REFUSAL: Duration = Duration::from_millis(100);

/// The time limit of a connection beyond the cap.
const SPARE_TIME: Duration = Duration::from_secs(5);

/// The paths that a connection beyond the cap may request.
const SPARE_ROUTES: [&str; 3] = ["/healthz", "/readyz", "/metrics"];

/// Limits of connections.
#[derive(Debug, Clone, Copy)]
pub struct ConnectionLimits {
    /// Connections at a time. Beyond this, only health checks are answered.
    pub connections: usize,
    /// Of these, connections from one address.
    pub connections_per_address: usize,
    /// Time for the headers of a request, and for which a connection may be idle between two.
    pub header_timeout: Duration,
    /// The minimum rate at which a client must send and receive bodies.
    pub least_rate: LeastRate,
    /// Time for running requests to finish when the server stops.
    pub shutdown_grace: Duration,
}

/// The address of the client: an extension of every request from a socket.
#[derive(Debug, Clone, Copy)]
pub struct Peer(pub IpAddr);

impl Peer {
    /// The address that identifies the client of a request, if it came from a socket: for IPv6, the first 64 bits.
    pub fn of(request: &Request) -> Option<IpAddr> {
        let peer = request.extensions().get::<Self>();
        peer.map(|peer| network_of(peer.0))
    }
}

/// Serves `app` until `stop` resolves, then finishes running requests within the grace period.
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
            // A failure here is on the side of the client: a lost connection, a timeout, a bad request line.
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

/// The next connection; `None` if the system cannot accept one.
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
            tracing::warn!(%error, "cannot accept a connection");
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

/// Answers one health check on a connection beyond the cap, and 503 to other requests.
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
