//! Memory for the processes that read files and prepare cases, which have one budget.

use std::sync::Arc;

use imaging::Limits;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use crate::prepare;

/// What readers may use together beside preparations, in bytes: two of the largest series, or one and some files.
const READER_BYTES: u64 = 3 << 30;

const MIB: u64 = 1 << 20;

/// Memory for the program itself, one file and one picture.
pub(crate) const READER_BASE_BYTES: u64 = 1 << 30;

/// Memory for each voxel: its sample in single precision while slices are collected, and its result.
const BYTES_PER_VOXEL: u64 = 8;

/// What the process may use that reads a series, in bytes.
pub(crate) fn series_bytes(limits: &Limits) -> u64 {
    let voxels = limits.max_voxels as u64;
    READER_BASE_BYTES.saturating_add(BYTES_PER_VOXEL.saturating_mul(voxels))
}

/// What the processes of one server may use, in bytes. Each has a limit of its own, which the kernel keeps; the limits of those that run at a
/// time are within the budget.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ChildBudget {
    /// All together.
    pub bytes: u64,
    /// One that reads a series.
    series: u64,
    /// One that prepares a case.
    preparation: u64,
}

impl ChildBudget {
    /// The usual one: enough for as many preparations at a time as there are workers, and for readers beside them.
    pub fn usual(limits: &Limits, workers: usize) -> Self {
        let (series, preparation) = (series_bytes(limits), prepare::bytes(limits));
        let workers = u64::try_from(workers.max(1)).unwrap_or(u64::MAX);
        let preparations = preparation.saturating_mul(workers);
        Self {
            bytes: READER_BYTES.max(series).saturating_add(preparations),
            series,
            preparation,
        }
    }

    /// The same, of so many bytes.
    #[must_use]
    pub fn of(self, bytes: u64) -> Self {
        Self { bytes, ..self }
    }

    /// The fewest bytes with which each process has its turn, one after the other.
    pub fn least(&self) -> u64 {
        self.series.max(self.preparation)
    }
}

impl Default for ChildBudget {
    fn default() -> Self {
        Self::usual(&Limits::default(), 1)
    }
}

/// Memory that processes share, each by its own limit. Cheap to clone.
#[derive(Debug, Clone)]
pub struct ChildMemory {
    all: Pool,
    /// What preparations may have of it: somebody waits for each reader.
    preparations: Pool,
    preparation_bytes: u64,
}

/// Until this is dropped, a process may use its memory.
#[derive(Debug, Default)]
#[must_use]
pub struct MemoryPermit {
    _parts: Vec<Option<OwnedSemaphorePermit>>,
}

impl Default for ChildMemory {
    fn default() -> Self {
        Self::new(ChildBudget::default())
    }
}

impl ChildMemory {
    /// The memory of a budget.
    pub fn new(budget: ChildBudget) -> Self {
        let rest = budget.bytes.saturating_sub(budget.series);
        Self {
            all: Pool::new(budget.bytes),
            preparations: Pool::new(rest.max(budget.preparation).min(budget.bytes)),
            preparation_bytes: budget.preparation,
        }
    }

    /// Waits for as much memory as a process may use that reads files, in the order of those who ask. One that may use more than there is gets
    /// all of it.
    pub async fn take(&self, bytes: u64) -> MemoryPermit {
        MemoryPermit {
            _parts: vec![self.all.take(bytes).await],
        }
    }

    /// Waits for as much memory as a preparation may use. Preparations leave room for a series, as far as there is any.
    pub async fn take_to_prepare(&self) -> MemoryPermit {
        let bytes = self.preparation_bytes;
        let of_preparations = self.preparations.take(bytes).await;
        MemoryPermit {
            _parts: vec![of_preparations, self.all.take(bytes).await],
        }
    }
}

#[derive(Debug, Clone)]
struct Pool {
    mib: Arc<Semaphore>,
    most: u64,
}

impl Pool {
    fn new(bytes: u64) -> Self {
        let most = (bytes / MIB).min(u64::from(u32::MAX));
        let permits = usize::try_from(most).unwrap_or(Semaphore::MAX_PERMITS);
        Self {
            mib: Arc::new(Semaphore::new(permits.min(Semaphore::MAX_PERMITS))),
            most,
        }
    }

    /// `None` does not occur: nobody closes the semaphore.
    async fn take(&self, bytes: u64) -> Option<OwnedSemaphorePermit> {
        let mib = bytes.div_ceil(MIB).min(self.most);
        let mib = u32::try_from(mib).unwrap_or(u32::MAX);
        Arc::clone(&self.mib).acquire_many_owned(mib).await.ok()
    }
}

#[cfg(test)]
mod tests {
    use futures_util::poll;

    use super::*;

    fn memory(mib: u64) -> ChildMemory {
        ChildMemory::new(ChildBudget {
            bytes: mib * MIB,
            series: 3 * MIB,
            preparation: 4 * MIB,
        })
    }

    #[tokio::test]
    async fn processes_wait_for_each_other_by_their_memory() {
        let memory = memory(10);
        let large = memory.take(8 * MIB).await;
        let _small = memory.take(2 * MIB).await;
        let mut next = Box::pin(memory.take(1));
        assert!(poll!(&mut next).is_pending());
        drop(large);
        drop(next.await);
        let mut greedy = Box::pin(memory.take(1000 * MIB));
        assert!(
            poll!(&mut greedy).is_pending(),
            "it gets all, once it is free"
        );
    }

    #[tokio::test]
    async fn preparations_and_readers_share_one_budget_and_a_series_has_room() {
        let memory = memory(11);
        let _first = memory.take_to_prepare().await;
        let second = memory.take_to_prepare().await;
        let mut third = Box::pin(memory.take_to_prepare());
        assert!(poll!(&mut third).is_pending());
        let series = memory.take(3 * MIB).await;
        let mut file = Box::pin(memory.take(MIB));
        assert!(poll!(&mut file).is_pending(), "all is taken");
        drop(second);
        drop(file.await); // The third preparation does not stand before it.
        drop(series);
        drop(third.await);
    }

    #[tokio::test]
    async fn with_little_memory_one_comes_after_the_other() {
        let memory = memory(4);
        let preparation = memory.take_to_prepare().await;
        let mut series = Box::pin(memory.take(3 * MIB));
        assert!(poll!(&mut series).is_pending());
        drop(preparation);
        let _series = series.await;
        let mut next = Box::pin(memory.take_to_prepare());
        assert!(poll!(&mut next).is_pending());
    }

    #[test]
    fn the_usual_budget_has_room_for_all_workers_and_a_series() {
        let limits = Limits::default();
        let [one, four] = [1, 4].map(|workers| ChildBudget::usual(&limits, workers));
        assert_eq!(one, ChildBudget::usual(&limits, 0));
        assert_eq!(four.bytes - one.bytes, 3 * one.preparation);
        assert!(one.bytes >= one.preparation + one.series && one.least() <= one.bytes);
        let huge = Limits {
            max_voxels: usize::MAX,
            ..limits
        };
        assert_eq!(ChildBudget::usual(&huge, 9).bytes, u64::MAX);
        let _pools = ChildMemory::new(ChildBudget::usual(&huge, 9));
    }
}
