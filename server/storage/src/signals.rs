//! Signals within this process, without the rows: wake-ups, progress, cancellations, counts.

use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use tokio::sync::{Notify, watch};

use super::lock;
use case::{Case, CaseId, CaseState, Progress};

/// Counts since the process started.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct Counters {
    /// Objects found missing or damaged.
    pub bad_objects: u64,
    /// Cases rebuilt from their source for this reason.
    pub rebuilds: u64,
    /// Cases made ready.
    pub prepared: u64,
    /// Cases that failed because of their input.
    pub failed: u64,
    /// Preparations that must be tried again because the store failed.
    pub retried: u64,
}

/// Something to count.
#[derive(Debug, Clone, Copy)]
pub enum Count {
    /// An object was found missing or damaged.
    BadObject,
    /// A case was rebuilt from its source because of it.
    Rebuild,
    /// A case became ready.
    Prepared,
    /// A case failed because of its input.
    Failed,
    /// A preparation must be tried again because the store failed.
    Retried,
}

/// The signal to watchers of a case: a number that changes with the row, and the progress.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Signal {
    changes: u64,
    progress: Option<Progress>,
}

/// Signals within this process. The mutexes are held for a look-up, never across an await.
#[derive(Debug, Default)]
pub struct Signals {
    /// A case was queued.
    queued: Notify,
    watched: Mutex<HashMap<CaseId, watch::Sender<Signal>>>,
    running: Mutex<HashMap<CaseId, Arc<AtomicBool>>>,
    counts: [AtomicU64; 5],
}

impl Signals {
    /// Waits until a case is queued by this process.
    pub async fn until_queued(&self) {
        self.queued.notified().await;
    }

    /// Wakes a worker.
    pub fn queued(&self) {
        self.queued.notify_one();
    }

    /// The row of a case has changed.
    pub fn changed(&self, id: &CaseId) {
        self.tell(id, |signal| signal.changes += 1);
    }

    /// A preparation has made progress or has ended.
    pub fn progress(&self, id: &CaseId, progress: Option<Progress>) {
        self.tell(id, |signal| signal.progress = progress);
    }

    fn tell(&self, id: &CaseId, change: impl FnOnce(&mut Signal)) {
        let mut watched = lock(&self.watched);
        let sender = watched.entry(*id).or_default();
        sender.send_modify(change);
        if sender.receiver_count() == 0 && sender.borrow().progress.is_none() {
            watched.remove(id);
        }
    }

    pub(super) fn watch(&self, id: &CaseId) -> watch::Receiver<Signal> {
        let mut watched = lock(&self.watched);
        watched
            .retain(|_, sender| sender.receiver_count() > 0 || sender.borrow().progress.is_some());
        watched.entry(*id).or_default().subscribe()
    }

    /// Gives a case the progress of this process's worker, which is newer than the row's.
    pub(super) fn overlay(&self, case: &mut Case) {
        if case.state != CaseState::Preparing {
            return;
        }
        let watched = lock(&self.watched);
        let progress = watched
            .get(&case.id)
            .and_then(|sender| sender.borrow().progress);
        case.progress = progress.or(case.progress);
    }

    /// A preparation begins; setting the returned flag stops it.
    pub fn begin(&self, id: &CaseId) -> Arc<AtomicBool> {
        let cancelled = Arc::new(AtomicBool::new(false));
        lock(&self.running).insert(*id, cancelled.clone());
        cancelled
    }

    /// A preparation has ended.
    pub fn end(&self, id: &CaseId, cancelled: &Arc<AtomicBool>) {
        let mut running = lock(&self.running);
        if running
            .get(id)
            .is_some_and(|flag| Arc::ptr_eq(flag, cancelled))
        {
            running.remove(id);
        }
        drop(running);
        self.progress(id, None);
    }

    /// Stops the preparation of a case, if this process is at it.
    pub(super) fn cancel(&self, id: &CaseId) {
        if let Some(cancelled) = lock(&self.running).get(id) {
            cancelled.store(true, Ordering::Relaxed);
        }
    }

    /// Counts an event.
    pub fn count(&self, event: Count) {
        self.counts[event as usize].fetch_add(1, Ordering::Relaxed);
    }

    pub(super) fn counters(&self) -> Counters {
        let of = |event: Count| self.counts[event as usize].load(Ordering::Relaxed);
        Counters {
            bad_objects: of(Count::BadObject),
            rebuilds: of(Count::Rebuild),
            prepared: of(Count::Prepared),
            failed: of(Count::Failed),
            retried: of(Count::Retried),
        }
    }
}
