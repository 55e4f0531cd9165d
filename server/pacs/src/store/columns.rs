//! Numbers of images in columns.

/// A number of images for a column.
pub(super) fn count(number: usize) -> i64 {
    i64::try_from(number).unwrap_or(i64::MAX)
}

/// A number of images in a column.
pub(super) fn read_count(number: i64) -> usize {
    usize::try_from(number).unwrap_or(0)
}
