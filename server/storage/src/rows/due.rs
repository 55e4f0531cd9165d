//! Series of a PACS that are complete.

use case::CaseId;
use case::arrivals::{SeriesUids, Taken};

use crate::ObjectName;

/// A leased series.
#[derive(Debug, Clone)]
pub struct DueSeries {
    /// The arrival.
    pub id: String,
    /// The series.
    pub uids: SeriesUids,
    /// The case that it became before its last images came.
    pub previous: Option<CaseId>,
    /// How somebody took it.
    pub taken: Option<Taken>,
    /// Its images, in the order of their UIDs.
    pub instances: Vec<ObjectName>,
    /// The number of this lease; a greater one fences it off.
    pub fence: i64,
}

/// An image with a UID that is known already.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Known {
    /// Its file.
    pub object: ObjectName,
    /// Whether it came under another study or series.
    pub is_elsewhere: bool,
}
