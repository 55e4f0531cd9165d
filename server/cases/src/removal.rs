//! The removal of expired cases, and what is said of those that stay.

use std::fmt;
use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use case::CaseId;
use storage::upkeep::{self, Expired, Removal, Waiting};
use storage::{Store, StoreError};

const DAY: Duration = Duration::from_secs(24 * 3600);

type Permission = Pin<Box<dyn Future<Output = bool> + Send>>;

/// What is told of each expired case before it is removed. If it does not agree, the case stays. Cheap to clone.
#[derive(Clone)]
pub struct BeforeRemoval(Arc<dyn Fn(CaseId) -> Permission + Send + Sync>);

impl BeforeRemoval {
    /// What a function says.
    pub fn new<F>(agrees: impl Fn(CaseId) -> F + Send + Sync + 'static) -> Self
    where
        F: Future<Output = bool> + Send + 'static,
    {
        Self(Arc::new(move |id| Box::pin(agrees(id))))
    }
}

/// Every expired case may go.
impl Default for BeforeRemoval {
    fn default() -> Self {
        Self::new(|_| std::future::ready(true))
    }
}

impl fmt::Debug for BeforeRemoval {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("BeforeRemoval")
    }
}

/// Removes the cases that are older than they are kept, as far as they need not wait and `before` agrees.
///
/// # Errors
/// If the rows or the objects cannot be written.
pub async fn remove_expired(
    store: &Store,
    before: &BeforeRemoval,
    removal: Removal,
) -> Result<Expired, StoreError> {
    upkeep::remove_expired(store, removal, |id| before.0(id)).await
}

/// When it was last said that something which is too old stays.
#[derive(Debug, Default)]
pub struct DailyWarning(Mutex<Option<Instant>>);

impl DailyWarning {
    /// Why something stays, if that is to be said now: once a day, and not in the first hour, when nobody has to do anything.
    pub fn to_say(&self, why: Option<Waiting>) -> Option<Waiting> {
        let why = why.filter(|why| *why != Waiting::FirstHour);
        why.filter(|_| self.is_due(Instant::now()))
    }

    /// Whether a day has passed since this was true.
    fn is_due(&self, now: Instant) -> bool {
        let mut last = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let is_due = last.is_none_or(|last| now.duration_since(last) >= DAY);
        if is_due {
            *last = Some(now);
        }
        is_due
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_happens_once_a_day_is_due_at_first_and_a_day_later() {
        let daily = DailyWarning::default();
        let (start, hour) = (Instant::now(), Duration::from_secs(3600));
        let due: Vec<_> = (1..60)
            .filter(|&hours| daily.is_due(start + hour * hours))
            .collect();
        assert_eq!(due, [1, 25, 49]);
    }
}
