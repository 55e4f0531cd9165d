//! `isocortex work`.

use std::time::Duration;

use cases::jobs::Workers;
use clap::Args;

use super::common::CommonArgs;
use super::serve::told_to_stop;
use super::status::CliError;
use crate::config::ConfigError;
use crate::{logs, start};

/// Prepare the cases of a store that other processes serve
///
/// Any number of these processes, on any machines, share the work if the store is in PostgreSQL and in a bucket or a
/// shared folder.
#[derive(Debug, Clone, Args)]
pub(super) struct WorkArgs {
    #[command(flatten)]
    common: CommonArgs,
}

/// Prepares cases until the process receives a signal to stop; then finishes running work or puts it back into the
/// queue.
pub(super) fn run(args: &WorkArgs) -> Result<(), CliError> {
    super::keep_files_private();
    let config = args.common.config()?;
    if config.prepare.workers == 0 {
        let key = "prepare.workers";
        return Err(ConfigError::Zero { key }.into());
    }
    logs::start(config.log_format, &config.log);
    super::block_on(async {
        let library = start::open_library(&config).await?;
        let workers = Workers::start(library.clone(), config.prepare.workers);
        tracing::info!("preparing cases");
        told_to_stop().await;
        tracing::info!("stopping");
        let grace = Duration::from_secs(config.http.shutdown_grace_secs);
        workers.shut_down(grace).await;
        library.store().close().await;
        tracing::info!("stopped");
        Ok(())
    })
}
