//! The readings of cases: what named readers conclude.

use jiff::Timestamp;

/// Who has written a version of a reading, and when.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReadingState {
    /// The name by which the reader signs in.
    pub reader: String,
    /// From 1. Only the last one of a reader may be open.
    pub version: u32,
    pub changed_at: Timestamp,
    /// `None` while it is open.
    pub signed_at: Option<Timestamp>,
}

/// A version of a reading as it is stored.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StoredReading {
    pub state: ReadingState,
    /// JSON.
    pub document: String,
}

/// The result of an attempt to write or to sign a reading.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum WrittenReading {
    /// It is stored.
    Done(StoredReading),
    /// The same reader has changed it meanwhile; nothing has changed.
    Changed,
    /// The case is closed, so nobody signs or corrects what is signed; nothing has changed.
    Closed,
    /// There is no such case.
    NoSuchCase,
}
