//! Writes log lines.

use std::io::IsTerminal as _;
use std::sync::atomic::{AtomicBool, Ordering};

use tracing_subscriber::EnvFilter;

/// The format of log lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LogFormat {
    /// For people.
    #[default]
    Text,
    /// One JSON object per line.
    Json,
}

/// What is written of the statements of the database, unless the filter names them: each would be a line at `debug`.
const STATEMENTS: &str = "sqlx=warn";

/// Whether lines are JSON from now on.
static IS_JSON: AtomicBool = AtomicBool::new(false);

/// Whether every line on standard error must be JSON.
pub fn are_json() -> bool {
    IS_JSON.load(Ordering::Relaxed)
}

/// Writes log lines to standard error from now on. `filter` is in the syntax of `RUST_LOG`, such as `info`.
///
/// A second call changes nothing.
pub fn start(format: LogFormat, filter: &str) {
    let filter = EnvFilter::try_new(format!("{STATEMENTS},{filter}"))
        .unwrap_or_else(|_| EnvFilter::new(format!("{STATEMENTS},info")));
    let lines = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_ansi(std::io::stderr().is_terminal())
        .with_writer(std::io::stderr);
    // Fails only if a subscriber was set before, as in tests.
    let _ = match format {
        LogFormat::Text => lines.try_init(),
        LogFormat::Json => {
            IS_JSON.store(true, Ordering::Relaxed);
            std::panic::set_hook(Box::new(|panic| tracing::error!(%panic, "a panic")));
            lines.json().flatten_event(true).try_init()
        }
    };
}
