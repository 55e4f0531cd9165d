//! Memory for the checks of volumes.

use std::sync::Arc;
use std::time::Duration;

use imaging::Limits;
use pipeline::HeadLimits;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use crate::error::Error;

/// How long an upload waits for room.
const LONGEST_WAIT: Duration = Duration::from_secs(30);

/// The shortest side of a layer, in mm.
const THINNEST_SLAB_MM: f64 = 5.0;

/// Memory for the checks of volumes, shared by their size.
#[derive(Debug, Clone)]
pub(crate) struct CheckMemory {
    head: HeadLimits,
    limits: Limits,
    /// Voxels in thousands: one volume of the largest size, or several small ones.
    voxels: Arc<Semaphore>,
}

fn thousands(voxels: usize) -> u32 {
    let most = Semaphore::MAX_PERMITS.min(u32::MAX as usize);
    u32::try_from(voxels.div_ceil(1000).min(most)).unwrap_or(u32::MAX)
}

impl CheckMemory {
    /// Room for volumes within limits.
    pub(crate) fn new(head: HeadLimits, limits: Limits) -> Self {
        let most = thousands(limits.max_voxels) as usize;
        Self {
            head,
            limits,
            voxels: Arc::new(Semaphore::new(most)),
        }
    }

    /// Room for a volume with this header, until it is dropped.
    ///
    /// # Errors
    /// [`Error::Failure`] if the header cannot be that of a head; [`Error::Busy`] if others take too long.
    pub(crate) async fn enter(&self, start: &[u8]) -> Result<OwnedSemaphorePermit, Error> {
        self.enter_within(self.head, start).await
    }

    /// The same for a layer, which may be a thin slab.
    ///
    /// # Errors
    /// As [`CheckMemory::enter`].
    pub(crate) async fn enter_layer(&self, start: &[u8]) -> Result<OwnedSemaphorePermit, Error> {
        let [least, most] = self.head.field_mm;
        let slab = HeadLimits {
            field_mm: [least.min(THINNEST_SLAB_MM), most],
            ..self.head
        };
        self.enter_within(slab, start).await
    }

    async fn enter_within(
        &self,
        head: HeadLimits,
        start: &[u8],
    ) -> Result<OwnedSemaphorePermit, Error> {
        let voxels = head.check(start, &self.limits)?;
        let weight = thousands(voxels).min(thousands(self.limits.max_voxels));
        let permit = Arc::clone(&self.voxels).acquire_many_owned(weight);
        match tokio::time::timeout(LONGEST_WAIT, permit).await {
            Ok(permit) => permit.map_err(|_| Error::Unavailable),
            Err(_elapsed) => Err(Error::Busy),
        }
    }
}

#[cfg(test)]
mod tests {
    use futures_util::poll;
    use geometry::phantom::head;

    use super::*;

    #[tokio::test]
    async fn volumes_wait_for_each_other_by_their_size() {
        let volume = head(4.0).volume;
        let start = imaging::nifti::write_volume(&volume).unwrap();
        let two = Limits {
            max_voxels: 2 * volume.grid().voxel_count().next_multiple_of(1000),
            ..Limits::default()
        };
        let room = CheckMemory::new(HeadLimits::default(), two);
        let first = room.enter(&start).await.unwrap();
        let _second = room.enter(&start).await.unwrap();
        let mut third = Box::pin(room.enter(&start));
        assert!(poll!(&mut third).is_pending());
        drop(first);
        let _third = third.await.unwrap();
    }

    #[tokio::test]
    async fn what_no_head_measures_gets_no_room() {
        let room = CheckMemory::new(HeadLimits::default(), Limits::default());
        let large = head(4.0).volume.grid().voxel_count();
        let start = imaging::nifti::write_volume(&head(4.0).volume).unwrap();
        let few = Limits {
            max_voxels: large - 1,
            ..Limits::default()
        };
        let small = HeadLimits {
            field_mm: [50.0, 60.0],
            ..HeadLimits::default()
        };
        for (room, start, name) in [
            (&room, &b"a text"[..], "not-nifti"),
            (&room, b"", "not-nifti"),
            (
                &CheckMemory::new(HeadLimits::default(), few),
                &start,
                "too-many-voxels",
            ),
            (
                &CheckMemory::new(small, Limits::default()),
                &start,
                "field-implausible",
            ),
        ] {
            match room.enter(start).await {
                Err(Error::Failure(failure)) => assert_eq!(failure.name, name),
                other => panic!("{name}: {other:?}"),
            }
        }
    }

    #[test]
    fn no_number_of_voxels_overflows() {
        for (voxels, expected) in [(0, 0), (1, 1), (1000, 1), (1001, 2), (usize::MAX, u32::MAX)] {
            assert_eq!(thousands(voxels), expected, "{voxels}");
        }
    }
}
