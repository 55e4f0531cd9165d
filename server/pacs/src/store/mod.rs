//! The rows of the PACS in the store: what came from it, what it has rejected, and what is sent to it.

mod arrivals;
mod columns;
#[cfg(test)]
mod conformance;
mod copy;
mod counts;
mod images;
mod receive;
mod results;
mod sent;
mod tables;
#[cfg(test)]
mod tests;

use std::ops::Deref;
use std::sync::Arc;
use std::time::Duration;

use case::images::Image;
use case::series::{SeriesQuery, SeriesUids, Uid};
use case::{CaseId, Failure};
use cases::dicom::Rejection;
use jiff::Timestamp;
use storage::Pinned;
use storage::args;
use storage::tables::{Connection, Referred, Row, jobs, microseconds, pins, unreadable};
use storage::{Claim, ListCursor, NewJob, ObjectName, Store, StoreError};

pub use self::copy::{CopiedStep, OfPacs};
use self::counts::ImageCounts;
pub use self::counts::ImageStatus;
pub use self::tables::PacsTables;
use crate::values::{
    Arrival, ArrivalQuery, ArrivalSource, DueSeries, DueTerms, LastImage, MadeCase, NewInstance,
    Outcome, Reception, Rejected, SERIES, Taken, Withdrawn,
};

/// How long to remember what rejection notes have withdrawn: a PACS that sends the images again does so within days, and
/// UIDs should not stay for ever.
const REJECTIONS_KEPT: Duration = Duration::from_secs(365 * 24 * 3600);

/// The store with the rows of the PACS. Cheap to clone.
#[derive(Debug, Clone)]
pub struct PacsStore {
    store: Store,
    counts: Arc<ImageCounts>,
}

impl Deref for PacsStore {
    type Target = Store;

    fn deref(&self) -> &Store {
        &self.store
    }
}

fn timestamp(now: i64) -> Result<Timestamp, StoreError> {
    Timestamp::from_microsecond(now).map_err(|_| unreadable("a time"))
}

async fn add_images(
    transaction: &mut Connection,
    instances: &[NewInstance],
    source: ArrivalSource,
    now: i64,
) -> Result<(Vec<Reception>, Vec<CaseId>), StoreError> {
    let (mut receptions, mut changed) = (Vec::with_capacity(instances.len()), Vec::new());
    for instance in instances {
        let added = arrivals::add(transaction, source, instance, now, &mut changed);
        receptions.push(added.await?);
    }
    Ok((receptions, changed))
}

impl PacsStore {
    /// Of a store that was opened with [`PacsTables`].
    pub fn new(store: Store) -> Self {
        Self {
            store,
            counts: Arc::default(),
        }
    }

    /// How many images came on which way and what became of them, since the process started.
    pub fn images(&self) -> Vec<(&'static str, ImageStatus, u64)> {
        self.counts.images()
    }

    /// Counts images that came.
    pub(crate) fn images_came(&self, source: ArrivalSource, status: ImageStatus, count: usize) {
        self.counts.came(source, status, count);
    }

    /// Adds images, whose objects are durable and pinned, to their series; what became of each. An image that is there already stays as it
    /// is, unless the new one is another one.
    pub(crate) async fn insert_images(
        &self,
        instances: &[NewInstance],
        pinned: &Pinned,
        source: ArrivalSource,
    ) -> Result<Referred<Vec<Reception>>, StoreError> {
        let (mut transaction, now) = self.write().await?;
        if !pins::consume(&mut transaction, pinned).await? {
            return Ok(Referred::PinLost);
        }
        let (received, changed) = add_images(&mut transaction, instances, source, now).await?;
        transaction.commit().await?;
        self.all_changed(&changed);
        Ok(Referred::Done(received))
    }

    /// The same for images whose objects are there, and are pinned by the same transaction: if it fails, nothing of them is removed.
    pub(crate) async fn insert_adopted_images(
        &self,
        instances: &[NewInstance],
        pinned: &Pinned,
        source: ArrivalSource,
    ) -> Result<Vec<Reception>, StoreError> {
        let (mut transaction, now) = self.write().await?;
        pins::hold(&mut transaction, pinned, now).await?;
        if !pins::consume(&mut transaction, pinned).await? {
            return Err(StoreError::Rows("an image is being removed".into()));
        }
        let (received, changed) = add_images(&mut transaction, instances, source, now).await?;
        transaction.commit().await?;
        self.all_changed(&changed);
        Ok(received)
    }

    /// Whether a PACS has sent an image with a UID.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub(crate) async fn has_come(&self, image: &Uid) -> Result<bool, StoreError> {
        images::has_come(&mut self.connect().await?, image).await
    }

    /// Counts an object that is not kept in the arrival of its series. An arrival that has nothing else became nothing, for
    /// this reason.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub(crate) async fn ignore(
        &self,
        uids: &SeriesUids,
        source: ArrivalSource,
        reason: &Failure,
    ) -> Result<(), StoreError> {
        let (mut transaction, now) = self.write().await?;
        arrivals::ignore(&mut transaction, uids, source, reason, now).await?;
        transaction.commit().await
    }

    /// Rejects what a note names: what was made of it is closed, and the images stay in case that it is lifted. An image that is here in
    /// another series than the note says is not rejected. Returns how many of the images are here.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub(crate) async fn reject(
        &self,
        rejection: &Rejection,
        source: ArrivalSource,
        by: &str,
    ) -> Result<usize, StoreError> {
        let (mut transaction, now) = self.write().await?;
        let mut changed = Vec::new();
        let here =
            arrivals::reject(&mut transaction, rejection, source, by, now, &mut changed).await?;
        transaction.commit().await?;
        self.all_changed(&changed);
        Ok(here)
    }

    /// The latest rejections that stand.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub(crate) async fn rejections(&self, limit: usize) -> Result<Vec<Rejected>, StoreError> {
        images::rejected(&mut self.connect().await?, limit).await
    }

    /// Lifts a rejection: its images count again. `false` if there is none with this id.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub(crate) async fn lift(&self, rejection: &str) -> Result<bool, StoreError> {
        let (mut transaction, _) = self.write().await?;
        let mut changed = Vec::new();
        let lifted = arrivals::lift(&mut transaction, rejection, &mut changed).await?;
        transaction.commit().await?;
        self.all_changed(&changed);
        Ok(lifted)
    }

    fn all_changed(&self, cases: &[CaseId]) {
        for case in cases {
            self.signals().changed(case);
        }
    }

    /// The cases that were made of any of these images, newest first.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub(crate) async fn made_of_any(&self, of: &[Image]) -> Result<Vec<MadeCase>, StoreError> {
        images::made_of_any(&mut self.connect().await?, of).await
    }

    /// Queues a job for each series that is due; returns how many.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub(crate) async fn queue_due_series(&self, terms: &DueTerms) -> Result<usize, StoreError> {
        // Most queries find nothing and must not wait for writers.
        let mut reader = self.connect().await?;
        let now = reader.now().await?;
        let found = arrivals::due(&mut reader, terms, now).await?;
        drop(reader);
        if found.is_empty() {
            return Ok(0);
        }
        let (mut transaction, now) = self.write().await?;
        let due = arrivals::due(&mut transaction, terms, now).await?;
        for id in &due {
            let job = NewJob::new(SERIES, id.clone());
            jobs::enqueue(&mut transaction, &job, now).await?;
        }
        transaction.commit().await?;
        Ok(due.len())
    }

    /// The series that a job is to read; `None` if it was forgotten.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub(crate) async fn series_to_read(
        &self,
        claim: &Claim,
    ) -> Result<Option<DueSeries>, StoreError> {
        arrivals::to_read(&mut self.connect().await?, &claim.key).await
    }

    /// Notes what became of a series and ends its job; `false`, and nothing has changed, if the lease is not ours any
    /// more, or the case is gone.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub(crate) async fn settle(
        &self,
        claim: &Claim,
        outcome: &Outcome,
    ) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.write().await?;
        // A series that became nothing was read: the job is done, and the series has the reason.
        let settled = jobs::finish(&mut transaction, claim, Ok(()), now).await?
            && arrivals::settle(&mut transaction, &claim.key, outcome).await?;
        if settled {
            if let Outcome::Case(case) | Outcome::Layer(case) = outcome {
                jobs::became(&mut transaction, claim, case).await?;
            }
            transaction.commit().await?;
        }
        Ok(settled)
    }

    /// Forgets settled series for which nothing has come for this long, and results whose sending ended that long ago, and
    /// removes the objects that nobody needs then. What was withdrawn is remembered for a year.
    ///
    /// # Errors
    /// If the rows or the objects cannot be written.
    pub async fn forget(&self, unchanged: Duration) -> Result<(), StoreError> {
        let (mut transaction, now) = self.write().await?;
        let before = now - microseconds(unchanged);
        arrivals::forget(&mut transaction, before, now).await?;
        results::forget(&mut transaction, before, now).await?;
        let long_ago = now - microseconds(REJECTIONS_KEPT.max(unchanged));
        images::forget(&mut transaction, long_ago).await?;
        transaction.commit().await?;
        self.collect().await
    }

    /// Notes that results are withdrawn, in whichever series they are.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub(crate) async fn withdraw(&self, instances: &[Uid]) -> Result<(), StoreError> {
        let (mut transaction, now) = self.write().await?;
        let at = timestamp(now)?;
        for instance in instances {
            let withdrawn = Withdrawn {
                uids: None,
                instance: instance.clone(),
                at,
                id: String::new(),
                by: String::new(),
                may_return: false,
            };
            images::withdraw(&mut transaction, &withdrawn).await?;
        }
        transaction.commit().await
    }

    /// At most `limit` withdrawn instances after one, by UID.
    pub(crate) async fn withdrawn(
        &self,
        after: Option<&Withdrawn>,
        limit: usize,
    ) -> Result<Vec<Withdrawn>, StoreError> {
        images::withdrawn(&mut self.connect().await?, after, limit).await
    }

    /// Notes that instances were withdrawn at these times in another store.
    pub(crate) async fn write_copied_withdrawn(
        &self,
        withdrawn: &[Withdrawn],
    ) -> Result<(), StoreError> {
        let (mut transaction, _) = self.write().await?;
        for withdrawn in withdrawn {
            images::withdraw(&mut transaction, withdrawn).await?;
        }
        let instances: Vec<_> = withdrawn.iter().map(|one| &one.instance).collect();
        images::judge(&mut transaction, &instances).await?;
        transaction.commit().await
    }

    /// At most `limit` images after one, by UID.
    pub(crate) async fn last_images(
        &self,
        after: Option<&LastImage>,
        limit: usize,
    ) -> Result<Vec<LastImage>, StoreError> {
        images::all(&mut self.connect().await?, after, limit).await
    }

    /// Notes that images came as another store has them.
    pub(crate) async fn write_copied_images(&self, all: &[LastImage]) -> Result<(), StoreError> {
        let (mut transaction, _) = self.write().await?;
        images::write_copied(&mut transaction, all).await?;
        transaction.commit().await
    }

    /// Whether each instance, such as a result, was withdrawn in whichever series.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub(crate) async fn are_withdrawn(&self, instances: &[Uid]) -> Result<Vec<bool>, StoreError> {
        let mut connection = self.connect().await?;
        let mut are = Vec::with_capacity(instances.len());
        for instance in instances {
            are.push(images::is_withdrawn(&mut connection, instance).await?);
        }
        Ok(are)
    }

    /// Makes a series of another store as it is there, and adds images; `false`, and nothing has changed, if a pin is
    /// gone. A series whose case is not here is read again.
    pub(crate) async fn write_copied_arrival(
        &self,
        arrival: &Arrival,
        images: &[NewInstance],
        pinned: &Pinned,
    ) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.write().await?;
        if !pins::consume(&mut transaction, pinned).await? {
            return Ok(false);
        }
        arrivals::write_copied(&mut transaction, arrival, images, now).await?;
        transaction.commit().await?;
        Ok(true)
    }

    /// Forgets the images of a series that are not among these.
    pub(crate) async fn keep_images(
        &self,
        arrival: &Arrival,
        kept: &[(Uid, ObjectName)],
    ) -> Result<(), StoreError> {
        let (mut transaction, now) = self.write().await?;
        arrivals::keep(&mut transaction, &arrival.uids, kept, now).await?;
        transaction.commit().await
    }

    /// Notes how many images a series has, according to its sender; nothing if none of them has come.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub(crate) async fn expect(
        &self,
        uids: &SeriesUids,
        instances: usize,
    ) -> Result<(), StoreError> {
        let (mut transaction, _) = self.write().await?;
        arrivals::expect(&mut transaction, uids, instances).await?;
        transaction.commit().await
    }

    /// Lets a series be read again as somebody wants it, whatever it was refused for; nothing if there is no such series.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub(crate) async fn take(&self, arrival: &str, taken: &Taken) -> Result<(), StoreError> {
        let (mut transaction, _) = self.write().await?;
        arrivals::take(&mut transaction, arrival, taken).await?;
        transaction.commit().await
    }

    /// At most `limit` series after a cursor, newest first, and the cursor of the next page.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub(crate) async fn arrivals(
        &self,
        query: &ArrivalQuery,
        after: Option<&ListCursor>,
        limit: usize,
    ) -> Result<(Vec<Arrival>, Option<ListCursor>), StoreError> {
        let mut connection = self.connect().await?;
        arrivals::page(&mut connection, query, after, limit).await
    }

    /// A series that came.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub(crate) async fn arrival(&self, id: &str) -> Result<Option<Arrival>, StoreError> {
        arrivals::one(&mut self.connect().await?, id).await
    }

    /// The series that came and that a request names.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub(crate) async fn arrivals_of(
        &self,
        query: &SeriesQuery,
    ) -> Result<Vec<Arrival>, StoreError> {
        arrivals::of(&mut self.connect().await?, query).await
    }

    /// The images of a series that are here and are not rejected.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub(crate) async fn counting_images_of(
        &self,
        uids: &SeriesUids,
    ) -> Result<Vec<ObjectName>, StoreError> {
        arrivals::counting_images_of(&mut self.connect().await?, uids).await
    }

    /// The images of a series that are here, by their UIDs.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn images_of(&self, uids: &SeriesUids) -> Result<Vec<(Uid, ObjectName)>, StoreError> {
        arrivals::images_of(&mut self.connect().await?, uids).await
    }

    /// How many series and results are in which state, as [`storage::RowCounts`] has them.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn counts_by_state(&self) -> Result<Vec<(String, String, String, u64)>, StoreError> {
        let rows = self
            .connect()
            .await?
            .fetch_all(
                "SELECT 'arrivals' AS what, '' AS part, state, count(*) AS number FROM arrivals GROUP BY state
                 UNION ALL SELECT 'results', node, state, count(*) FROM
                     (SELECT node, coalesce((SELECT jobs.state FROM jobs WHERE jobs.key = results.id
                                             ORDER BY jobs.created_at DESC, jobs.id DESC LIMIT 1), 'done') AS state
                      FROM results) AS sent GROUP BY node, state",
                args![],
            )
            .await?;
        let read = |row: &Row| {
            let [what, part, state] = ["what", "part", "state"].map(|column| row.get(column));
            Ok((
                what?,
                part?,
                state?,
                row.get::<i64>("number")?.unsigned_abs(),
            ))
        };
        rows.iter().map(read).collect()
    }

    /// How many series with how many images have come, and how many results there are.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn count(&self) -> Result<OfPacs, StoreError> {
        let mut connection = self.connect().await?;
        let row = connection
            .fetch_one(
                "SELECT (SELECT count(*) FROM arrivals) AS series, (SELECT count(*) FROM arrival_instances) AS images,
                        (SELECT count(*) FROM results) AS results",
                args![],
            )
            .await?;
        let count = |column| row.get::<i64>(column).map(i64::unsigned_abs);
        Ok(OfPacs {
            series: count("series")?,
            images: count("images")?,
            results: count("results")?,
        })
    }
}
