//! `isocortex serve`.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use clap::Args;
use tokio::signal::unix::{SignalKind, signal};

use super::choices;
use super::common::{CommonArgs, set, set_some};
use super::process::{bind, told_to_stop};
use super::reload::{Reload, Watched};
use super::status::{CliError, ExitStatus};
use super::waiting;
use crate::config::{Config, ConfigError, Network};
use crate::{figures, logs, start};
use cases::dicom::DicomReader;
use cases::jobs::start_workers;
use cases::runner::Runner;
use cases::settings::GpuUse;
use http::listen;
use pacs::dimse::{self, ReloadedTls};
use pacs::{start_series_reader, start_transfers};
use service::state::AppState;

/// Serve the cases of a store over HTTP
///
/// The command line takes precedence over the environment, and the environment over the file. Without a bearer token
/// (--tokens-file or --token-file), the server listens on this machine only and refuses any other address.
#[derive(Debug, Clone, Default, Args)]
pub(super) struct ServeArgs {
    #[command(flatten)]
    pub(super) common: CommonArgs,
    /// The address to listen on. [default: 127.0.0.1:8640]
    #[arg(long, value_name = "ADDR:PORT", env = "ISOCORTEX_LISTEN")]
    pub(super) listen: Option<SocketAddr>,
    /// A file with the bearer token.
    #[arg(long, value_name = "FILE", env = "ISOCORTEX_TOKEN_FILE")]
    pub(super) token_file: Option<PathBuf>,
    /// A file with named tokens and their scopes, which `isocortex token new` writes.
    #[arg(long, value_name = "FILE", env = "ISOCORTEX_TOKENS_FILE")]
    pub(super) tokens_file: Option<PathBuf>,
    /// A file with the certificate of the server in PEM, and those that issued it. It then speaks TLS alone.
    #[arg(
        long,
        value_name = "FILE",
        env = "ISOCORTEX_TLS_CERT",
        requires = "tls_key"
    )]
    pub(super) tls_cert: Option<PathBuf>,
    /// A file with the key of the certificate in PEM.
    #[arg(
        long,
        value_name = "FILE",
        env = "ISOCORTEX_TLS_KEY",
        requires = "tls_cert"
    )]
    pub(super) tls_key: Option<PathBuf>,
    /// The proxies that name the client in `X-Forwarded-For`: addresses or networks such as 10.0.0.0/8.
    #[arg(
        long,
        value_name = "NETWORK,…",
        value_delimiter = ',',
        env = "ISOCORTEX_TRUSTED_PROXIES"
    )]
    pub(super) trusted_proxies: Option<Vec<Network>>,
    /// Whether a GPU may draw. [default: auto]
    #[arg(long, value_parser = choices::gpu_use(), env = "ISOCORTEX_GPU")]
    pub(super) gpu: Option<GpuUse>,
}

impl ServeArgs {
    /// The configuration from file, environment and command line.
    pub(super) fn config(&self) -> Result<Config, CliError> {
        let mut config = self.common.config()?;
        set(&mut config.http.listen, self.listen.as_ref());
        set(
            &mut config.http.trusted_proxies,
            self.trusted_proxies.as_ref(),
        );
        set(&mut config.render.gpu, self.gpu.as_ref());
        if std::env::var_os("ISOCORTEX_TOKEN").is_some_and(|token| !token.is_empty()) {
            return Err(ConfigError::TokenInVariable.into());
        }
        if let Some(path) = &self.token_file {
            config.http.token = None;
            config.http.token_file = Some(path.clone());
        }
        set_some(&mut config.http.tokens_file, self.tokens_file.as_ref());
        set_some(&mut config.http.tls_certificate, self.tls_cert.as_ref());
        set_some(&mut config.http.tls_key, self.tls_key.as_ref());
        Ok(config)
    }
}

/// Serves until the process receives a signal to stop.
pub(super) fn run(args: &ServeArgs) -> Result<(), CliError> {
    super::keep_files_private();
    let config = Config {
        prepares_apart: true,
        ..args.config()?
    };
    logs::start(config.log_format, &config.log);
    for warning in super::unknown_variables(super::variables()) {
        tracing::warn!("{warning}");
    }
    super::block_on(async {
        let Some((server, reload)) = Server::start(&config).await? else {
            return Ok(());
        };
        // Of JSON, the log has the same line.
        if !logs::are_json() {
            println!(
                "Isocortex listens on {}://{}",
                config.scheme(),
                server.address
            );
        }
        let args = args.clone();
        let reloading = tokio::spawn(reload.at_each_signal(move || args.config()));
        server.until_stopped().await;
        reloading.abort();
        Ok(())
    })
}

/// A running server.
pub(super) struct Server {
    pub(super) state: AppState,
    pub(super) address: SocketAddr,
    workers: Runner,
    arrivals: Runner,
    transfers: Runner,
    serving: tokio::task::JoinHandle<()>,
    /// The listener for C-STORE, if there is one.
    dimse: Option<tokio::task::JoinHandle<()>>,
    grace: Duration,
}

impl Server {
    /// Opens the store, binds the address, and starts workers and the server; `None` if the process is told to stop while it waits for the store.
    pub(super) async fn start(config: &Config) -> Result<Option<(Self, Reload)>, CliError> {
        let watched = Watched::new(config);
        let hangups = signal(SignalKind::hangup())
            .map_err(|error| CliError::new(ExitStatus::Internal, error))?;
        config.keep_secrets();
        let tls = config.tls()?.map(ReloadedTls::new);
        let address = Some(config.http.listen);
        let audit = config.audit()?;
        let opening = || start::open(config, &audit);
        let Some(state) = waiting::opened(config, address, tls.clone(), opening).await? else {
            return Ok(None);
        };
        let pacs = start::pacs(config, &state)?;
        let (listener, address) = bind(config.http.listen).await?;
        let workers = start_workers(state.cases.library.clone(), config.prepare.workers);
        let limits = config.connection_limits();
        let grace = limits.timeouts.shutdown_grace;
        figures::add_store(state.metrics(), state.cases.store());
        figures::add_pacs(state.metrics(), &pacs);
        figures::add_audit(state.metrics(), state.audit());
        figures::add_end_of_tokens(state.metrics(), state.access());
        let mut reload = Reload {
            hangups,
            access: state.access().clone(),
            tls: tls.clone(),
            dimse_tls: None,
            config: config.clone(),
            watched,
        };
        let dimse = match config.pacs.dimse()? {
            Some((listen, mut options)) => {
                let (listener, address) = bind(listen).await?;
                tracing::info!(%address, "listening for C-STORE");
                options.audit = state.audit().clone();
                figures::add_associations(state.metrics(), &options.counts);
                reload.dimse_tls.clone_from(&options.tls);
                let stop = state.stopping().begun();
                let serving = dimse::serve(listener, pacs.arrivals().clone(), options, stop, grace);
                Some(tokio::spawn(serving))
            }
            None => None,
        };
        let stop = stop_of(state.clone());
        let router = start::router(&state, &pacs);
        let socket = config.proxy.as_ref().and_then(|it| it.socket.as_ref());
        let by_socket = match socket {
            Some(path) => {
                let (listener, file) = bind_socket(path)?;
                let stop = state.stopping().begun();
                let serving = listen::serve(listener, router.clone(), limits.clone(), None, stop);
                Some(tokio::spawn(async move {
                    serving.await;
                    drop(file);
                }))
            }
            None => None,
        };
        let by_network = listen::serve(listener, router, limits, tls, stop);
        let serving = tokio::spawn(async move {
            by_network.await;
            if let Some(serving) = by_socket
                && let Err(error) = serving.await
            {
                tracing::error!(%error, "the listener for the proxy failed");
            }
        });
        tracing::info!(%address, "listening");
        let reader = Arc::clone(&state.cases.dicom);
        tokio::spawn(tell_confinement(reader, "reads DICOM files"));
        let server = Self {
            arrivals: start_series_reader(pacs.arrivals().clone(), config.pacs.arrivals()),
            transfers: start_transfers(pacs),
            state,
            address,
            workers,
            serving,
            dimse,
            grace,
        };
        Ok(Some((server, reload)))
    }

    /// Runs until the process receives a signal to stop; then finishes running requests and work within one grace, or puts work back
    /// into the queue.
    pub(super) async fn until_stopped(self) {
        let begun = self.state.stopping().begun();
        let mut listeners = pin!(async {
            if let Err(error) = self.serving.await {
                tracing::error!(%error, "the listener failed");
            }
            if let Some(dimse) = self.dimse
                && let Err(error) = dimse.await
            {
                tracing::error!(%error, "the listener for C-STORE failed");
            }
        });
        // A listener that fails ends the process, too.
        let has_ended = tokio::select! {
            () = &mut listeners => true,
            () = begun => false,
        };
        let listeners = async {
            if !has_ended {
                listeners.await;
            }
        };
        tokio::join!(
            listeners,
            self.transfers.shut_down(self.grace),
            self.arrivals.shut_down(self.grace),
            self.workers.shut_down(self.grace),
        );
        self.state.cases.store().close().await;
        self.state.audit().shut_down();
        tracing::info!("stopped");
    }
}

/// Says how far the process that does something with the files of strangers is confined. It depends on the kernel.
pub(super) async fn tell_confinement(reader: Arc<DicomReader>, does: &'static str) {
    // If the process cannot be started, the log has said so.
    let Ok(given) = reader.confinement().await else {
        return;
    };
    match given.is_whole() {
        true => tracing::info!("the process that {does} has {given}"),
        false => tracing::warn!(
            "the process that {does} has {given}; code in a damaged file could read what this program may read"
        ),
    }
}

/// A socket in the file system, which is removed with this.
struct SocketFile(PathBuf);

impl Drop for SocketFile {
    fn drop(&mut self) {
        // Somebody may have removed it.
        let _ = std::fs::remove_file(&self.0);
    }
}

/// A listener on a socket in the file system, which its owner and its group may open.
fn bind_socket(path: &Path) -> Result<(listen::Listener, SocketFile), CliError> {
    use std::os::unix::fs::{FileTypeExt as _, PermissionsExt as _};
    let failed = |error| {
        let path = path.display();
        let message = format!("cannot listen on the socket {path} (`proxy.socket`): {error}");
        CliError::new(ExitStatus::Unavailable, message)
    };
    let is_socket = std::fs::symlink_metadata(path).is_ok_and(|it| it.file_type().is_socket());
    // A server that was killed leaves one behind, on which nobody listens.
    if is_socket && std::os::unix::net::UnixStream::connect(path).is_err() {
        std::fs::remove_file(path).map_err(failed)?;
    }
    let listener = tokio::net::UnixListener::bind(path).map_err(failed)?;
    let file = SocketFile(path.to_owned());
    let for_group = std::fs::Permissions::from_mode(0o660);
    std::fs::set_permissions(path, for_group).map_err(failed)?;
    tracing::info!("listening for the proxy on its socket");
    Ok((listen::Listener::Unix(listener), file))
}

/// Resolves at Ctrl-C or SIGTERM, after ending endless answers.
fn stop_of(state: AppState) -> impl Future<Output = ()> {
    let told = told_to_stop();
    async move {
        told.await;
        tracing::info!("stopping");
        state.stopping().begin();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::common::StoreArgs;

    #[test]
    fn the_command_line_goes_before_the_file() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("isocortex.toml");
        std::fs::write(&path, "log = \"debug\"\n[storage]\ndata = \"from-file\"\n").unwrap();
        let store = StoreArgs {
            data: Some("from-flag".into()),
            config: Some(path),
            ..StoreArgs::default()
        };
        let common = CommonArgs {
            store,
            ..CommonArgs::default()
        };
        let args = ServeArgs {
            common,
            ..ServeArgs::default()
        };
        let config = args.config().unwrap();
        assert_eq!(config.storage.data, PathBuf::from("from-flag"));
        assert_eq!(config.log, "debug");
    }
}
