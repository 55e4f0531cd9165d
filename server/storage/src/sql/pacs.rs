//! The interface of the rows of what comes from a PACS.

use std::time::Duration;

use jiff::Timestamp;

use super::connection::{Connection, Row, microseconds};
use super::images;
use super::{arrivals, jobs, pins, results};
use crate::arrivals::{
    Arrival, ArrivalCursor, ArrivalQuery, ArrivalSource, CaseSeries, DueTerms, NewInstance,
    Outcome, Reception, Rejected, Rejection, SeriesQuery, SeriesUids, Taken, Uid,
};
use crate::jobs::{Claim, NewJob};
use crate::rows::{DueSeries, LastImage, Made, MadeCase, Pinned, Referred, RowCounts, Withdrawn};
use crate::{ForPacs, ObjectName, Store, StoreError};
use case::images::Image;
use case::{CaseId, Failure, JobKind, ObjectKind};

/// How long to remember what rejection notes have withdrawn: a PACS that sends the images again does so within days, and
/// UIDs should not stay for ever.
const REJECTIONS_KEPT: Duration = Duration::from_secs(365 * 24 * 3600);

fn timestamp(now: i64) -> Result<Timestamp, StoreError> {
    Timestamp::from_microsecond(now).map_err(|_| arrivals::unreadable("time"))
}

/// The next objects of a kind that has rows of its own, by digest; none of another kind.
pub(super) async fn objects(
    connection: &mut Connection,
    kind: ObjectKind,
    after: Option<&ObjectName>,
    limit: usize,
) -> Result<Vec<ObjectName>, StoreError> {
    let sql = match kind {
        ObjectKind::Instance => {
            "SELECT DISTINCT digest FROM arrival_instances WHERE digest > $1 ORDER BY digest LIMIT $2"
        }
        ObjectKind::Result => {
            "SELECT DISTINCT digest FROM results WHERE digest > $1 ORDER BY digest LIMIT $2"
        }
        _ => return Ok(Vec::new()),
    };
    let after = after.map(|name| name.digest.to_string());
    let rows = connection
        .query(sql)
        .bind(after.unwrap_or_default())
        .bind(i64::try_from(limit).unwrap_or(i64::MAX))
        .fetch_all()
        .await?;
    let read = |row: &Row| {
        let digest: String = row.get("digest")?;
        let unreadable = |_| StoreError::Rows("a row has an unreadable digest".into());
        let digest = blake3::Hash::from_hex(digest).map_err(unreadable)?;
        Ok(ObjectName { kind, digest })
    };
    rows.iter().map(read).collect()
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

impl Store {
    /// Adds images, whose objects are durable and pinned, to their series; what became of each. An image that is there already stays as it
    /// is, unless the new one is another one.
    pub(crate) async fn insert_images(
        &self,
        instances: &[NewInstance],
        pinned: &Pinned,
        source: ArrivalSource,
    ) -> Result<Referred<Vec<Reception>>, StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
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
        let (mut transaction, now) = self.rows().write().await?;
        super::hold(&mut transaction, pinned, now).await?;
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
    pub async fn has_come(&self, image: &Uid) -> Result<bool, StoreError> {
        images::has_come(&mut self.rows().connect().await?, image).await
    }

    /// Counts an object that is not kept in the arrival of its series. An arrival that has nothing else became nothing, for
    /// this reason.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub async fn ignore(
        &self,
        uids: &SeriesUids,
        source: ArrivalSource,
        reason: &Failure,
    ) -> Result<(), StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        arrivals::ignore(&mut transaction, uids, source, reason, now).await?;
        transaction.commit().await
    }

    /// Rejects what a note names: what was made of it is closed, and the images stay in case that it is lifted. An image that is here in
    /// another series than the note says is not rejected. Returns how many of the images are here.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub async fn reject(
        &self,
        rejection: &Rejection,
        source: ArrivalSource,
        by: &str,
    ) -> Result<usize, StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
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
    pub async fn rejections(&self, limit: usize) -> Result<Vec<Rejected>, StoreError> {
        images::rejected(&mut self.rows().connect().await?, limit).await
    }

    /// Lifts a rejection: its images count again. `false` if there is none with this id.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub async fn lift(&self, rejection: &str) -> Result<bool, StoreError> {
        let (mut transaction, _) = self.rows().write().await?;
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
    pub async fn made_of_any(&self, of: &[Image]) -> Result<Vec<MadeCase>, StoreError> {
        images::made_of_any(&mut self.rows().connect().await?, of).await
    }

    /// The images that something was made of.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn made_of(&self, made: &Made) -> Result<Vec<Image>, StoreError> {
        images::of(&mut self.rows().connect().await?, made).await
    }

    /// Notes of which images something was made, and how often each had come. Of those that are known, the last counts.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub async fn note_made_of(&self, made: &Made, of: &[Image]) -> Result<(), StoreError> {
        let (mut transaction, _) = self.rows().write().await?;
        images::make(&mut transaction, made, of).await?;
        transaction.commit().await
    }

    /// Queues a job for each series that is due; returns how many.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn queue_due_series(&self, terms: &DueTerms) -> Result<usize, StoreError> {
        // Most queries find nothing and must not wait for writers.
        let mut reader = self.rows().connect().await?;
        let now = self.rows().now(&mut reader).await?;
        let found = arrivals::due(&mut reader, terms, now).await?;
        drop(reader);
        if found.is_empty() {
            return Ok(0);
        }
        let (mut transaction, now) = self.rows().write().await?;
        let due = arrivals::due(&mut transaction, terms, now).await?;
        for id in &due {
            let job = NewJob::new(JobKind::SERIES, id.clone());
            jobs::enqueue(&mut transaction, &job, now).await?;
        }
        transaction.commit().await?;
        Ok(due.len())
    }

    /// The series that a job is to read; `None` if it was forgotten.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn series_to_read(&self, claim: &Claim) -> Result<Option<DueSeries>, StoreError> {
        arrivals::to_read(&mut self.rows().connect().await?, &claim.key).await
    }

    /// Notes what became of a series and ends its job; `false`, and nothing has changed, if the lease is not ours any
    /// more, or the case is gone.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn settle(&self, claim: &Claim, outcome: &Outcome) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
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
        let (mut transaction, now) = self.rows().write().await?;
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
    pub async fn withdraw(&self, instances: &[Uid]) -> Result<(), StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
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
        images::withdrawn(&mut self.rows().connect().await?, after, limit).await
    }

    /// Notes that instances were withdrawn at these times in another store.
    pub(crate) async fn write_copied_withdrawn(
        &self,
        withdrawn: &[Withdrawn],
    ) -> Result<(), StoreError> {
        let (mut transaction, _) = self.rows().write().await?;
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
        images::all(&mut self.rows().connect().await?, after, limit).await
    }

    /// Notes that images came as another store has them.
    pub(crate) async fn write_copied_images(&self, all: &[LastImage]) -> Result<(), StoreError> {
        let (mut transaction, _) = self.rows().write().await?;
        for image in all {
            images::write_copied(&mut transaction, image).await?;
        }
        transaction.commit().await
    }

    /// Whether each instance, such as a result, was withdrawn in whichever series.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn are_withdrawn(&self, instances: &[Uid]) -> Result<Vec<bool>, StoreError> {
        let mut connection = self.rows().connect().await?;
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
        let (mut transaction, now) = self.rows().write().await?;
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
        let (mut transaction, now) = self.rows().write().await?;
        arrivals::keep(&mut transaction, &arrival.uids, kept, now).await?;
        transaction.commit().await
    }

    /// Notes how many images a series has, according to its sender; nothing if none of them has come.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn expect(&self, uids: &SeriesUids, instances: usize) -> Result<(), StoreError> {
        let (mut transaction, _) = self.rows().write().await?;
        arrivals::expect(&mut transaction, uids, instances).await?;
        transaction.commit().await
    }

    /// Lets a series be read again as somebody wants it, whatever it was refused for; nothing if there is no such series.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn take(&self, arrival: &str, taken: &Taken) -> Result<(), StoreError> {
        let (mut transaction, _) = self.rows().write().await?;
        arrivals::take(&mut transaction, arrival, taken).await?;
        transaction.commit().await
    }

    /// At most `limit` series after a cursor, newest first, and the cursor of the next page.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn arrivals(
        &self,
        query: &ArrivalQuery,
        after: Option<&ArrivalCursor>,
        limit: usize,
    ) -> Result<(Vec<Arrival>, Option<ArrivalCursor>), StoreError> {
        let mut connection = self.rows().connect().await?;
        arrivals::page(&mut connection, query, after, limit).await
    }

    /// A series that came.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn arrival(&self, id: &str) -> Result<Option<Arrival>, StoreError> {
        arrivals::one(&mut self.rows().connect().await?, id).await
    }

    /// The series that came and that a request names.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn arrivals_of(&self, query: &SeriesQuery) -> Result<Vec<Arrival>, StoreError> {
        arrivals::of(&mut self.rows().connect().await?, query).await
    }

    /// The images of a series that are here and are not rejected.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn counting_images_of(
        &self,
        uids: &SeriesUids,
    ) -> Result<Vec<ObjectName>, StoreError> {
        arrivals::counting_images_of(&mut self.rows().connect().await?, uids).await
    }

    /// The images of a series that are here, by their UIDs.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn images_of(&self, uids: &SeriesUids) -> Result<Vec<(Uid, ObjectName)>, StoreError> {
        arrivals::images_of(&mut self.rows().connect().await?, uids).await
    }

    /// How many cases, series, results and jobs are in which state, and how long jobs have waited, for metrics.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn row_counts(&self) -> Result<RowCounts, StoreError> {
        let mut connection = self.rows().connect().await?;
        let now = self.rows().now(&mut connection).await?;
        let rows = connection
            .query(
                "SELECT 'cases' AS what, '' AS part, state, count(*) AS number FROM cases GROUP BY state
                 UNION ALL SELECT 'closed', CASE closed WHEN 1 THEN 'rejected' ELSE 'corrected' END, 'closed', count(*)
                     FROM cases WHERE closed > 0 GROUP BY closed
                 UNION ALL SELECT 'arrivals', '', state, count(*) FROM arrivals GROUP BY state
                 UNION ALL SELECT 'jobs', kind, state, count(*) FROM jobs GROUP BY kind, state
                 UNION ALL SELECT 'results', node, state, count(*) FROM
                     (SELECT node, coalesce((SELECT jobs.state FROM jobs WHERE jobs.key = results.id
                                             ORDER BY jobs.created_at DESC, jobs.id DESC LIMIT 1), 'done') AS state
                      FROM results) AS sent GROUP BY node, state",
            )
            .fetch_all()
            .await?;
        let read = |row: &Row| {
            let [what, part, state] = ["what", "part", "state"].map(|column| row.get(column));
            let number: i64 = row.get("number")?;
            Ok((what?, part?, state?, number.unsigned_abs()))
        };
        let by_state = rows.iter().map(read).collect::<Result<_, StoreError>>()?;
        Ok(RowCounts {
            by_state,
            oldest: jobs::oldest_of_each_kind(&mut connection, now).await?,
        })
    }

    /// How many series with how many images have come, and how many results there are.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn count_for_pacs(&self) -> Result<ForPacs, StoreError> {
        let mut connection = self.rows().connect().await?;
        let row = connection
            .query(
                "SELECT (SELECT count(*) FROM arrivals) AS series, (SELECT count(*) FROM arrival_instances) AS images,
                        (SELECT count(*) FROM results) AS results",
            )
            .fetch_one()
            .await?;
        let count = |column| row.get::<i64>(column).map(i64::unsigned_abs);
        Ok(ForPacs {
            series: count("series")?,
            images: count("images")?,
            results: count("results")?,
        })
    }

    /// Enters the series of a case into the index; nothing if there is no such case.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn index_series(&self, series: &CaseSeries) -> Result<(), StoreError> {
        let (mut transaction, _) = self.rows().write().await?;
        arrivals::index(&mut transaction, series).await?;
        transaction.commit().await
    }

    /// The indexed series of a case.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn series_of(&self, case: &CaseId) -> Result<Option<CaseSeries>, StoreError> {
        arrivals::series_of(&mut self.rows().connect().await?, case).await
    }

    /// The cases that a request names, newest first.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn cases_of(&self, query: &SeriesQuery) -> Result<Vec<CaseSeries>, StoreError> {
        arrivals::cases_of(&mut self.rows().connect().await?, query).await
    }
}
