//! Accepts connections: time limits, a cap on connections and an orderly shutdown.
//!
//! `axum::serve` has no timeout for the headers of a request, so that half a header holds a connection for ever; this
//! loop has one.

use std::convert::Infallible;
use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use axum::extract::{FromRequestParts, Request};
use axum::http::request::Parts;
use axum::http::{Extensions, HeaderValue, header};
use axum::response::Response;
use axum::{BoxError, Router};
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::GracefulShutdown;
use ipnet::IpNet;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpListener;
#[cfg(unix)]
use tokio::net::UnixListener;
use tokio_rustls::TlsAcceptor;
use tower::ServiceExt as _;

use crate::door::{Connection, Door};
use crate::pace::{Hurry, LeastRate, PacedBody};
use crate::tls::ReloadedTls;
use crate::unstalled::Unstalled;
use cases::places::{Client, Identity, Place, Places, network_of};

/// How long to wait after the system is out of descriptors.
const PAUSE_AFTER_REFUSAL: Duration = Duration::from_millis(100);

/// Time for the headers of a request while strangers crowd.
const CROWDED_HEADER_TIMEOUT: Duration = Duration::from_secs(3);

/// The bytes after which headers that have not ended are refused.
const MAX_HEADER_BYTES: usize = 64 << 10;

/// Tells browsers to use TLS alone for a year, if they have been answered by TLS.
const TLS_ALONE: HeaderValue = HeaderValue::from_static("max-age=31536000");

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

/// The client of a request, for places and turns. The guard of routes knows the identity.
pub fn client_of(extensions: &Extensions) -> Client {
    Client {
        address: Peer::of_extensions(extensions),
        identity: extensions.get::<Identity>().copied(),
    }
}

/// The client of a request ([`client_of`]), for handlers that do not take the request.
#[derive(Debug, Clone, Copy)]
pub struct ThisClient(pub Client);

impl<S: Sync> FromRequestParts<S> for ThisClient {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _state: &S) -> Result<Self, Infallible> {
        Ok(Self(client_of(&parts.extensions)))
    }
}

/// Whether a request comes by the connection of a proxy that the configuration trusts.
#[derive(Debug, Clone, Copy)]
pub struct ByProxy(pub bool);

impl<S: Sync> FromRequestParts<S> for ByProxy {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _state: &S) -> Result<Self, Infallible> {
        let connection = parts.extensions.get::<Arc<Connection>>();
        Ok(Self(
            connection.is_some_and(|connection| connection.is_of_proxy()),
        ))
    }
}

/// A place for a request, if there is one for its client. The fewer places are left, the faster its body must come.
pub fn place_for(request: &Request, places: &Places) -> Option<Place> {
    let place = places.take(client_of(request.extensions()))?;
    if let Some(hurry) = request.extensions().get::<Hurry>() {
        hurry.by(places);
    }
    Some(place)
}

/// Serves `app` until `stop` resolves, then finishes running requests within the grace period. With TLS, nothing else is served.
pub async fn serve(
    listener: impl Into<Listener>,
    app: Router,
    limits: ConnectionLimits,
    tls: Option<ReloadedTls>,
    stop: impl Future<Output = ()>,
) {
    let door = Door::new(
        limits.connections,
        limits.connections_per_address,
        limits.trusted_proxies.clone(),
    );
    let listener = listener.into();
    let graceful = GracefulShutdown::new();
    let mut stop = std::pin::pin!(stop);
    loop {
        let accepted = tokio::select! {
            () = &mut stop => break,
            accepted = accept(&listener) => accepted,
        };
        let Some(Accepted { stream, address }) = accepted else {
            tokio::time::sleep(PAUSE_AFTER_REFUSAL).await;
            continue;
        };
        let open = door.enter(address);
        let header_timeout = header_timeout(&limits, door.is_crowded());
        let stream = Unstalled::new(stream, limits.least_rate);
        let acceptor = tls.as_ref().map(|tls| TlsAcceptor::from(tls.current()));
        let service = service(
            app.clone(),
            door.clone(),
            open.0.clone(),
            address,
            limits.least_rate,
            acceptor.is_some(),
        );
        let watcher = graceful.watcher();
        tokio::spawn(async move {
            let served = async {
                let stream = secured(stream, acceptor, header_timeout).await?;
                let connection =
                    http1(header_timeout).serve_connection(TokioIo::new(stream), service);
                Ok::<_, BoxError>(watcher.watch(connection).await?)
            };
            let ended = tokio::select! {
                () = open.0.evicted() => return,
                ended = served => ended,
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

/// Where connections come from.
#[derive(Debug)]
pub enum Listener {
    /// The network.
    Tcp(TcpListener),
    /// A socket in the file system, for a proxy alone.
    #[cfg(unix)]
    Unix(UnixListener),
}

impl From<TcpListener> for Listener {
    fn from(listener: TcpListener) -> Self {
        Self::Tcp(listener)
    }
}

/// A connection, and the address of the other end, if it has one.
struct Accepted {
    stream: Box<dyn Connected>,
    address: Option<IpAddr>,
}

/// The next connection; `None` if the system cannot accept one.
async fn accept(listener: &Listener) -> Option<Accepted> {
    let accepted = match listener {
        Listener::Tcp(listener) => listener.accept().await.map(|(stream, address)| {
            // Small answers must not wait for the acknowledgement of the one before.
            if let Err(error) = stream.set_nodelay(true) {
                tracing::debug!(%error, "TCP_NODELAY refused");
            }
            Accepted {
                stream: Box::new(stream),
                address: Some(address.ip()),
            }
        }),
        #[cfg(unix)]
        Listener::Unix(listener) => listener.accept().await.map(|(stream, _)| Accepted {
            stream: Box::new(stream),
            address: None,
        }),
    };
    let accepted =
        accepted.inspect_err(|error| tracing::warn!(%error, "cannot accept a connection"));
    accepted.ok()
}

/// A connection of any kind, by TLS or not.
trait Connected: AsyncRead + AsyncWrite + Send + Unpin {}

impl<S: AsyncRead + AsyncWrite + Send + Unpin> Connected for S {}

/// The connection, by TLS if there is an acceptor. A handshake has the time of a header.
async fn secured(
    stream: Unstalled<Box<dyn Connected>>,
    acceptor: Option<TlsAcceptor>,
    header_timeout: Duration,
) -> Result<Box<dyn Connected>, BoxError> {
    let Some(acceptor) = acceptor else {
        return Ok(Box::new(stream));
    };
    let accepted = tokio::time::timeout(header_timeout, acceptor.accept(stream)).await;
    Ok(Box::new(accepted??))
}

/// The time for the headers of a request.
fn header_timeout(limits: &ConnectionLimits, crowded: bool) -> Duration {
    if crowded {
        limits.header_timeout.min(CROWDED_HEADER_TIMEOUT)
    } else {
        limits.header_timeout
    }
}

fn http1(header_timeout: Duration) -> http1::Builder {
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
    address: Option<IpAddr>,
    least_rate: LeastRate,
    by_tls: bool,
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
        let answered = app.clone().oneshot(request);
        async move {
            let mut response = answered.await?;
            if by_tls {
                let headers = response.headers_mut();
                headers.insert(header::STRICT_TRANSPORT_SECURITY, TLS_ALONE);
            }
            Ok(response)
        }
    })
}
