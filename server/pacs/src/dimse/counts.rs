//! What happened at the listener since it was started, for metrics.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::SystemTime;

use http::logs::LogRateLimit;

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

/// How many lists of refused classes are counted apart.
const MOST_REFUSED: usize = 100;

/// Counts since the listener was started.
#[derive(Debug, Default)]
pub struct AssociationCounts {
    running: AtomicU64,
    accepted: AtomicU64,
    rejected: [AtomicU64; Rejection::ALL.len()],
    logged: [LogRateLimit; Rejection::ALL.len()],
    /// Associations of which presentation contexts were refused, by their classes. The mutex is held for a look-up.
    refused: Mutex<BTreeMap<String, LogRateLimit>>,
    stored: AtomicU64,
    not_stored: AtomicU64,
    /// When each peer last sent an image that was stored, by its title. The mutex is held for a look-up.
    last_images: Mutex<BTreeMap<String, SystemTime>>,
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

    /// Counts an association of which the presentation contexts of some classes were refused. If it is to be logged, which one of a
    /// minute is, returns how many there were since the last that was.
    pub(crate) fn refuse_contexts(&self, classes: &str) -> Option<u64> {
        let mut refused = self.refused.lock().unwrap_or_else(PoisonError::into_inner);
        if refused.len() == MOST_REFUSED && !refused.contains_key(classes) {
            refused.clear();
        }
        refused.entry(classes.to_owned()).or_default().count()
    }

    /// Counts a rejection. If it is to be logged, which one of a minute is, returns how many there were since the last that was.
    pub(crate) fn reject(&self, why: Rejection) -> Option<u64> {
        self.rejected[why as usize].fetch_add(1, Ordering::Relaxed);
        self.logged[why as usize].count()
    }

    /// Counts the answer to an image of a listed peer.
    pub(crate) fn answered(&self, is_stored: bool, peer: &str) {
        let count = match is_stored {
            true => &self.stored,
            false => &self.not_stored,
        };
        count.fetch_add(1, Ordering::Relaxed);
        if is_stored {
            let last = self.last_images.lock();
            let mut last = last.unwrap_or_else(PoisonError::into_inner);
            last.insert(peer.to_owned(), SystemTime::now());
        }
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

    /// When each peer last sent an image that was stored, by its title.
    pub fn last_images(&self) -> BTreeMap<String, SystemTime> {
        let last = self.last_images.lock();
        last.unwrap_or_else(PoisonError::into_inner).clone()
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
    fn every_rejection_counts_and_one_of_a_minute_and_a_reason_is_logged() {
        let counts = AssociationCounts::default();
        let logged =
            [Rejection::Limit, Rejection::Limit, Rejection::Context].map(|why| counts.reject(why));
        assert_eq!(logged, [Some(1), None, Some(1)]);
        assert_eq!(counts.rejected(Rejection::Limit), 2);
    }
}
