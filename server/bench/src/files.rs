//! Files as bytes.

use std::path::Path;

use crate::BenchError;

/// The bytes of a file.
pub(crate) fn read(path: &Path) -> Result<Vec<u8>, BenchError> {
    std::fs::read(path).map_err(|reason| BenchError::Unreadable {
        path: path.to_owned(),
        reason,
    })
}
