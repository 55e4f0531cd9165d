//! Writes log lines.

use std::io::IsTerminal as _;

use tracing_subscriber::filter::{LevelFilter, Targets};
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

/// Writes log lines to standard error from now on. `filter` is a level, such as `info`, and levels of targets, such as
/// `info,isocortex_cases=debug`.
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
        LogFormat::Json => filtered.with(lines.json().flatten_event(true)).try_init(),
    };
}

/// The levels of a filter; `info` if it cannot be read.
fn targets(filter: &str) -> Targets {
    let info = || Targets::new().with_default(LevelFilter::INFO);
    filter.parse().unwrap_or_else(|_| info())
}

#[cfg(test)]
mod tests {
    use tracing::Level;

    use super::*;

    #[test]
    fn a_filter_names_a_level_and_levels_of_targets() {
        let filter = targets("warn,isocortex_cases=debug");
        assert!(filter.would_enable("isocortex_cases::jobs", &Level::DEBUG));
        assert!(filter.would_enable("sqlx", &Level::WARN));
        assert!(!filter.would_enable("sqlx", &Level::INFO));
        let unreadable = targets("sqlx=loud");
        assert!(unreadable.would_enable("sqlx", &Level::INFO));
        assert!(!unreadable.would_enable("sqlx", &Level::DEBUG));
    }
}
