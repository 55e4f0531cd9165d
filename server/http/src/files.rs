//! The files that a configuration names.

use std::path::{Path, PathBuf};

/// A file that cannot be read.
#[derive(Debug, thiserror::Error)]
#[error("{what} {} cannot be read: {source}", .path.display())]
pub struct UnreadableFile {
    what: &'static str,
    path: PathBuf,
    source: std::io::Error,
}

/// Reads a file; `what` names it in an error.
///
/// # Errors
/// If it cannot be read.
pub fn read_file(path: &Path, what: &'static str) -> Result<String, UnreadableFile> {
    std::fs::read_to_string(path).map_err(|source| UnreadableFile {
        what,
        path: path.to_owned(),
        source,
    })
}
