//! Jobs: work that one process at a time does. There is one table, one claim and one end for all kinds.
//!
//! A job is a row with a lease. Its holder renews the lease while it works. If the process is killed, the lease ends and
//! another one takes the job with a greater fence number, so that the first can no longer end or publish anything. A job
//! that was tried as often as its kind may be fails, whoever queued it, and with it what it is about.

use std::time::Duration;

use case::{CaseId, Failure, JobKind, JobState};
use jiff::Timestamp;

use super::rows::Owner;

/// A job to be queued.
#[derive(Debug, Clone)]
pub struct NewJob {
    pub kind: JobKind,
    /// What it is about. There is one open job for each kind and key.
    pub key: String,
    /// The case with which it is deleted.
    pub case: Option<CaseId>,
    /// Whether it waits until the case is ready.
    pub needs_ready: bool,
    /// What whoever does it needs to know: JSON.
    pub payload: String,
}

impl NewJob {
    /// A job that needs to know nothing but its key, and belongs to no case.
    pub fn new(kind: JobKind, key: impl Into<String>) -> Self {
        Self {
            kind,
            key: key.into(),
            case: None,
            needs_ready: false,
            payload: "{}".to_owned(),
        }
    }

    /// A job about a case or a layer. All but the preparation of a case wait until the case is ready.
    pub fn about(kind: JobKind, owner: impl Into<Owner>) -> Self {
        let owner = owner.into();
        Self {
            case: Some(owner.case),
            needs_ready: kind != JobKind::PREPARE,
            ..Self::new(kind, owner.key())
        }
    }
}

/// A job, open or ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Job {
    /// Its name in addresses: 32 hexadecimal digits without a meaning.
    pub id: String,
    /// The word of its kind.
    pub kind: String,
    /// What it is about.
    pub key: String,
    pub case: Option<CaseId>,
    /// What it needs to know: JSON.
    pub payload: String,
    pub state: JobState,
    /// How far the latest attempt is or was: JSON.
    pub progress: Option<String>,
    /// Why it failed, or, while it is open, why the latest attempt did.
    pub failure: Option<Failure>,
    /// Attempts so far.
    pub attempts: u32,
    /// When it was queued.
    pub created_at: Timestamp,
    /// When it ended.
    pub ended_at: Option<Timestamp>,
}

/// Which jobs to list.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct JobQuery {
    pub kind: JobKind,
    /// Their state; all if there is none.
    pub state: Option<JobState>,
    /// How their keys begin.
    pub key_prefix: String,
}

/// A leased job.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Claim {
    /// The job.
    pub id: String,
    pub kind: JobKind,
    /// What it is about.
    pub key: String,
    pub case: Option<CaseId>,
    /// What it needs to know: JSON.
    pub payload: String,
    /// The number of this lease; a greater one fences it off.
    pub fence: i64,
    /// The number of leases that had no result, including this one.
    pub attempt: u32,
    /// How long ago it was queued.
    pub age: Duration,
}

impl Claim {
    /// The case or the layer that the job is about, if it is about one.
    pub fn owner(&self) -> Option<Owner> {
        Owner::of_key(&self.key)
    }
}

/// The terms for returning a lease.
#[derive(Debug, Clone, PartialEq)]
pub struct Release {
    /// How long until the job may be leased again.
    pub after: Duration,
    /// Whether the attempt counts.
    pub counts: bool,
    /// Why the attempt had no result.
    pub failure: Option<Failure>,
}
