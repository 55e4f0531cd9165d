//! The changes of one case.

use tokio::sync::watch;

use super::signals::Signal;
use super::{Store, StoreError};
use case::{Case, CaseId};

/// The changes of one case: at once if this process makes them, otherwise by polling its row.
#[derive(Debug)]
pub struct Watch {
    store: Store,
    id: CaseId,
    signals: watch::Receiver<Signal>,
    seen: Option<Case>,
}

impl Watch {
    pub(super) fn new(store: Store, id: CaseId) -> Self {
        let signals = store.signals().watch(&id);
        Self {
            store,
            id,
            signals,
            seen: None,
        }
    }

    /// The current case at the first call, then each changed case. `None` after it is deleted.
    ///
    /// After a final state, it waits for a deletion or a new upload; a caller that does not need these stops at
    /// [`CaseState::is_final`](case::CaseState::is_final). Safe to drop and call again.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn next(&mut self) -> Result<Option<Case>, StoreError> {
        loop {
            self.signals.mark_unchanged();
            let case = self.store.case(&self.id).await?;
            if case.is_none() || case != self.seen {
                self.seen.clone_from(&case);
                return Ok(case);
            }
            self.changed().await;
        }
    }

    /// Waits for a signal of a change, or for the time to poll.
    pub async fn changed(&mut self) {
        let poll = tokio::time::sleep(self.store.options().poll);
        tokio::select! {
            // The store holds the sender as long as there is a receiver.
            _ = self.signals.changed() => {}
            () = poll => {}
        }
    }
}
