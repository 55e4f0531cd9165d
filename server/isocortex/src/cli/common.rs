//! Options of several commands.

use std::path::PathBuf;

use clap::Args;
use pipeline::atlas::AtlasChoice;

use super::choices;
use super::status::CliError;
use crate::config::{Config, Secret};
use crate::logs::{self, LogFormat};

/// The location of the store.
#[derive(Debug, Clone, Default, Args)]
pub(super) struct StoreArgs {
    /// The directory of the store. [default: isocortex-data]
    #[arg(long, value_name = "DIR", env = "ISOCORTEX_DATA")]
    pub(super) data: Option<PathBuf>,
    /// The database, unless it is in the directory: postgres://[user@]host/name or sqlite:///file.
    #[arg(
        long,
        value_name = "URL",
        env = "ISOCORTEX_DATABASE",
        hide_env_values = true
    )]
    pub(super) database: Option<String>,
    /// A file with the password for PostgreSQL. [otherwise: ~/.pgpass]
    #[arg(long, value_name = "FILE", env = "ISOCORTEX_DATABASE_PASSWORD_FILE")]
    pub(super) database_password_file: Option<PathBuf>,
    /// The objects, unless they are in the directory: s3://bucket[/prefix], with the settings of the AWS_ variables, or
    /// file:///folder.
    #[arg(long, value_name = "URL", env = "ISOCORTEX_OBJECTS")]
    pub(super) objects: Option<String>,
    /// A TOML file with these and all other settings.
    #[arg(long, value_name = "FILE", env = "ISOCORTEX_CONFIG")]
    pub(super) config: Option<PathBuf>,
}

impl StoreArgs {
    /// The configuration from file, environment and command line.
    pub(super) fn config(&self) -> Result<Config, CliError> {
        let mut config = match &self.config {
            Some(path) => Config::read(path)?,
            None => Config::default(),
        };
        let storage = &mut config.storage;
        set(&mut storage.data, self.data.as_ref());
        let database = self.database.clone().map(Secret);
        set_some(&mut storage.database, database.as_ref());
        let password_file = &mut storage.database_password_file;
        set_some(password_file, self.database_password_file.as_ref());
        set_some(&mut storage.objects, self.objects.as_ref());
        Ok(config)
    }
}

/// The common options of `serve` and `work`.
#[derive(Debug, Clone, Default, Args)]
pub(super) struct CommonArgs {
    #[command(flatten)]
    pub(super) store: StoreArgs,
    /// Make a new store if there is none. [default: that is an error; `isocortex init-store` makes one]
    #[arg(long, env = "ISOCORTEX_CREATE")]
    pub(super) create: bool,
    /// The age in days at which ready and failed cases are removed, unless they are kept. [default: none is removed]
    #[arg(long, value_name = "DAYS", env = "ISOCORTEX_KEEP_DAYS")]
    pub(super) keep_days: Option<u64>,
    /// The number of cases to prepare at a time. [default: 1]
    #[arg(long, value_name = "N", env = "ISOCORTEX_WORKERS")]
    pub(super) workers: Option<usize>,
    /// The file with the weights for brain extraction. [default: deepbet-1.0.2-py3-none-any.whl beside the program]
    #[arg(long, value_name = "FILE", env = "ISOCORTEX_NETWORK")]
    pub(super) network: Option<PathBuf>,
    /// The atlas that names gyri: a folder with aal.nii.gz, aal.nii.txt and ch2.nii.gz, or a file with labels that has the others
    /// beside it, or none. [default: that of Debian's package mricron-data, if it is installed]
    #[arg(long, value_name = "DIR|FILE|none", env = "ISOCORTEX_ATLAS")]
    pub(super) atlas: Option<String>,
    /// The folder of the audit record, which must exist. [default: nothing is recorded]
    #[arg(long, value_name = "FOLDER", env = "ISOCORTEX_AUDIT")]
    pub(super) audit: Option<PathBuf>,
    /// The format of log lines. [default: text]
    #[arg(long, value_parser = choices::log_format(), env = "ISOCORTEX_LOG_FORMAT")]
    pub(super) log_format: Option<LogFormat>,
    /// The log lines to write: error, warn, info, debug (with a line for each request), also by target: info,cases=debug.
    #[arg(long, value_name = "FILTER", env = "ISOCORTEX_LOG")]
    pub(super) log: Option<String>,
}

impl CommonArgs {
    /// The configuration from file, environment and command line.
    pub(super) fn config(&self) -> Result<Config, CliError> {
        let mut config = self.store.config().inspect_err(|_| {
            if let Some(format) = self.log_format {
                // The error is a line of the log, too.
                logs::start(format, "info");
            }
        })?;
        config.storage.create |= self.create;
        set_some(&mut config.storage.keep_days, self.keep_days.as_ref());
        set(&mut config.prepare.workers, self.workers.as_ref());
        set_some(&mut config.prepare.network, self.network.as_ref());
        let atlas = self.atlas.clone().map(AtlasChoice::from);
        set(&mut config.prepare.atlas, atlas.as_ref());
        set_some(&mut config.audit.folder, self.audit.as_ref());
        set(&mut config.log_format, self.log_format.as_ref());
        set(&mut config.log, self.log.as_ref());
        Ok(config)
    }
}

/// Sets a setting if the command line has it.
pub(super) fn set<T: Clone>(slot: &mut T, value: Option<&T>) {
    if let Some(value) = value {
        slot.clone_from(value);
    }
}

/// Sets an optional setting if the command line has it.
pub(super) fn set_some<T: Clone>(slot: &mut Option<T>, value: Option<&T>) {
    if value.is_some() {
        *slot = value.cloned();
    }
}
