//! Accepts connections: time limits, a cap on connections and an orderly shutdown.
//!
//! `axum::serve` has no timeout for the headers of a request, so that half a header holds a connection for ever; this
//! loop has one.

use std::convert::Infallible;
use std::net::IpAddr;
use std::time::Duration;

use axum::body::Body;
use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use axum::http::{Extensions, HeaderValue, header};
use axum::response::Response;
use axum::{BoxError, Router};
use case::Client;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::GracefulShutdown;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpListener;
use tokio::net::UnixListener;
use tokio::time::Instant;
use tokio_rustls::TlsAcceptor;
use tower::ServiceExt as _;

use crate::client_limit::ClientLimit;
use crate::forwarded::TrustedProxies;
use crate::logs::LogRateLimit;
use crate::timeouts::Timeouts;
use crate::tls::ReloadedTls;
use crate::write_timeout::{AnswerDeadline, WriteTimeout};

/// How long to wait after the system is out of descriptors.
const PAUSE_AFTER_REFUSAL: Duration = Duration::from_millis(100);

/// The bytes after which headers that have not ended are refused.
const MAX_HEADER_BYTES: usize = 64 << 10;

/// Tells browsers to use TLS alone for a year, if they have been answered by TLS.
const TLS_ALONE: HeaderValue = HeaderValue::from_static("max-age=31536000");

#[derive(Debug, Clone)]
pub struct ConnectionLimits {
    /// Connections at a time, of which one address that is not a trusted proxy has at most a quarter. Further ones are closed.
    pub connections: usize,
    /// The proxies that name the client in `X-Forwarded-For`.
    pub trusted_proxies: TrustedProxies,
    /// How long clients may take.
    pub timeouts: Timeouts,
}

/// The address of the client: an extension of every request from a socket.
#[derive(Debug, Clone, Copy)]
pub struct Peer(pub IpAddr);

/// The client of a request, for limits and turns. The guard of routes replaces the address by the name of a token or a person.
pub fn client_of(extensions: &Extensions) -> Client {
    extensions.get::<Client>().copied().unwrap_or_default()
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
        Ok(Self::of(&parts.extensions))
    }
}

impl ByProxy {
    pub fn of(extensions: &Extensions) -> Self {
        extensions.get().copied().unwrap_or(Self(false))
    }
}

/// Serves `app` until `stop` resolves, then finishes running requests within the grace period. With TLS, nothing else is served.
pub async fn serve(
    listener: impl Into<Listener>,
    app: Router,
    limits: ConnectionLimits,
    tls: Option<ReloadedTls>,
    stop: impl Future<Output = ()>,
) {
    let (permits, closed) = (
        ClientLimit::new(limits.connections),
        LogRateLimit::default(),
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
        let by_proxy = limits.trusted_proxies.contains(address);
        let client = match address.filter(|_| !by_proxy) {
            Some(address) => Client::at(address),
            None => Client::Program,
        };
        let Some(permit) = permits.try_acquire(client) else {
            if let Some(count) = closed.count() {
                tracing::warn!(
                    address = address.map(tracing::field::display),
                    count,
                    "connections were closed: there are too many of all, or of this address (`http.max_connections`, `http.trusted_proxies`)"
                );
            }
            continue;
        };
        let deadline = AnswerDeadline::default();
        let stream = WriteTimeout::new(stream, limits.timeouts.idle, deadline.clone());
        let acceptor = tls.as_ref().map(|tls| TlsAcceptor::from(tls.current()));
        let connection = Connection {
            address,
            by_proxy,
            by_tls: acceptor.is_some(),
            deadline,
        };
        let header_timeout = limits.timeouts.header;
        let service = service(app.clone(), connection, limits.clone());
        let watcher = graceful.watcher();
        tokio::spawn(async move {
            let _permit = permit;
            let served = async {
                let stream = secured(stream, acceptor, header_timeout).await?;
                let connection =
                    http1(header_timeout).serve_connection(TokioIo::new(stream), service);
                Ok::<_, BoxError>(watcher.watch(connection).await?)
            };
            // A failure here is on the side of the client: a lost connection, a timeout, a bad request line.
            if let Err(error) = served.await {
                tracing::debug!(%error, "connection ended");
            }
        });
    }
    drop(listener);
    if tokio::time::timeout(limits.timeouts.shutdown_grace, graceful.shutdown())
        .await
        .is_err()
    {
        tracing::warn!("stopped before every request was answered");
    }
}

/// Where connections come from.
#[derive(Debug)]
pub enum Listener {
    Tcp(TcpListener),
    /// A socket in the file system, for a proxy alone.
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
    stream: WriteTimeout<Box<dyn Connected>>,
    acceptor: Option<TlsAcceptor>,
    header_timeout: Duration,
) -> Result<Box<dyn Connected>, BoxError> {
    let Some(acceptor) = acceptor else {
        return Ok(Box::new(stream));
    };
    let accepted = tokio::time::timeout(header_timeout, acceptor.accept(stream)).await;
    Ok(Box::new(accepted??))
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

/// A connection, for the requests that come by it.
#[derive(Debug, Clone)]
struct Connection {
    address: Option<IpAddr>,
    by_proxy: bool,
    by_tls: bool,
    deadline: AnswerDeadline,
}

/// Answers the requests of a connection, which carry the address of their client.
fn service(
    app: Router,
    connection: Connection,
    limits: ConnectionLimits,
) -> impl hyper::service::Service<
    axum::http::Request<Incoming>,
    Response = Response,
    Error = Infallible,
    Future = impl Future<Output = Result<Response, Infallible>> + Send,
> {
    hyper::service::service_fn(move |request: axum::http::Request<Incoming>| {
        let mut request = request.map(Body::new);
        let client = (limits.trusted_proxies).client_of(connection.address, request.headers());
        let extensions = request.extensions_mut();
        extensions.insert(Peer(client));
        extensions.insert(Client::at(client));
        extensions.insert(ByProxy(connection.by_proxy));
        connection.deadline.set(None);
        let (answered, connection) = (app.clone().oneshot(request), connection.clone());
        let whole = limits.timeouts.whole;
        async move {
            let mut response = answered.await?;
            if !is_endless(&response) {
                connection.deadline.set(Some(Instant::now() + whole));
            }
            if connection.by_tls {
                let headers = response.headers_mut();
                headers.insert(header::STRICT_TRANSPORT_SECURITY, TLS_ALONE);
            }
            Ok(response)
        }
    })
}

/// Whether a response goes on until something happens.
pub fn is_endless(response: &Response) -> bool {
    let kind = response.headers().get(header::CONTENT_TYPE);
    kind.is_some_and(|kind| kind.as_bytes().starts_with(b"text/event-stream"))
}
