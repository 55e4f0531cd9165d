//! Volumes that were decoded for a check, offered to an idle worker of the same process.
//!
//! This is only an optimisation: a volume that is not taken soon is dropped, and the worker reads the stored upload.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use case::CaseId;
use pipeline::ReadSource;
use tokio::sync::OwnedSemaphorePermit;

/// How long a volume waits for a worker that was idle.
const WAIT: Duration = Duration::from_secs(5);

/// A volume.
#[derive(Debug)]
struct Waiting {
    read: ReadSource,
    _room: Option<OwnedSemaphorePermit>,
    /// The number of this offer.
    number: u64,
}

#[derive(Debug, Default)]
struct Table {
    /// At most one for each idle worker.
    waiting: HashMap<CaseId, Waiting>,
    idle: usize,
    offers: u64,
}

/// The offered volumes. Cheap to clone.
#[derive(Debug, Clone)]
pub(crate) struct DecodedUploads {
    table: Arc<Mutex<Table>>,
    wait: Duration,
    /// Whether the workers can take what is offered.
    is_wanted: bool,
}

impl Default for DecodedUploads {
    fn default() -> Self {
        Self::new(true)
    }
}

impl DecodedUploads {
    /// For workers that can take volumes, or for workers whose preparations are in other processes.
    pub(crate) fn new(is_wanted: bool) -> Self {
        Self {
            table: Arc::default(),
            wait: WAIT,
            is_wanted,
        }
    }

    /// Held only briefly, and every change is complete.
    fn lock(&self) -> MutexGuard<'_, Table> {
        self.table.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Marks a worker as idle until the result is dropped.
    pub(crate) fn idle(&self) -> Idle {
        self.lock().idle += 1;
        Idle(self.clone())
    }

    /// Whether a worker is idle.
    #[cfg(test)]
    pub(crate) fn is_awaited(&self) -> bool {
        self.lock().idle > 0
    }

    /// Offers the volume of a case that is about to be queued, if a worker is idle. It keeps its room in memory, if that
    /// is counted.
    pub(crate) fn offer(
        &self,
        id: CaseId,
        read: ReadSource,
        room: Option<OwnedSemaphorePermit>,
    ) -> OfferedUpload {
        let mut table = self.lock();
        if !self.is_wanted || table.waiting.len() >= table.idle {
            return OfferedUpload(None);
        }
        table.offers += 1;
        let number = table.offers;
        let waiting = Waiting {
            read,
            _room: room,
            number,
        };
        table.waiting.insert(id, waiting);
        OfferedUpload(Some((self.clone(), id, number)))
    }

    /// Takes the volume of a case, if it is offered.
    pub(crate) fn take(&self, id: &CaseId) -> Option<ReadSource> {
        let taken = self.lock().waiting.remove(id);
        taken.map(|waiting| waiting.read)
    }

    /// Withdraws an offer that was not taken.
    fn withdraw(&self, id: &CaseId, number: u64) {
        let mut table = self.lock();
        let found = table.waiting.get(id);
        if found.is_some_and(|waiting| waiting.number == number) {
            let withdrawn = table.waiting.remove(id);
            drop(table);
            drop(withdrawn);
        }
    }
}

#[derive(Debug)]
pub(crate) struct Idle(DecodedUploads);

impl Drop for Idle {
    fn drop(&mut self) {
        self.0.lock().idle -= 1;
    }
}

/// An offered volume, or none; withdrawn if this is dropped, unless it is [kept](OfferedUpload::keep_if).
#[derive(Debug, Default)]
#[must_use]
pub(crate) struct OfferedUpload(Option<(DecodedUploads, CaseId, u64)>);

impl OfferedUpload {
    /// Keeps the offer for a while if the case was queued.
    pub(crate) fn keep_if(mut self, is_queued: bool) {
        if is_queued && let Some((uploads, id, number)) = self.0.take() {
            tokio::spawn(async move {
                tokio::time::sleep(uploads.wait).await;
                uploads.withdraw(&id, number);
            });
        }
    }
}

impl Drop for OfferedUpload {
    fn drop(&mut self) {
        if let Some((uploads, id, number)) = self.0.take() {
            uploads.withdraw(&id, number);
        }
    }
}

#[cfg(test)]
mod tests {
    use case::Parameters;
    use imaging::Limits;
    use pipeline::testing::{phantom, upload};
    use tokio::sync::Semaphore;

    use super::*;

    fn id(number: u8) -> CaseId {
        CaseId::of(&blake3::hash(&[number]), None, &Parameters::default())
    }

    fn read() -> ReadSource {
        let source = upload(&phantom());
        let checked = pipeline::check(&source, Parameters::default(), &Limits::default(), false);
        checked.unwrap().read
    }

    /// Offers of which none waits for long.
    fn short() -> DecodedUploads {
        DecodedUploads {
            wait: Duration::from_millis(20),
            ..DecodedUploads::default()
        }
    }

    async fn room(semaphore: &Arc<Semaphore>) -> OwnedSemaphorePermit {
        Arc::clone(semaphore).acquire_owned().await.unwrap()
    }

    #[tokio::test]
    async fn a_volume_is_handed_to_an_idle_worker_once() {
        let uploads = DecodedUploads::default();
        let semaphore = Arc::new(Semaphore::new(9));
        let offer = async |number| uploads.offer(id(number), read(), Some(room(&semaphore).await));
        offer(1).await.keep_if(true);
        assert!(uploads.take(&id(1)).is_none(), "no worker was idle");
        let idle = uploads.idle();
        offer(1).await.keep_if(true);
        offer(2).await.keep_if(true);
        assert!(uploads.take(&id(2)).is_none(), "one worker, one volume");
        assert_eq!(semaphore.available_permits(), 8);
        assert!(uploads.take(&id(1)).is_some());
        assert!(uploads.take(&id(1)).is_none(), "it was taken");
        drop(offer(3).await);
        assert!(uploads.take(&id(3)).is_none(), "it was withdrawn");
        drop(idle);
        offer(4).await.keep_if(true);
        assert!(uploads.take(&id(4)).is_none(), "the worker has work");
        assert_eq!(semaphore.available_permits(), 9);
    }

    #[tokio::test]
    async fn a_volume_that_nobody_takes_is_dropped() {
        let uploads = short();
        let semaphore = Arc::new(Semaphore::new(1));
        let _idle = uploads.idle();
        uploads
            .offer(id(1), read(), Some(room(&semaphore).await))
            .keep_if(true);
        // Its room is free again.
        let _room = room(&semaphore).await;
        assert!(uploads.take(&id(1)).is_none());
    }

    #[tokio::test]
    async fn an_old_offer_does_not_withdraw_a_new_one() {
        let uploads = DecodedUploads::default();
        let semaphore = Arc::new(Semaphore::new(9));
        let _idle = uploads.idle();
        let first = uploads.offer(id(1), read(), Some(room(&semaphore).await));
        assert!(uploads.take(&id(1)).is_some());
        uploads
            .offer(id(1), read(), Some(room(&semaphore).await))
            .keep_if(true);
        drop(first);
        assert!(uploads.take(&id(1)).is_some());
    }
}
