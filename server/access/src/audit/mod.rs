//! The audit record: who did what with which case, when, and from where.
//!
//! Events are lines of JSON in files of one folder. Each line has the digest of the line before, so that a line that is changed,
//! removed or inserted later is found ([`verify`]). Each process has files and a chain of its own; that a whole file or the last lines
//! were removed is noticed only at the machine that the lines are shipped to. No event contains a name of a patient, a
//! label or a query; UIDs are digests.
//!
//! A thread writes; [`Audit::record`] resolves once an event is on the disk. If it cannot be written, [`Audit::is_full`] holds
//! until a line can be appended again.

mod event;
mod line;
mod verify;
mod writer;

pub use self::event::{Action, Event, EventKind, Outcome, digest_of_uid};
pub use self::verify::{Break, Head, Verified, verify};
pub use self::writer::{Audit, CannotRecord, Options, check_folder};
