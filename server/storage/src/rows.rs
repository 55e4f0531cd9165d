//! What goes into the rows and comes out of them.
//!
//! Every method of [`Rows`](crate::sql::Rows) is one transaction, which ends before it returns. The time is the database's own: leases, pins and
//! tombstones of several machines, whose clocks differ, are compared by one clock. Callers give durations.
//!
//! An object is removed in three steps, none of which holds a transaction while the object store works:
//! `mark` leaves a tombstone on an unneeded object, the object is deleted, and `bury` removes
//! the tombstone. An object with a tombstone cannot be pinned, and a pinned or needed object gets no tombstone; so no
//! object is deleted that a process is about to reference. A tombstone has a lease: if its holder is killed, another
//! sweep takes it over and deletes the object again.

mod due;
mod layers;
mod terms;

use std::time::Duration;

pub use self::due::{DueSeries, Known};
pub use self::layers::{ChangedLayer, LayerChange, LayerClaim, LayerName};
pub(crate) use self::layers::{InsertedLayer, NewLayer};
pub use self::terms::{LeaseTerms, Pinned, Published, Release};

use super::ObjectName;
use case::{CaseId, Parameters};

/// A case to be inserted.
#[derive(Debug, Clone)]
pub(crate) struct NewCase {
    /// Its name.
    pub id: CaseId,
    /// The parameters from the upload.
    pub parameters: Parameters,
    /// The case of which it is a version.
    pub previous: Option<CaseId>,
    /// Its source objects: durable, and pinned.
    pub sources: Pinned,
    /// How many jobs may wait.
    pub queue_limit: usize,
}

/// The result of an insertion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Inserted {
    /// The case is new, and queued.
    Created,
    /// It existed and had failed; it is queued again.
    Requeued,
    /// It existed.
    Exists,
    /// The queue is full. Nothing has changed.
    QueueFull,
    /// A pin is gone, and perhaps its object too; write the objects again. Nothing has changed.
    PinLost,
}

/// A leased job.
#[derive(Debug, Clone, PartialEq)]
pub struct Claim {
    /// The case to be prepared.
    pub id: CaseId,
    /// The parameters.
    pub parameters: Parameters,
    /// The source objects.
    pub sources: Vec<ObjectName>,
    /// The number of this lease; a greater one fences it off.
    pub fence: i64,
    /// The number of leases that had no result, including this one.
    pub attempt: u32,
}

/// The holder of tombstones, and their lease.
#[derive(Debug, Clone)]
pub(crate) struct Sweep {
    /// Unique for each sweep.
    pub holder: String,
    /// After this time, another sweep may take over the tombstones.
    pub lease: Duration,
}

/// How many rows are in which state.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RowCounts {
    /// What they are (`cases`, `arrivals`, `retrievals`, `results`), the node if they have one, their state, and how many.
    pub by_state: Vec<(String, String, String, u64)>,
    /// For how long the oldest result waits that has not been sent.
    pub oldest_unsent: Option<Duration>,
}

/// A change of the rows by any process, including this one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Change {
    /// A job waits for a worker.
    Queued,
    /// A case is new or has changed.
    Changed(CaseId),
    /// A case was deleted.
    Deleted(CaseId),
}
