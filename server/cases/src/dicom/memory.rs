//! Memory for the processes that read files, which have one budget.

use std::sync::Arc;

use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use crate::error::Error;

/// What these processes may use together, in bytes: two of the largest series, or one and some files.
const BUDGET_BYTES: u64 = 3 << 30;

const MIB: u64 = 1 << 20;

/// Memory that processes share, each by its own limit. Cheap to clone.
#[derive(Debug, Clone)]
pub(crate) struct ReaderMemory {
    mib: Arc<Semaphore>,
    most: u64,
}

impl Default for ReaderMemory {
    fn default() -> Self {
        Self::new(BUDGET_BYTES)
    }
}

impl ReaderMemory {
    pub(super) fn new(bytes: u64) -> Self {
        let most = bytes / MIB;
        Self {
            mib: Arc::new(Semaphore::new(usize::try_from(most).unwrap_or(0))),
            most,
        }
    }

    /// Waits for as much memory as a process may use, in the order of those who ask. One that may use more than there is gets
    /// all of it.
    ///
    /// # Errors
    /// None in practice: the semaphore is never closed.
    pub(super) async fn take(&self, bytes: u64) -> Result<OwnedSemaphorePermit, Error> {
        let mib = bytes.div_ceil(MIB).min(self.most);
        let mib = u32::try_from(mib).unwrap_or(u32::MAX);
        let permit = Arc::clone(&self.mib).acquire_many_owned(mib).await;
        permit.map_err(|_| Error::Unavailable)
    }
}

#[cfg(test)]
mod tests {
    use futures_util::poll;

    use super::*;

    #[tokio::test]
    async fn processes_wait_for_each_other_by_their_memory() {
        let memory = ReaderMemory::new(10 * MIB);
        let large = memory.take(8 * MIB).await.unwrap();
        let _small = memory.take(2 * MIB).await.unwrap();
        let mut next = Box::pin(memory.take(1));
        assert!(poll!(&mut next).is_pending());
        drop(large);
        drop(next.await.unwrap());
        let mut greedy = Box::pin(memory.take(1000 * MIB));
        assert!(
            poll!(&mut greedy).is_pending(),
            "it gets all, once it is free"
        );
    }
}
