//! Accepts connections: time limits, a cap on connections and an orderly shutdown.
//!
//! `axum::serve` has no timeout for the headers of a request, so that half a header holds a connection for ever; this
//! loop has one.

use std::convert::Infallible;
use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::body::Body;
use axum::extract::{FromRequestParts, Request};
use axum::http::Extensions;
use axum::http::request::Parts;
use axum::response::Response;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::GracefulShutdown;
use ipnet::IpNet;
use tokio::net::{TcpListener, TcpStream};
use tower::ServiceExt as _;

use crate::door::{Connection, Door};
use crate::pace::{Hurry, LeastRate, PacedBody};
use crate::unstalled::Unstalled;
use cases::places::{Place, Places, network_of};

/// How long to wait after the system is out of descriptors.
const PAUSE_AFTER_REFUSAL: Duration = Duration::from_millis(100);

/// Time for the headers of a request while strangers crowd.
const CROWDED_HEADER_TIMEOUT: Duration = Duration::from_secs(3);

/// The bytes after which headers that have not ended are refused.
const MAX_HEADER_BYTES: usize = 64 << 10;

/// Limits of connections.
#[derive(Debug, Clone)]
pub struct ConnectionLimits {
    /// Connections of clients with the right token at a time. Beyond this, they are answered 503. Others have 256
    /// connections of their own.
    pub connections: usize,
    /// Of these, connections from one address that is not a trusted proxy.
    pub connections_per_address: usize,
    /// The proxies that name the client in `X-Forwarded-For`.
    pub trusted_proxies: Arc<[IpNet]>,
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
        Self::of_extensions(request.extensions())
    }

    fn of_extensions(extensions: &Extensions) -> Option<IpAddr> {
        extensions.get::<Self>().map(|peer| network_of(peer.0))
    }
}

/// The address that identifies the client of a request ([`Peer::of`]), for handlers that do not take the request.
#[derive(Debug, Clone, Copy)]
pub struct ClientAddress(pub Option<IpAddr>);

impl<S: Sync> FromRequestParts<S> for ClientAddress {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _state: &S) -> Result<Self, Infallible> {
        Ok(Self(Peer::of_extensions(&parts.extensions)))
    }
}

/// A place for a request, if there is one for its client. The fewer places are left, the faster its body must come.
pub fn place_for(request: &Request, places: &Places) -> Option<Place> {
    let place = places.take(Peer::of(request))?;
    if let Some(hurry) = request.extensions().get::<Hurry>() {
        hurry.by(places);
    }
    Some(place)
}

/// Serves `app` until `stop` resolves, then finishes running requests within the grace period.
pub async fn serve(
    listener: TcpListener,
    app: Router,
    limits: ConnectionLimits,
    stop: impl Future<Output = ()>,
) {
    let door = Door::new(
        limits.connections,
        limits.connections_per_address,
        limits.trusted_proxies.clone(),
    );
    let graceful = GracefulShutdown::new();
    let mut stop = std::pin::pin!(stop);
    loop {
        let accepted = tokio::select! {
            () = &mut stop => break,
            accepted = accept(&listener) => accepted,
        };
        let Some((stream, address)) = accepted else {
            tokio::time::sleep(PAUSE_AFTER_REFUSAL).await;
            continue;
        };
        let open = door.enter(address);
        let builder = http1(&limits, door.is_crowded());
        let stream = TokioIo::new(Unstalled::new(stream, limits.least_rate));
        let service = service(
            app.clone(),
            door.clone(),
            open.0.clone(),
            address,
            limits.least_rate,
        );
        let connection = graceful.watch(builder.serve_connection(stream, service));
        tokio::spawn(async move {
            let ended = tokio::select! {
                () = open.0.evicted() => return,
                ended = connection => ended,
            };
            // A failure here is on the side of the client: a lost connection, a timeout, a bad request line.
            if let Err(error) = ended {
                tracing::debug!(%error, "connection ended");
            }
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
async fn accept(listener: &TcpListener) -> Option<(TcpStream, IpAddr)> {
    match listener.accept().await {
        Ok((stream, address)) => {
            // Small answers must not wait for the acknowledgement of the one before.
            if let Err(error) = stream.set_nodelay(true) {
                tracing::debug!(%error, "TCP_NODELAY refused");
            }
            Some((stream, address.ip()))
        }
        Err(error) => {
            tracing::warn!(%error, "cannot accept a connection");
            None
        }
    }
}

fn http1(limits: &ConnectionLimits, crowded: bool) -> http1::Builder {
    let header_timeout = if crowded {
        limits.header_timeout.min(CROWDED_HEADER_TIMEOUT)
    } else {
        limits.header_timeout
    };
    let mut builder = http1::Builder::new();
    builder
        .timer(TokioTimer::new())
        .header_read_timeout(header_timeout)
        .max_buf_size(MAX_HEADER_BYTES)
        .max_headers(64);
    builder
}

/// Answers the requests of a connection, which carry the connection and the address of their client.
fn service(
    app: Router,
    door: Door,
    connection: Arc<Connection>,
    address: IpAddr,
    least_rate: LeastRate,
) -> impl hyper::service::Service<
    axum::http::Request<Incoming>,
    Response = Response,
    Error = Infallible,
    Future = impl Future<Output = Result<Response, Infallible>> + Send,
> {
    hyper::service::service_fn(move |request: axum::http::Request<Incoming>| {
        let hurry = Hurry::default();
        let paced = |body| Body::new(PacedBody::new(body, least_rate, hurry.clone()));
        let mut request = request.map(paced);
        let client = door.client_of(address, request.headers());
        let extensions = request.extensions_mut();
        extensions.insert(Peer(client));
        extensions.insert(hurry);
        extensions.insert(connection.clone());
        app.clone().oneshot(request)
    })
}
