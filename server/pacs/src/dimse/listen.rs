//! The listener: who may connect, and how many at a time.

use std::sync::Arc;
use std::time::Duration;

use case::Client;
use tokio::net::{TcpListener, TcpStream};
use tokio::task::JoinSet;
use tokio_rustls::TlsAcceptor;
use tracing::Instrument as _;

use crate::dimse::association::{Abort, Caller, associate};
use crate::dimse::counts::Rejection;
use crate::dimse::options::DimseOptions;
use crate::dimse::peers::Peers;
use crate::dimse::wire::{Connection, WireError};
use crate::series::Arrivals;
use http::client_limit::ClientLimit;

/// Connections beyond the associations that there may be, which are told so, if they ask soon.
const REJECTED_AT_A_TIME: usize = 16;

/// Time for the request of an association that is rejected.
const REJECTED_REQUEST_TIMEOUT: Duration = Duration::from_secs(3);

/// How long to wait after the system could not accept a connection.
const PAUSE: Duration = Duration::from_millis(100);

/// Serves associations until `stop` resolves; then running ones may end within `grace`.
pub async fn serve(
    listener: TcpListener,
    arrivals: Arrivals,
    options: DimseOptions,
    stop: impl Future<Output = ()>,
    grace: Duration,
) {
    if options.peers.is_empty() {
        tracing::warn!("nobody may send images by C-STORE: list the peers in `pacs.dimse.peers`");
    }
    let peers = Peers::new(options.peers.clone());
    let options = Arc::new(options);
    let accepting = ClientLimit::new(options.max_associations);
    let rejecting = ClientLimit::new(REJECTED_AT_A_TIME);
    let mut associations = JoinSet::new();
    let mut stop = std::pin::pin!(stop);
    loop {
        let accepted = tokio::select! {
            () = &mut stop => break,
            // A panic is the end of its association alone.
            Some(_ended) = associations.join_next() => continue,
            accepted = listener.accept() => accepted,
        };
        let (stream, address) = match accepted {
            Ok((stream, address)) => (stream, address.ip()),
            Err(error) => {
                tracing::warn!(%error, "cannot accept a connection for DIMSE");
                tokio::time::sleep(PAUSE).await;
                continue;
            }
        };
        let peers = peers.at(address).await;
        if peers.is_empty() {
            let why = Rejection::Address;
            if let Some(count) = options.counts.reject(why) {
                tracing::warn!(%address, reason = why.name(), count, "connections for DIMSE were closed");
            }
            continue;
        }
        let (arrivals, options) = (arrivals.clone(), Arc::clone(&options));
        let client = Client::at(address);
        let accepted = accepting.try_acquire(client);
        let is_beyond_limit = accepted.is_none();
        let Some(permit) = accepted.or_else(|| rejecting.try_acquire(client)) else {
            let why = Rejection::Limit;
            if let Some(count) = options.counts.reject(why) {
                tracing::warn!(%address, reason = why.name(), count, "connections for DIMSE were closed");
            }
            continue;
        };
        let calling = tracing::field::Empty;
        // Its fields stand on warnings, so that it must be there whenever they are.
        let span = tracing::error_span!("association", %address, calling);
        let association = async move {
            let _permit = permit;
            let caller = Caller {
                address,
                peers,
                is_beyond_limit,
                patience: match is_beyond_limit {
                    true => options.idle.min(REJECTED_REQUEST_TIMEOUT),
                    false => options.idle,
                },
            };
            serve_one(stream, &caller, &arrivals, &options).await;
        };
        associations.spawn(association.instrument(span));
    }
    drop(listener);
    let ended = async { while associations.join_next().await.is_some() {} };
    if tokio::time::timeout(grace, ended).await.is_err() {
        tracing::warn!("stopped before every association had ended");
    }
}

/// The connection, by TLS if that is configured. A handshake has the time of the request of an association.
async fn secured(
    stream: TcpStream,
    patience: Duration,
    options: &DimseOptions,
) -> Result<Box<dyn Connection>, WireError> {
    let Some(tls) = &options.tls else {
        return Ok(Box::new(stream));
    };
    let accepting = TlsAcceptor::from(tls.current()).accept(stream);
    let accepted = tokio::time::timeout(patience, accepting).await;
    Ok(Box::new(accepted.map_err(|_elapsed| WireError::Silent)??))
}

async fn serve_one(
    stream: TcpStream,
    caller: &Caller,
    arrivals: &Arrivals,
    options: &DimseOptions,
) {
    if let Err(error) = stream.set_nodelay(true) {
        tracing::debug!(%error, "TCP_NODELAY refused");
    }
    let association = async {
        let stream = secured(stream, caller.patience, options).await?;
        associate(stream, caller, arrivals, options).await
    };
    match tokio::time::timeout(options.whole, association).await {
        Ok(Ok(0)) => tracing::debug!("an association ended"),
        Ok(Ok(images)) => tracing::info!(images, "images were stored by C-STORE"),
        // It has a line of its own.
        Ok(Err(Abort::Rejected)) => {}
        Ok(Err(error)) => tracing::info!(%error, "an association was aborted"),
        Err(_elapsed) => tracing::info!("an association took too long"),
    }
}
