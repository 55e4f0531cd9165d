//! What the rows of cases and of layers have in common.

use std::time::Duration;

use crate::ObjectName;

/// Objects about to be written, protected by their holder's pins.
#[derive(Debug, Clone)]
pub struct Pinned {
    /// The holder of the pins; unique for each write.
    pub holder: String,
    /// The pinned objects.
    pub names: Vec<ObjectName>,
}

/// The duration and the number of leases of a job.
#[derive(Debug, Clone, Copy)]
pub struct LeaseTerms {
    /// How long the lease lasts unless it is renewed.
    pub lease: Duration,
    /// A job with this many attempts fails instead.
    pub max_attempts: u32,
}

/// The terms for returning a lease.
#[derive(Debug, Clone, Copy)]
pub struct Release {
    /// How long until the job may be leased again.
    pub after: Duration,
    /// Whether the attempt counts.
    pub counts: bool,
}

/// The result of a publication.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Published {
    /// The case is ready.
    Done,
    /// The lease is lost, or the case is deleted. Nothing has changed.
    Fenced,
    /// A pin is gone, and perhaps its object too; write the objects again. Nothing has changed.
    PinLost,
}
