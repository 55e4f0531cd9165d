//! What a long-running process opens first, and when it ends.

use std::net::SocketAddr;

use tokio::net::TcpListener;

use super::status::{CliError, ExitStatus};

/// A listener, and its address.
pub(super) async fn bind(listen: SocketAddr) -> Result<(TcpListener, SocketAddr), CliError> {
    let taken = |error| {
        let message = format!(
            "cannot listen on {listen}: {error}; end what listens there, or choose another address (`--listen`, `http.listen`)"
        );
        CliError::new(ExitStatus::Unavailable, message)
    };
    let listener = TcpListener::bind(listen).await.map_err(taken)?;
    let address = listener.local_addr().map_err(taken)?;
    Ok((listener, address))
}

/// Resolves when a signal tells the process to stop. It listens from the call on, so that a signal that comes
/// immediately after the address is printed is not lost.
pub(super) fn told_to_stop() -> impl Future<Output = ()> {
    use tokio::signal::unix::{SignalKind, signal};
    let signals = [SignalKind::terminate(), SignalKind::interrupt()].map(|kind| signal(kind).ok());
    // SIGHUP asks a program to read its configuration again; it must not end one that reads nothing.
    let hangups = signal(SignalKind::hangup());
    async move {
        let _hangups = hangups;
        let [terminated, interrupted] = signals.map(|listener| async move {
            match listener {
                Some(mut signal) => _ = signal.recv().await,
                None => std::future::pending().await,
            }
        });
        tokio::select! {
            () = terminated => {}
            () = interrupted => {}
        }
    }
}
