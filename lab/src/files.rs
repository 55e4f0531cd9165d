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

/// Writes a file.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> Result<(), BenchError> {
    std::fs::write(path, bytes).map_err(|error| BenchError::unwritable(path, &error))
}
