//! Old keys of the configuration file, which had no sections. They are accepted with a warning.

use std::fmt;

use toml::{Table, Value};

/// The new section and key of each old key.
const RENAMED: [(&str, &str, &str); 22] = [
    ("listen", "http", "listen"),
    ("token", "http", "token"),
    ("token_file", "http", "token_file"),
    ("max_connections", "http", "max_connections"),
    ("header_timeout_secs", "http", "header_timeout_secs"),
    ("answer_timeout_secs", "http", "answer_timeout_secs"),
    ("upload_idle_secs", "http", "upload_idle_secs"),
    ("upload_timeout_secs", "http", "upload_timeout_secs"),
    ("shutdown_grace_secs", "http", "shutdown_grace_secs"),
    ("body_cache_bytes", "http", "body_cache_bytes"),
    ("max_upload_bytes", "limits", "max_upload_bytes"),
    ("max_voxels", "limits", "max_voxels"),
    ("max_queued_cases", "limits", "max_queued_cases"),
    ("max_queued_renders", "limits", "max_queued_renders"),
    ("prepare_workers", "prepare", "workers"),
    ("network", "prepare", "network"),
    ("render_threads", "render", "threads"),
    ("gpu", "render", "gpu"),
    ("gpu_case_bytes", "render", "gpu_case_bytes"),
    ("model_cache_bytes", "render", "model_cache_bytes"),
    ("data", "storage", "data"),
    ("min_free_bytes", "storage", "min_free_bytes"),
];

/// An old key that was accepted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RenamedKey {
    before: &'static str,
    section: &'static str,
    key: &'static str,
}

impl fmt::Display for RenamedKey {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            before,
            section,
            key,
        } = self;
        write!(
            formatter,
            "the configuration has `{before}` at its top: write `{key}` in the section [{section}] instead"
        )
    }
}

/// A key with both its names.
pub(super) struct Twice(pub(super) RenamedKey);

/// Moves old keys into their sections, and returns them.
pub(super) fn move_into_sections(table: &mut Table) -> Result<Vec<RenamedKey>, Twice> {
    let mut moved = Vec::new();
    for (before, section, key) in RENAMED {
        let Some(value) = table.remove(before) else {
            continue;
        };
        let renamed = RenamedKey {
            before,
            section,
            key,
        };
        let section = table
            .entry(section)
            .or_insert_with(|| Value::Table(Table::new()));
        // A section that is not a table is rejected when the sections are read.
        if let Value::Table(section) = section
            && section.insert(key.to_owned(), value).is_some()
        {
            return Err(Twice(renamed));
        }
        moved.push(renamed);
    }
    Ok(moved)
}
