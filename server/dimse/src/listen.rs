//! The listener: who may connect, and how many at a time.

use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;

use cases::Cases;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;
use tokio::task::JoinSet;
use tokio_rustls::TlsAcceptor;

use crate::association::{Abort, associate, reject_for_now};
use crate::options::DimseOptions;
use crate::wire::{Connection, WireError};

/// As many connections beyond the limit of associations are told so at a time; more are closed.
const MAX_REFUSALS: usize = 16;
/// The longest time to tell one of them.
const LONGEST_REFUSAL: Duration = Duration::from_secs(2);

/// How long to wait after the system could not accept a connection.
const PAUSE: Duration = Duration::from_millis(100);

/// Serves associations until `stop` resolves; then running ones may end within `grace`.
pub async fn serve(
    listener: TcpListener,
    cases: Cases,
    options: DimseOptions,
    stop: impl Future<Output = ()>,
    grace: Duration,
) {
    let options = Arc::new(options);
    let room = Arc::new(Semaphore::new(options.max_associations));
    let door = Arc::new(Semaphore::new(MAX_REFUSALS));
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
        if !options.knows(address, None) {
            tracing::warn!("a connection for DIMSE from an address that is not listed was closed");
            continue;
        }
        let (cases, options) = (cases.clone(), Arc::clone(&options));
        let Ok(place) = Arc::clone(&room).try_acquire_owned() else {
            tracing::warn!("too many associations: a request was rejected");
            if let Ok(turn) = Arc::clone(&door).try_acquire_owned() {
                associations.spawn(async move {
                    let rejection = refuse_one(stream, &options);
                    let _ = tokio::time::timeout(LONGEST_REFUSAL, rejection).await;
                    drop(turn);
                });
            }
            continue;
        };
        associations.spawn(async move {
            serve_one(stream, address, &cases, &options).await;
            drop(place);
        });
    }
    drop(listener);
    let ended = async { while associations.join_next().await.is_some() {} };
    if tokio::time::timeout(grace, ended).await.is_err() {
        tracing::warn!("stopped before every association had ended");
    }
}

/// The connection, by TLS if that is configured.
async fn secured(
    stream: TcpStream,
    options: &DimseOptions,
) -> Result<Box<dyn Connection>, WireError> {
    let Some(tls) = &options.tls else {
        return Ok(Box::new(stream));
    };
    let accepting = TlsAcceptor::from(Arc::clone(tls)).accept(stream);
    let accepted = tokio::time::timeout(options.idle, accepting).await;
    Ok(Box::new(accepted.map_err(|_elapsed| WireError::Silent)??))
}

async fn refuse_one(stream: TcpStream, options: &DimseOptions) -> Result<(), Abort> {
    let stream = secured(stream, options).await?;
    reject_for_now(stream, options).await
}

async fn serve_one(stream: TcpStream, address: IpAddr, cases: &Cases, options: &DimseOptions) {
    if let Err(error) = stream.set_nodelay(true) {
        tracing::debug!(%error, "TCP_NODELAY refused");
    }
    let association = async {
        let stream = secured(stream, options).await?;
        associate(stream, address, cases, options).await
    };
    match tokio::time::timeout(options.whole, association).await {
        Ok(Ok(images)) => tracing::debug!(images, "an association ended"),
        Ok(Err(error)) => tracing::info!(%error, "an association was aborted"),
        Err(_elapsed) => tracing::info!("an association took too long"),
    }
}
