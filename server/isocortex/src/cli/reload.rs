//! What a running server reads again, at SIGHUP and when its files change: tokens and certificates.

use std::path::PathBuf;
use std::time::{Duration, SystemTime};

use access::auth::Access;
use http::tls::{ListeningTls, ReloadedTls};
use tokio::signal::unix::Signal;

use super::status::{CliError, ExitStatus};
use crate::config::{Config, ConfigError};

/// How often the files are looked at.
const LOOK_EVERY: Duration = Duration::from_secs(2);

#[derive(Debug)]
pub(super) struct Reload {
    /// SIGHUP, from before the server said that it listens.
    pub(super) hangups: Signal,
    pub(super) access: Access,
    /// Of HTTP.
    pub(super) tls: Option<ReloadedTls>,
    /// Of C-STORE.
    pub(super) dimse_tls: Option<ReloadedTls>,
    /// As it was at the start, or at the last signal.
    pub(super) config: Config,
    pub(super) watched: Watched,
}

/// The files that are looked at.
#[derive(Debug)]
pub(super) struct Watched {
    /// Their states before they were last read: whatever changes afterwards is seen.
    read: Vec<Option<FileState>>,
    /// Their states at the last look.
    last: Vec<Option<FileState>>,
}

/// What tells one state of a file from another: its length, the time of its last change and its number.
type FileState = (u64, SystemTime, u64);

impl Watched {
    pub(super) fn new(config: &Config) -> Self {
        let read = look(config);
        Self {
            last: read.clone(),
            read,
        }
    }

    /// Whether the files have changed since they were read. Whatever replaces a file may take it away for a moment, and write the next
    /// one later: a change counts when they are the same at two looks.
    fn have_changed(&mut self, config: &Config) -> bool {
        let now = look(config);
        let have_changed = now == self.last && now != self.read;
        if have_changed {
            self.read.clone_from(&now);
        }
        self.last = now;
        have_changed
    }
}

impl Reload {
    /// Reads the files when they change, and the configuration too at each signal. What cannot be used by then stays as it was.
    pub(super) async fn at_each_signal(mut self, config: impl Fn() -> Result<Config, CliError>) {
        let mut looks = tokio::time::interval(LOOK_EVERY);
        loop {
            tokio::select! {
                signal = self.hangups.recv() => {
                    if signal.is_none() {
                        return;
                    }
                    match config() {
                        Ok(config) => self.config = config,
                        Err(error) => tracing::error!(
                            error = error.message,
                            "the configuration stays as it was"
                        ),
                    }
                    self.read();
                }
                _ = looks.tick() => {
                    if self.watched.have_changed(&self.config) {
                        self.read();
                    }
                }
            }
        }
    }

    /// Reads all again, and says in the log what came of each: a certificate that cannot be used keeps no withdrawn token alive.
    fn read(&self) {
        // Whatever has replaced a file may have opened it to others.
        self.config.keep_secrets();
        tell("the tokens", self.read_tokens());
        if let Some(tls) = &self.tls {
            let read = replace(tls, self.config.tls());
            tell("the certificates of HTTP", read);
        }
        if let Some(tls) = &self.dimse_tls {
            let read = self.config.pacs.dimse.tls();
            let read = replace(tls, read.map_err(ConfigError::from));
            tell("the certificates of C-STORE", read);
        }
    }

    fn read_tokens(&self) -> Result<(), CliError> {
        let access = self.config.access()?;
        if let Some(warning) = self.config.warn_of_no_tokens()? {
            // An editor may have emptied the file before it writes it.
            return Err(CliError::new(ExitStatus::Config, warning));
        }
        self.access.replace_tokens(&access);
        Ok(())
    }
}

fn tell(what: &str, read: Result<(), CliError>) {
    match read {
        Ok(()) => tracing::info!("{what} were read again"),
        Err(error) => tracing::error!(error = error.message, "{what} stay as they were"),
    }
}

/// Uses another certificate, if there is one.
fn replace(
    current: &ReloadedTls,
    read: Result<Option<ListeningTls>, ConfigError>,
) -> Result<(), CliError> {
    if let Some(tls) = read? {
        current.replace(tls);
    }
    Ok(())
}

/// The state of each file that is looked at; `None` if there is no such file. The token without a name is read at SIGHUP alone.
fn look(config: &Config) -> Vec<Option<FileState>> {
    use std::os::unix::fs::MetadataExt as _;
    let (http, dimse) = (&config.http, &config.pacs.dimse);
    let files = [
        &http.tokens_file,
        &http.tls_certificate,
        &http.tls_key,
        &dimse.tls_certificate,
        &dimse.tls_key,
        &dimse.tls_authority,
    ];
    let look = |file: &PathBuf| {
        let metadata = std::fs::metadata(file).ok()?;
        Some((metadata.len(), metadata.modified().ok()?, metadata.ino()))
    };
    files.into_iter().flatten().map(look).collect()
}
