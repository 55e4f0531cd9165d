use std::io::IsTerminal as _;
use std::sync::atomic::{AtomicBool, Ordering};

use tracing_subscriber::filter::Targets;
use tracing_subscriber::fmt;
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;

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

/// What is written of the database and the bucket, unless the filter names them: each statement would be a line at `debug`, and each of two
/// attempts a second to reach a bucket one at `info`, beside the one line with the cause.
const QUIET: &str = "sqlx=warn,object_store=warn";

/// Whether lines are JSON from now on.
static IS_JSON: AtomicBool = AtomicBool::new(false);

/// Whether every line on standard error must be JSON.
pub fn are_json() -> bool {
    IS_JSON.load(Ordering::Relaxed)
}

/// Writes log lines to standard error from now on. `filter` is a level, such as `info`, and levels of targets, such as
/// `info,cases=debug`.
///
/// A second call changes nothing.
pub fn start(format: LogFormat, filter: &str) {
    let filtered = tracing_subscriber::registry().with(targets(filter));
    let lines = fmt::layer()
        .with_ansi(std::io::stderr().is_terminal())
        .with_writer(std::io::stderr);
    // Fails only if a subscriber was set before, as in tests.
    let _ = match format {
        LogFormat::Text => filtered.with(lines).try_init(),
        LogFormat::Json => {
            IS_JSON.store(true, Ordering::Relaxed);
            std::panic::set_hook(Box::new(|panic| tracing::error!(%panic, "a panic")));
            filtered.with(lines.json().flatten_event(true)).try_init()
        }
    };
}

/// The levels of a filter; `info` if it cannot be read.
fn targets(filter: &str) -> Targets {
    let read = |filter: &str| format!("{QUIET},{filter}").parse();
    read(filter).or_else(|_| read("info")).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use tracing::Level;

    use super::*;

    #[test]
    fn a_filter_names_a_level_and_levels_of_targets() {
        let filter = targets("info,cases=debug");
        assert!(filter.would_enable("cases::jobs", &Level::DEBUG));
        assert!(filter.would_enable("pacs", &Level::INFO));
        assert!(!filter.would_enable("pacs", &Level::DEBUG));
        let unreadable = targets("cases=loud");
        assert!(unreadable.would_enable("cases", &Level::INFO));
        assert!(!unreadable.would_enable("cases", &Level::DEBUG));
    }

    #[test]
    fn statements_of_the_database_are_lines_only_if_the_filter_names_them() {
        let statements = |filter| targets(filter).would_enable("sqlx::query", &Level::DEBUG);
        assert!(!statements("debug"));
        assert!(statements("debug,sqlx=debug"));
        assert!(statements("sqlx::query=debug"));
    }

    #[test]
    fn attempts_to_reach_a_bucket_are_lines_only_if_the_filter_names_them() {
        let attempts =
            |filter, level| targets(filter).would_enable("object_store::client::retry", &level);
        assert!(!attempts("info", Level::INFO));
        assert!(!attempts("debug", Level::INFO));
        assert!(attempts("info", Level::WARN));
        assert!(attempts("info,object_store=info", Level::INFO));
    }
}
