//! What several tables have in columns.

use storage::StoreError;
use storage::tables::{Row, unreadable};

/// A number of images for a column.
pub(super) fn count(number: usize) -> i64 {
    i64::try_from(number).unwrap_or(i64::MAX)
}

/// A number of images in a column.
pub(super) fn read_count(number: i64) -> usize {
    usize::try_from(number).unwrap_or(0)
}

/// The column `digest`.
pub(super) fn read_digest(row: &Row) -> Result<blake3::Hash, StoreError> {
    let digest: String = row.get("digest")?;
    blake3::Hash::from_hex(digest).map_err(|_| unreadable("a digest"))
}
