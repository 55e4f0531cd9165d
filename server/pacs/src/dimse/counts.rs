//! What happened at the listener since it was started, for metrics.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Rejections for one reason have one line in the log in this time.
const LOGGED_EVERY: Duration = Duration::from_secs(60);

/// Why an association or a connection was rejected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rejection {
    /// Its address is not listed.
    Address,
    /// Its title is not listed with its address.
    CallingTitle,
    /// It asked for another title than ours.
    CalledTitle,
    /// It speaks another application context.
    Context,
    /// There are as many associations as there may be.
    Limit,
}

impl Rejection {
    pub const ALL: [Self; 5] = [
        Self::Address,
        Self::CallingTitle,
        Self::CalledTitle,
        Self::Context,
        Self::Limit,
    ];

    /// Its name in metrics and in the log.
    pub fn name(self) -> &'static str {
        match self {
            Self::Address => "address-not-listed",
            Self::CallingTitle => "calling-title-not-listed",
            Self::CalledTitle => "called-title-not-ours",
            Self::Context => "context-not-supported",
            Self::Limit => "too-many-associations",
        }
    }
}

/// Counts since the listener was started.
#[derive(Debug, Default)]
pub struct AssociationCounts {
    running: AtomicU64,
    accepted: AtomicU64,
    rejected: [AtomicU64; Rejection::ALL.len()],
    /// When a rejection for each reason was last logged, and how many there were then. Held for moments.
    logged: Mutex<[Option<(Instant, u64)>; Rejection::ALL.len()]>,
    stored: AtomicU64,
    not_stored: AtomicU64,
}

/// An association that is running until this is dropped.
pub(crate) struct Running<'c>(&'c AssociationCounts);

impl Drop for Running<'_> {
    fn drop(&mut self) {
        self.0.running.fetch_sub(1, Ordering::Relaxed);
    }
}

impl AssociationCounts {
    pub(crate) fn begin(&self) -> Running<'_> {
        self.running.fetch_add(1, Ordering::Relaxed);
        self.accepted.fetch_add(1, Ordering::Relaxed);
        Running(self)
    }

    /// Counts a rejection. If it is to be logged, which one of a minute is, returns how many there were since the last that was.
    pub(crate) fn reject(&self, why: Rejection) -> Option<u64> {
        self.reject_at(why, Instant::now())
    }

    fn reject_at(&self, why: Rejection, now: Instant) -> Option<u64> {
        let all = self.rejected[why as usize].fetch_add(1, Ordering::Relaxed) + 1;
        let mut logged = self.logged.lock().unwrap_or_else(PoisonError::into_inner);
        let before = match logged[why as usize] {
            Some((last, _)) if now.duration_since(last) < LOGGED_EVERY => return None,
            Some((_, before)) => before,
            None => 0,
        };
        logged[why as usize] = Some((now, all));
        Some(all.saturating_sub(before))
    }

    pub(crate) fn answered(&self, is_stored: bool) {
        let count = match is_stored {
            true => &self.stored,
            false => &self.not_stored,
        };
        count.fetch_add(1, Ordering::Relaxed);
    }

    /// Associations now.
    pub fn running(&self) -> u64 {
        self.running.load(Ordering::Relaxed)
    }

    /// Associations that were accepted.
    pub fn accepted(&self) -> u64 {
        self.accepted.load(Ordering::Relaxed)
    }

    /// Those that were rejected for a reason.
    pub fn rejected(&self, why: Rejection) -> u64 {
        self.rejected[why as usize].load(Ordering::Relaxed)
    }

    /// Images that were answered with success, and with anything else.
    pub fn images(&self) -> [u64; 2] {
        [&self.stored, &self.not_stored].map(|count| count.load(Ordering::Relaxed))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rejections_have_a_line_a_minute_with_their_count() {
        let counts = AssociationCounts::default();
        let start = Instant::now();
        let logged = [0, 1, 59, 60, 61, 200].map(|second| {
            counts.reject_at(Rejection::Address, start + Duration::from_secs(second))
        });
        assert_eq!(logged, [Some(1), None, None, Some(3), None, Some(2)]);
        assert_eq!(counts.reject_at(Rejection::Limit, start), Some(1));
        assert_eq!(counts.rejected(Rejection::Address), 6);
    }
}
