//! Signals within this process, without the rows: wake-ups, progress, counts.

use std::collections::HashMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use tokio::sync::watch;

use super::lock;
use case::{Case, CaseId, CaseState, Progress};

/// Something to count.
#[derive(Debug, Clone, Copy)]
pub enum Count {
    /// An object was found missing or damaged.
    BadObject,
    /// It was an uploaded file that is missing.
    MissingSource,
    /// A case was rebuilt from its source because of it.
    Rebuild,
    /// A case or a layer became ready.
    Prepared,
    /// The preparation of a case or of a layer failed.
    Failed,
    /// The preparation of a case or of a layer must be tried again.
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
    /// Jobs that were queued so far.
    queued: watch::Sender<u64>,
    watched: Mutex<HashMap<CaseId, watch::Sender<Signal>>>,
    counts: [AtomicU64; 6],
}

impl Signals {
    /// A receiver that changes when a job is queued.
    pub fn watch_queue(&self) -> watch::Receiver<u64> {
        self.queued.subscribe()
    }

    /// Wakes whoever waits for jobs.
    pub fn queued(&self) {
        self.queued.send_modify(|count| *count += 1);
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

    /// Counts an event.
    pub fn count(&self, event: Count) {
        self.counts[event as usize].fetch_add(1, Ordering::Relaxed);
    }

    /// How often an event was counted since the process started.
    pub fn counted(&self, event: Count) -> u64 {
        self.counts[event as usize].load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use case::{Parameters, Stage};
    use jiff::Timestamp;

    use super::*;

    fn id(text: &str) -> CaseId {
        let digest = blake3::hash(text.as_bytes());
        CaseId::of(&digest, None, &Parameters::default())
    }

    fn case(state: CaseState) -> Case {
        Case {
            id: id("one"),
            parameters: Parameters::default(),
            state,
            progress: None,
            failure: None,
            facts: None,
            previous: None,
            next: Vec::new(),
            created_at: Timestamp::UNIX_EPOCH,
            uploaded_at: Timestamp::UNIX_EPOCH,
            kept: false,
            trashed: false,
            closed: None,
            expires_at: None,
        }
    }

    #[test]
    fn each_event_has_a_count_of_its_own() {
        let signals = Signals::default();
        let events = [
            (Count::BadObject, 1),
            (Count::Rebuild, 2),
            (Count::Prepared, 3),
            (Count::Failed, 4),
            (Count::Retried, 5),
            (Count::MissingSource, 6),
        ];
        for (event, times) in events {
            (0..times).for_each(|_| signals.count(event));
        }
        for (event, times) in events {
            assert_eq!(signals.counted(event), times, "{event:?}");
        }
    }

    #[test]
    fn progress_is_shown_while_a_case_is_being_prepared() {
        let signals = Signals::default();
        let forest = Some(Progress::at(Stage::Forest));
        let shown = |state| {
            let mut case = case(state);
            signals.overlay(&mut case);
            case.progress
        };
        assert_eq!(shown(CaseState::Preparing), None);
        signals.progress(&id("one"), forest);
        signals.progress(&id("another"), None);
        for (state, expected) in [
            (CaseState::Queued, None),
            (CaseState::Preparing, forest),
            (CaseState::Ready, None),
        ] {
            assert_eq!(shown(state), expected, "{state:?}");
        }
        signals.progress(&id("one"), None);
        assert_eq!(shown(CaseState::Preparing), None, "it has ended");
    }

    #[tokio::test]
    async fn a_watcher_is_told_of_its_case_alone_and_nothing_is_kept_without_one() {
        let signals = Signals::default();
        let mut watcher = signals.watch(&id("one"));
        signals.changed(&id("another"));
        assert!(!watcher.has_changed().unwrap());
        signals.changed(&id("one"));
        let told = tokio::time::timeout(Duration::from_secs(5), watcher.changed());
        told.await.unwrap().unwrap();
        assert_eq!(lock(&signals.watched).len(), 1);
        drop(watcher);
        signals.changed(&id("one"));
        assert!(lock(&signals.watched).is_empty());
    }

    #[tokio::test]
    async fn everybody_who_waits_for_jobs_is_woken() {
        let signals = Signals::default();
        let mut waiting = [signals.watch_queue(), signals.watch_queue()];
        signals.queued();
        for receiver in &mut waiting {
            let woken = tokio::time::timeout(Duration::from_secs(5), receiver.changed());
            woken.await.unwrap().unwrap();
        }
    }
}
