//! `isocortex work`.

use std::net::SocketAddr;
use std::sync::Arc;

use cases::dicom::DicomReader;
use cases::jobs::start_workers;
use clap::Args;
use http::listen;
use pipeline::Limits;

use super::common::{CommonArgs, set_some};
use super::process::{bind, told_to_stop};
use super::serve::tell_confinement;
use super::status::CliError;
use super::waiting;
use crate::config::ConfigError;
use crate::{health, logs, start};

/// Prepare the cases of a store that other processes serve
///
/// Any number of these processes, on any machines, share the work if the store is in PostgreSQL and in a bucket or a
/// shared folder.
#[derive(Debug, Clone, Args)]
pub(super) struct WorkArgs {
    #[command(flatten)]
    common: CommonArgs,
    /// The address on which to answer /healthz, /readyz and /metrics. [default: none]
    #[arg(long, value_name = "ADDR:PORT", env = "ISOCORTEX_WORK_LISTEN")]
    listen: Option<SocketAddr>,
}

/// Prepares cases until the process receives a signal to stop; then finishes running work or puts it back into the
/// queue.
pub(super) fn run(args: &WorkArgs) -> Result<(), CliError> {
    super::keep_files_private();
    let mut config = args.common.config()?;
    config.prepares_apart = true;
    set_some(&mut config.prepare.listen, args.listen.as_ref());
    if config.prepare.workers == 0 {
        let key = "prepare.workers";
        return Err(ConfigError::Zero { key }.into());
    }
    logs::start(config.log_format, &config.log);
    for warning in super::unknown_variables(super::variables()) {
        tracing::warn!("{warning}");
    }
    config.keep_secrets();
    super::block_on(async {
        let audit = config.audit()?;
        let opening = || start::open_library(&config, &audit);
        let Some(library) = waiting::opened(&config, config.prepare.listen, None, opening).await?
        else {
            return Ok(());
        };
        let workers = start_workers(library.clone(), config.prepare.workers);
        tracing::info!("preparing cases");
        let program = config.dicom_program.clone();
        let reader = DicomReader::new(program, Limits::default(), config.limits.max_upload_bytes);
        tokio::spawn(tell_confinement(Arc::new(reader), "prepares heads"));
        let stop = told_to_stop();
        match config.prepare.listen {
            None => stop.await,
            Some(listen) => {
                let (listener, address) = bind(listen).await?;
                tracing::info!(%address, "answering health checks");
                let routes = health::routes(library.store().clone());
                listen::serve(listener, routes, config.connection_limits(), None, stop).await;
            }
        }
        tracing::info!("stopping");
        let grace = config.http.timeouts.shutdown_grace;
        workers.shut_down(grace).await;
        library.store().close().await;
        audit.shut_down();
        tracing::info!("stopped");
        Ok(())
    })
}
