//! Series that come from a PACS, and the index of the series of cases.

use crate::identity::Rejection;
use case::images::Following;
use case::series::{AccessionNumber, SeriesQuery, SeriesUids, Uid};
use case::{CaseId, Failure, ObjectKind};
use jiff::Timestamp;
use storage::args;
use storage::tables::{
    Connection, Referred, Row, containing, jobs, microseconds, new_id, pins, read_accession_number,
    read_case, read_time, read_uid, read_uids, unreadable,
};
use storage::{Claim, Cursor, NewJob, ObjectName, Pinned, StoreError};

use super::PacsStore;
use super::columns::{count, read_count, read_digest};
use super::images::{self, Arrived, wake_layers_of_closed};
use crate::refusal::Refusal;
use crate::values::{
    ALL_REFUSED, Arrival, ArrivalQuery, ArrivalSource, ArrivalState, BECAME_LAYER, DueImage,
    DueSeries, DueTerms, IMAGES_LOST, INCOMPLETE_CORRECTION, MOVED, NO_CASE, NOT_T1, NewInstance,
    Outcome, Reception, SERIES, Taken, images_rejected,
};

/// How many series are listed of which everything was refused.
const MOST_ALL_REFUSED: usize = 100;

/// Columns that `read` understands. `WHERE` and what follows may come after.
macro_rules! select_arrival {
    ($rest:literal) => {
        concat!(
            "SELECT id, study_uid, series_uid, accession_number, source, label, state, reason, taken, refused, case_id,
                    instances, expected, corrected, ignored, refused_objects, last_refusal, first_at, last_at
             FROM arrivals ",
            $rest
        )
    };
}

impl PacsStore {
    /// Adds images, whose objects are durable and pinned, to their series; what became of each. An image that is there already stays as it
    /// is, unless the new one is another one.
    pub(crate) async fn insert_images(
        &self,
        instances: &[NewInstance],
        pinned: &Pinned,
        source: ArrivalSource,
    ) -> Result<Referred<Vec<Reception>>, StoreError> {
        let (transaction, now) = self.store.write().await?;
        self.add_images(transaction, instances, pinned, source, now)
            .await
    }

    /// Makes arrivals of images whose objects are there, and which no row names. Nothing is written but rows, and by one transaction, which
    /// also pins the objects, so that nothing is removed if it fails.
    ///
    /// # Errors
    /// If the rows cannot be written, or one of the objects is being removed.
    pub(crate) async fn adopt_images(
        &self,
        images: &[NewInstance],
        source: ArrivalSource,
    ) -> Result<Vec<Reception>, StoreError> {
        let pinned = Pinned::new(images.iter().map(ObjectName::from));
        let (mut transaction, now) = self.store.write().await?;
        pins::hold(&mut transaction, &pinned, now).await?;
        let added = self.add_images(transaction, images, &pinned, source, now);
        match added.await? {
            Referred::Done(received) | Referred::Unneeded(received) => Ok(received),
            Referred::PinLost => Err(StoreError::Rows("an image is being removed".into())),
        }
    }

    /// Turns pins into references, adds the images and commits.
    async fn add_images(
        &self,
        mut transaction: Connection,
        instances: &[NewInstance],
        pinned: &Pinned,
        source: ArrivalSource,
        now: i64,
    ) -> Result<Referred<Vec<Reception>>, StoreError> {
        if !pins::consume(&mut transaction, pinned).await? {
            return Ok(Referred::PinLost);
        }
        let (mut received, mut changed) = (Vec::with_capacity(instances.len()), Vec::new());
        for instance in instances {
            received.push(add(&mut transaction, source, instance, now, &mut changed).await?);
        }
        transaction.commit().await?;
        self.all_changed(&changed);
        Ok(Referred::Done(received))
    }

    fn all_changed(&self, cases: &[CaseId]) {
        for case in cases {
            self.store.signals().changed(case);
        }
    }

    /// Counts an object that is not kept in the arrival of its series, which is made if there is none. An arrival that has nothing else
    /// became nothing, for this reason.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub(crate) async fn ignore(
        &self,
        uids: &SeriesUids,
        source: ArrivalSource,
        reason: &Failure,
    ) -> Result<(), StoreError> {
        let (mut transaction, now) = self.store.write().await?;
        transaction
            .execute(
                "INSERT INTO arrivals (id, study_uid, series_uid, source, state, reason, first_at, last_at, ignored)
                 VALUES ($1, $2, $3, $4, 'nothing', $5, $6, $6, 1)
                 ON CONFLICT (study_uid, series_uid) DO UPDATE SET ignored = arrivals.ignored + 1,
                    reason = CASE WHEN arrivals.reason LIKE $7 THEN excluded.reason ELSE arrivals.reason END",
                args![
                    new_id(), uids.study.as_str(), uids.series.as_str(), source.name(),
                    serde_json::to_string(reason)?, now, of_all_refused(),
                ],
            )
            .await?;
        transaction.commit().await
    }

    /// Counts objects that are refused in the arrivals of their series. A series of which nothing else has come has an arrival too.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub(crate) async fn refuse(
        &self,
        refused: &[(SeriesUids, Refusal)],
        source: ArrivalSource,
    ) -> Result<(), StoreError> {
        if refused.is_empty() {
            return Ok(());
        }
        let (mut transaction, now) = self.store.write().await?;
        for (uids, refusal) in refused {
            refuse(&mut transaction, uids, source, refusal, now).await?;
        }
        transaction.commit().await
    }

    /// Rejects what a note names: what was made of it is closed, and the images stay in case that it is lifted; their series are read again
    /// without them. An image that is here in another series than the note says is not rejected. Returns how many of the images are here.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub(crate) async fn reject(
        &self,
        rejection: &Rejection,
        source: ArrivalSource,
        by: &str,
    ) -> Result<usize, StoreError> {
        let (mut transaction, now) = self.store.write().await?;
        let changed = images::reject(&mut transaction, rejection, by, now).await?;
        let mut here = 0;
        for (uids, instances) in &rejection.series {
            let row = transaction
                .fetch_one(
                    "INSERT INTO arrivals (id, study_uid, series_uid, source, state, reason, first_at, last_at)
                     VALUES ($1, $2, $3, $4, 'nothing', $5, $6, $6)
                     ON CONFLICT (study_uid, series_uid) DO UPDATE SET last_at = $6,
                        reason = CASE WHEN arrivals.reason LIKE $7 THEN excluded.reason ELSE arrivals.reason END
                     RETURNING id",
                    args![
                        new_id(), uids.study.as_str(), uids.series.as_str(), source.name(),
                        serde_json::to_string(&images_rejected())?, now, of_all_refused(),
                    ],
                )
                .await?;
            here += read_again(&mut transaction, &row.get::<String>("id")?, instances).await?;
        }
        transaction.commit().await?;
        self.all_changed(&changed);
        Ok(here)
    }

    /// Lifts a rejection: its images count again, and their series is read again. `false` if there is none with this id.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub(crate) async fn lift(&self, rejection: &str) -> Result<bool, StoreError> {
        let (mut transaction, _) = self.store.write().await?;
        let mut changed = Vec::new();
        let Some((uids, instances)) =
            images::lift(&mut transaction, rejection, &mut changed).await?
        else {
            return Ok(false);
        };
        let row = transaction
            .fetch_optional(
                "SELECT id FROM arrivals WHERE study_uid = $1 AND series_uid = $2",
                args![uids.study.as_str(), uids.series.as_str()],
            )
            .await?;
        if let Some(row) = row {
            read_again(&mut transaction, &row.get::<String>("id")?, &instances).await?;
        }
        transaction.commit().await?;
        self.all_changed(&changed);
        Ok(true)
    }

    /// Notes how many images a series has, according to its sender; nothing if none of them has come.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub(crate) async fn expect(
        &self,
        uids: &SeriesUids,
        instances: usize,
    ) -> Result<(), StoreError> {
        let (mut transaction, _) = self.store.write().await?;
        transaction
            .execute(
                "UPDATE arrivals SET expected = $1 WHERE study_uid = $2 AND series_uid = $3",
                args![count(instances), uids.study.as_str(), uids.series.as_str()],
            )
            .await?;
        transaction.commit().await
    }

    /// Queues a job for each series that is due; returns how many.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub(crate) async fn queue_due_series(&self, terms: &DueTerms) -> Result<usize, StoreError> {
        // Most queries find nothing and must not wait for writers.
        let mut reader = self.store.connect().await?;
        let now = reader.now().await?;
        let found = due(&mut reader, terms, now).await?;
        drop(reader);
        if found.is_empty() {
            return Ok(0);
        }
        let (mut transaction, now) = self.store.write().await?;
        let due = due(&mut transaction, terms, now).await?;
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
        let mut connection = self.store.connect().await?;
        let row = connection
            .fetch_optional(
                "SELECT study_uid, series_uid, taken, corrected FROM arrivals WHERE id = $1",
                args![&claim.key],
            )
            .await?;
        let Some(row) = row else {
            return Ok(None);
        };
        Ok(Some(DueSeries {
            uids: read_uids(&row)?,
            taken: read_taken(&row)?,
            is_corrected: row.get::<i64>("corrected")? > 0,
            images: due_images(&mut connection, &claim.key).await?,
        }))
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
        let (mut transaction, now) = self.store.write().await?;
        // A series that became nothing was read: the job is done, and the series has the reason.
        let settled = jobs::finish(&mut transaction, claim, Ok(()), now).await?
            && settle(&mut transaction, &claim.key, outcome).await?;
        if settled {
            if let Outcome::Case(case) | Outcome::Layer(case) = outcome {
                jobs::became(&mut transaction, claim, case).await?;
            }
            transaction.commit().await?;
        }
        Ok(settled)
    }

    /// Lets a series be read again as somebody wants it, whatever it was refused for: the reason stays. Nothing if there is no such series;
    /// one that is not complete yet is still awaited.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub(crate) async fn take(&self, arrival: &str, taken: &Taken) -> Result<(), StoreError> {
        let (mut transaction, _) = self.store.write().await?;
        transaction
            .execute(
                "UPDATE arrivals SET taken = $1, refused = CASE WHEN state = 'nothing' THEN reason ELSE refused END,
                        state = 'receiving', reason = NULL, corrected = 0
                 WHERE id = $2",
                args![serde_json::to_string(taken)?, arrival],
            )
            .await?;
        // Whoever reads it at this moment does not decide.
        jobs::cancel(&mut transaction, SERIES, arrival).await?;
        transaction.commit().await
    }

    /// At most `limit` series after a cursor, newest first, and the cursor of the next page.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub(crate) async fn arrivals(
        &self,
        query: &ArrivalQuery,
        after: Option<&Cursor>,
        limit: usize,
    ) -> Result<(Vec<Arrival>, Option<Cursor>), StoreError> {
        let mut connection = self.store.connect().await?;
        let (at, id) = Cursor::place(after);
        let rows = connection
            .fetch_all(
                select_arrival!(
                    "WHERE (first_at, id) < ($1, $2) AND first_at >= $3 AND first_at < $4
                   AND ($5 = '' OR $5 = state)
                   AND ($6 = '' OR $6 = case_id)
                   AND ($7 = '' OR lower(label) LIKE lower($7) ESCAPE '!')
                 ORDER BY first_at DESC, id DESC LIMIT $8"
                ),
                args![
                    at,
                    id,
                    query.since.map_or(0, Timestamp::as_microsecond),
                    query.until.map_or(i64::MAX, Timestamp::as_microsecond),
                    query.state.map_or("", ArrivalState::name),
                    query.case.map_or_else(String::new, |case| case.to_string()),
                    query.text.as_deref().map_or_else(String::new, containing),
                    count(limit.saturating_add(1))
                ],
            )
            .await?;
        let arrivals = rows.iter().map(read).collect::<Result<_, _>>()?;
        Ok(Cursor::page(arrivals, limit, |arrival: &Arrival| {
            (arrival.first_at, arrival.id.clone())
        }))
    }

    /// A series that came.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub(crate) async fn arrival(&self, id: &str) -> Result<Option<Arrival>, StoreError> {
        let mut connection = self.store.connect().await?;
        let row = connection
            .fetch_optional(select_arrival!("WHERE id = $1"), args![id])
            .await?;
        row.as_ref().map(read).transpose()
    }

    /// The series that came and that a request names.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub(crate) async fn arrivals_of(
        &self,
        query: &SeriesQuery,
    ) -> Result<Vec<Arrival>, StoreError> {
        let mut connection = self.store.connect().await?;
        let rows = match query {
            SeriesQuery::Study(study, series) => connection
                .fetch_all(
                    select_arrival!(
                    "WHERE study_uid = $1 AND coalesce($2, series_uid) = series_uid ORDER BY first_at, id"
                ),
                    args![study.as_str(), series.as_ref().map(Uid::as_str)],
                ),
            SeriesQuery::AccessionNumber(number) => connection
                .fetch_all(
                    select_arrival!(
                    "WHERE accession_number = $1 ORDER BY first_at, id"
                ),
                    args![number.as_str()],
                ),
        };
        rows.await?.iter().map(read).collect()
    }

    /// The images of a series that are here and are not rejected.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub(crate) async fn counting_images_of(
        &self,
        uids: &SeriesUids,
    ) -> Result<Vec<ObjectName>, StoreError> {
        let mut connection = self.store.connect().await?;
        let row = connection
            .fetch_optional(
                "SELECT id FROM arrivals WHERE study_uid = $1 AND series_uid = $2",
                args![uids.study.as_str(), uids.series.as_str()],
            )
            .await?;
        let images = match row {
            Some(row) => due_images(&mut connection, &row.get::<String>("id")?).await?,
            None => Vec::new(),
        };
        Ok(images.into_iter().map(|image| image.object).collect())
    }

    /// The images of a series that are here, by their UIDs.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn images_of(&self, uids: &SeriesUids) -> Result<Vec<(Uid, ObjectName)>, StoreError> {
        images_of(&mut self.store.connect().await?, uids).await
    }

    /// Forgets the images of a series that are not among these.
    pub(crate) async fn keep_images(
        &self,
        arrival: &Arrival,
        kept: &[(Uid, ObjectName)],
    ) -> Result<(), StoreError> {
        let (mut transaction, now) = self.store.write().await?;
        let mut forgotten = Vec::new();
        for image in images_of(&mut transaction, &arrival.uids).await? {
            if kept.contains(&image) {
                continue;
            }
            transaction
                .execute(
                    "DELETE FROM arrival_instances WHERE sop_instance_uid = $1
                     AND arrival_id = (SELECT id FROM arrivals WHERE study_uid = $2 AND series_uid = $3)",
                    args![image.0.as_str(), arrival.uids.study.as_str(), arrival.uids.series.as_str()],
                )
                .await?;
            forgotten.push(image.1);
        }
        transaction
            .execute(
                "UPDATE arrivals SET instances = instances - $1 WHERE study_uid = $2 AND series_uid = $3",
                args![count(forgotten.len()), arrival.uids.study.as_str(), arrival.uids.series.as_str()],
            )
            .await?;
        pins::abandon(&mut transaction, forgotten, now).await?;
        transaction.commit().await
    }

    /// Makes a series of another store as it is there, and adds some of its images; `false`, and nothing has changed, if a pin is gone. A
    /// series that is here keeps its id and its images. One whose case is not here is read again.
    pub(crate) async fn write_copied_arrival(
        &self,
        arrival: &Arrival,
        images: &[NewInstance],
        pinned: &Pinned,
    ) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.store.write().await?;
        if !pins::consume(&mut transaction, pinned).await? {
            return Ok(false);
        }
        transaction
            .execute(
                "INSERT INTO arrivals (id, study_uid, series_uid, accession_number, source, state, first_at, last_at)
                 VALUES ($1, $2, $3, $4, $5, 'receiving', $6, $6)
                 ON CONFLICT (study_uid, series_uid) DO NOTHING",
                args![
                    &arrival.id, arrival.uids.study.as_str(), arrival.uids.series.as_str(),
                    arrival.accession_number.as_ref().map(AccessionNumber::as_str),
                    arrival.source.name(), now,
                ],
            )
            .await?;
        for image in images {
            write_copied_image(&mut transaction, arrival, image, now).await?;
        }
        // Without its case, it is read again.
        let case = held(&mut transaction, arrival.case).await?;
        let state = match arrival.state {
            ArrivalState::Case | ArrivalState::Layer if case.is_none() => ArrivalState::Receiving,
            state => state,
        };
        let reason = arrival.reason.as_ref().map(serde_json::to_string);
        let taken = arrival.taken.as_ref().map(serde_json::to_string);
        let refused = arrival.refused.as_ref().map(serde_json::to_string);
        transaction
            .execute(
                "UPDATE arrivals SET state = $1, reason = $2, case_id = $3, expected = $4, first_at = $5, last_at = $6,
                        label = $7, taken = $8, refused = $9, corrected = $10, ignored = $11, refused_objects = $12,
                        last_refusal = $13
                 WHERE study_uid = $14 AND series_uid = $15",
                args![
                    state.name(), reason.transpose()?, case, arrival.expected.map(count),
                    arrival.first_at.as_microsecond(), arrival.last_at.as_microsecond(), &arrival.label,
                    taken.transpose()?, refused.transpose()?, count(arrival.corrected),
                    count(arrival.ignored), count(arrival.refused_objects), &arrival.last_refusal,
                    arrival.uids.study.as_str(), arrival.uids.series.as_str(),
                ],
            )
            .await?;
        transaction.commit().await?;
        Ok(true)
    }
}

/// Adds an image, and the cases that may have closed or opened by it. The pin of a file that is kept becomes a reference; that of another
/// one expires.
async fn add(
    connection: &mut Connection,
    source: ArrivalSource,
    new: &NewInstance,
    now: i64,
    changed: &mut Vec<CaseId>,
) -> Result<Reception, StoreError> {
    let (arrived, has_returned) = images::arrive(connection, new, source, now, changed).await?;
    if arrived == Arrived::Following(Following::Unusable) {
        pins::abandon(connection, vec![ObjectName::from(new)], now).await?;
        return Ok(Reception::Refused);
    }
    let is_another = arrived == Arrived::Following(Following::Another);
    if is_another {
        leave_others(connection, new, now).await?;
    }
    let id = series(connection, source, new, now).await?;
    let added = connection
        .execute(
            "INSERT INTO arrival_instances (arrival_id, sop_instance_uid, digest) VALUES ($1, $2, $3)
             ON CONFLICT DO NOTHING",
            args![&id, new.sop_instance_uid.as_str(), new.digest.to_string()],
        )
        .await?;
    if added == 0 && !is_another {
        pins::abandon(connection, vec![ObjectName::from(new)], now).await?;
        if has_returned {
            read_again(connection, &id, std::slice::from_ref(&new.sop_instance_uid)).await?;
        }
        came_again(connection, &id, now).await?;
        return Ok(Reception::Known);
    }
    if added == 0 {
        replace(connection, &id, new, now).await?;
    }
    // Whoever reads the series at this moment does not know this image.
    jobs::cancel(connection, SERIES, &id).await?;
    let sql = match is_another {
        // A series that was complete has more images than its sender has stated.
        false => {
            "UPDATE arrivals SET expected = CASE WHEN instances >= expected THEN NULL ELSE expected END,
                    instances = instances + $1, state = 'receiving', reason = NULL, last_at = $2
             WHERE id = $3"
        }
        // The number of images does not tell when the last one of them is corrected.
        true => {
            "UPDATE arrivals SET corrected = CASE WHEN state = 'receiving' THEN corrected + 1 ELSE 1 END, expected = NULL,
                    instances = instances + $1, state = 'receiving', reason = NULL, case_id = NULL, last_at = $2
             WHERE id = $3"
        }
    };
    connection
        .execute(sql, args![i64::from(added > 0), now, &id])
        .await?;
    Ok(match is_another {
        true => Reception::Corrected,
        false => Reception::New,
    })
}

/// A pattern for the reason of an arrival of which everything was refused.
fn of_all_refused() -> String {
    format!("%\"{ALL_REFUSED}\"%")
}

/// Counts an object that is refused. Of the series of which nothing else has come, only the newest are kept, so that no sender makes rows
/// without end.
async fn refuse(
    connection: &mut Connection,
    uids: &SeriesUids,
    source: ArrivalSource,
    refusal: &Refusal,
    now: i64,
) -> Result<(), StoreError> {
    let detail = "nothing of the series could be stored; `last_refusal` states why";
    let reason = serde_json::to_string(&Failure::unusable(ALL_REFUSED, detail))?;
    let id = new_id();
    let row = connection
        .fetch_one(
            "INSERT INTO arrivals (id, study_uid, series_uid, source, state, reason, refused_objects, last_refusal, first_at, last_at)
             VALUES ($1, $2, $3, $4, 'nothing', $5, 1, $6, $7, $7)
             ON CONFLICT (study_uid, series_uid)
             DO UPDATE SET refused_objects = arrivals.refused_objects + 1, last_refusal = excluded.last_refusal
             RETURNING id",
            args![
                &id, uids.study.as_str(), uids.series.as_str(), source.name(), reason,
                &*refusal.why, now,
            ],
        )
        .await?;
    if row.get::<String>("id")? == id {
        connection
            .execute(
                "DELETE FROM arrivals WHERE instances = 0 AND reason LIKE $1
                 AND id NOT IN (SELECT id FROM arrivals WHERE instances = 0 AND reason LIKE $1
                                ORDER BY first_at DESC, id DESC LIMIT $2)",
                args![of_all_refused(), count(MOST_ALL_REFUSED)],
            )
            .await?;
    }
    Ok(())
}

/// Notes that an image of a series came again unchanged. A series that waits for that is read again, and so is one that is a case: from
/// then on, its images have not come again.
async fn came_again(connection: &mut Connection, id: &str, now: i64) -> Result<(), StoreError> {
    jobs::cancel(connection, SERIES, id).await?;
    let waits = |name: &str| format!("%\"{name}\"%");
    connection
        .execute(
            "UPDATE arrivals SET last_at = $1,
                    state = CASE WHEN state = 'case' OR state = 'nothing' AND (reason LIKE $2 OR reason LIKE $3)
                                 THEN 'receiving' ELSE state END,
                    reason = CASE WHEN state = 'nothing' AND (reason LIKE $2 OR reason LIKE $3) THEN NULL ELSE reason END
             WHERE id = $4",
            args![now, waits(INCOMPLETE_CORRECTION), waits(IMAGES_LOST), id],
        )
        .await?;
    Ok(())
}

/// Removes an image from other series, in which it was known before its study or series was corrected. What is left of them is read
/// again.
async fn leave_others(
    connection: &mut Connection,
    new: &NewInstance,
    now: i64,
) -> Result<(), StoreError> {
    let rows = connection
        .fetch_all(
            "DELETE FROM arrival_instances WHERE sop_instance_uid = $1 AND arrival_id NOT IN
                 (SELECT id FROM arrivals WHERE study_uid = $2 AND series_uid = $3)
             RETURNING arrival_id, digest",
            args![
                new.sop_instance_uid.as_str(),
                new.uids.study.as_str(),
                new.uids.series.as_str()
            ],
        )
        .await?;
    for row in &rows {
        let other: String = row.get("arrival_id")?;
        pins::abandon(connection, vec![read_object(row)?], now).await?;
        let detail = "the images of the series have come again under another study or series";
        let moved = serde_json::to_string(&Failure::unusable(MOVED, detail))?;
        connection
            .execute(
                "UPDATE arrivals SET corrected = CASE WHEN state = 'receiving' THEN corrected + 1 ELSE 1 END,
                        instances = instances - 1, expected = NULL, last_at = $1, case_id = NULL,
                        state = CASE WHEN instances > 1 THEN 'receiving' ELSE 'nothing' END,
                        reason = CASE WHEN instances > 1 THEN NULL ELSE $2 END
                 WHERE id = $3",
                args![now, moved, &other],
            )
            .await?;
        jobs::cancel(connection, SERIES, &other).await?;
    }
    Ok(())
}

/// Puts the file of an image in the place of that of another one, with what its series is called by now.
async fn replace(
    connection: &mut Connection,
    id: &str,
    new: &NewInstance,
    now: i64,
) -> Result<(), StoreError> {
    let row = connection
        .fetch_one(
            "SELECT digest FROM arrival_instances WHERE arrival_id = $1 AND sop_instance_uid = $2",
            args![id, new.sop_instance_uid.as_str()],
        )
        .await?;
    let old = read_object(&row)?;
    connection
        .execute(
            "UPDATE arrival_instances SET digest = $1 WHERE arrival_id = $2 AND sop_instance_uid = $3",
            args![new.digest.to_string(), id, new.sop_instance_uid.as_str()],
        )
        .await?;
    pins::abandon(connection, vec![old], now).await?;
    connection
        .execute(
            "UPDATE arrivals SET accession_number = $1, label = $2 WHERE id = $3",
            args![
                new.accession_number.as_ref().map(AccessionNumber::as_str),
                &new.label,
                id
            ],
        )
        .await?;
    Ok(())
}

/// Lets a series be read again that has any of these images; how many of them it has.
async fn read_again(
    connection: &mut Connection,
    id: &str,
    instances: &[Uid],
) -> Result<usize, StoreError> {
    let mut here = 0;
    for instance in instances {
        let row = connection
            .fetch_optional(
                "SELECT 1 FROM arrival_instances WHERE arrival_id = $1 AND sop_instance_uid = $2",
                args![id, instance.as_str()],
            )
            .await?;
        here += usize::from(row.is_some());
    }
    if here > 0 {
        connection
            .execute(
                "UPDATE arrivals SET expected = NULL, case_id = NULL, state = 'receiving', reason = NULL WHERE id = $1",
                args![id],
            )
            .await?;
        jobs::cancel(connection, SERIES, id).await?;
    }
    Ok(here)
}

/// The arrival of an image's series, which is made if there is none.
async fn series(
    connection: &mut Connection,
    source: ArrivalSource,
    new: &NewInstance,
    now: i64,
) -> Result<String, StoreError> {
    connection
        .execute(
            "INSERT INTO arrivals (id, study_uid, series_uid, accession_number, source, label, state, first_at, last_at)
             VALUES ($1, $2, $3, $4, $5, $6, 'receiving', $7, $7)
             ON CONFLICT (study_uid, series_uid)
             DO UPDATE SET label = coalesce(arrivals.label, excluded.label),
                           accession_number = coalesce(arrivals.accession_number, excluded.accession_number),
                           source = CASE WHEN arrivals.reason LIKE $8 THEN excluded.source ELSE arrivals.source END,
                           first_at = CASE WHEN arrivals.reason LIKE $8 THEN excluded.first_at ELSE arrivals.first_at END",
            args![
                new_id(), new.uids.study.as_str(), new.uids.series.as_str(),
                new.accession_number.as_ref().map(AccessionNumber::as_str), source.name(),
                &new.label, now, of_all_refused(),
            ],
        )
        .await?;
    let row = connection
        .fetch_one(
            "SELECT id FROM arrivals WHERE study_uid = $1 AND series_uid = $2",
            args![new.uids.study.as_str(), new.uids.series.as_str()],
        )
        .await?;
    row.get("id")
}

/// Adds the file of an image of another store, or puts it in the place of the one that is here. What the image is was copied before.
async fn write_copied_image(
    connection: &mut Connection,
    arrival: &Arrival,
    image: &NewInstance,
    now: i64,
) -> Result<(), StoreError> {
    let id = series(connection, arrival.source, image, now).await?;
    let added = connection
        .execute(
            "INSERT INTO arrival_instances (arrival_id, sop_instance_uid, digest) VALUES ($1, $2, $3)
             ON CONFLICT DO NOTHING",
            args![&id, image.sop_instance_uid.as_str(), image.digest.to_string()],
        )
        .await?;
    if added == 0 {
        return replace(connection, &id, image, now).await;
    }
    connection
        .execute(
            "UPDATE arrivals SET instances = instances + 1 WHERE id = $1",
            args![&id],
        )
        .await?;
    Ok(())
}

/// The text of a case's id, if it is here.
async fn held(
    connection: &mut Connection,
    case: Option<CaseId>,
) -> Result<Option<String>, StoreError> {
    match case {
        Some(case) if connection.has_case(&case.to_string()).await? => Ok(Some(case.to_string())),
        _ => Ok(None),
    }
}

/// The series that are due and have no job yet. One whose announced images have all come waits no longer.
async fn due(
    connection: &mut Connection,
    terms: &DueTerms,
    now: i64,
) -> Result<Vec<String>, StoreError> {
    let rows = connection
        .fetch_all(
            "SELECT id FROM arrivals
             WHERE state = 'receiving'
               AND (instances >= expected OR last_at <= $1 AND expected IS NULL OR last_at <= $2)
               AND NOT EXISTS (SELECT 1 FROM jobs WHERE jobs.kind = 'series' AND jobs.key = arrivals.id
                               AND jobs.state IN ('queued', 'running'))
             ORDER BY last_at, id",
            args![now - microseconds(terms.stable), now - microseconds(terms.patience)],
        )
        .await?;
    rows.iter().map(|row| row.get("id")).collect()
}

/// The images of a series that are not rejected, by UID.
async fn due_images(connection: &mut Connection, id: &str) -> Result<Vec<DueImage>, StoreError> {
    let rows = connection
        .fetch_all(
            "SELECT arrival_instances.sop_instance_uid, digest, times
             FROM arrival_instances JOIN images ON images.sop_instance_uid = arrival_instances.sop_instance_uid
             WHERE arrival_id = $1
               AND NOT EXISTS (SELECT 1 FROM rejections
                               WHERE rejections.sop_instance_uid = images.sop_instance_uid
                                 AND rejections.study_uid = images.study_uid AND rejections.series_uid = images.series_uid)
             ORDER BY arrival_instances.sop_instance_uid",
            args![id],
        )
        .await?;
    let read_image = |row: &Row| {
        Ok::<_, StoreError>(DueImage {
            uid: read_uid(row, "sop_instance_uid")?,
            object: read_object(row)?,
            times: row.get::<i64>("times")?.unsigned_abs(),
        })
    };
    rows.iter().map(read_image).collect()
}

async fn objects(connection: &mut Connection, id: &str) -> Result<Vec<ObjectName>, StoreError> {
    let rows = connection
        .fetch_all(
            "SELECT digest FROM arrival_instances WHERE arrival_id = $1 ORDER BY sop_instance_uid",
            args![id],
        )
        .await?;
    rows.iter().map(read_object).collect()
}

fn read_object(row: &Row) -> Result<ObjectName, StoreError> {
    Ok(ObjectName {
        kind: ObjectKind::Instance,
        digest: read_digest(row)?,
    })
}

/// Notes what became of a series; `false` if its case is gone.
async fn settle(
    connection: &mut Connection,
    id: &str,
    outcome: &Outcome,
) -> Result<bool, StoreError> {
    let (state, case, reason) = match outcome {
        Outcome::Case(case) => (ArrivalState::Case, case.to_string(), None),
        Outcome::Layer(case) => {
            let detail = "the series became a layer of the case of its study";
            let reason = Failure::unusable(BECAME_LAYER, detail);
            let reason = serde_json::to_string(&reason)?;
            (ArrivalState::Layer, case.to_string(), Some(reason))
        }
        Outcome::Nothing(failure) => {
            make_nothing(connection, id, failure).await?;
            return Ok(true);
        }
    };
    if !connection.has_case(&case).await? {
        return Ok(false);
    }
    connection
        .execute(
            "UPDATE arrivals SET state = $4, reason = $1, case_id = $2 WHERE id = $3",
            args![reason, &case, id, state.name()],
        )
        .await?;
    if let Outcome::Case(_) = outcome {
        wake_others(connection, id).await?;
    }
    // It may have closed since it was read.
    wake_layers_of_closed(connection, &case).await?;
    Ok(true)
}

/// Notes that a series became nothing. After late images it is still the case that it was before.
pub(super) async fn make_nothing(
    connection: &mut Connection,
    id: &str,
    failure: &Failure,
) -> Result<(), StoreError> {
    connection
        .execute(
            "UPDATE arrivals SET state = $1, reason = $2 WHERE id = $3",
            args![
                ArrivalState::Nothing.name(),
                serde_json::to_string(failure)?,
                id
            ],
        )
        .await?;
    Ok(())
}

/// Lets the other series of a study be read again that may become layers now that there is a case, also those that were taken as
/// layers.
async fn wake_others(connection: &mut Connection, id: &str) -> Result<(), StoreError> {
    connection
        .execute(
            "UPDATE arrivals SET state = 'receiving', reason = NULL
             WHERE id <> $1 AND state = 'nothing' AND (reason LIKE $2 OR reason LIKE $3)
               AND study_uid = (SELECT study_uid FROM arrivals WHERE id = $1)",
            args![id, format!("%\"{NOT_T1}\"%"), format!("%\"{NO_CASE}\"%")],
        )
        .await?;
    Ok(())
}

async fn images_of(
    connection: &mut Connection,
    uids: &SeriesUids,
) -> Result<Vec<(Uid, ObjectName)>, StoreError> {
    let rows = connection
        .fetch_all(
            "SELECT sop_instance_uid, digest FROM arrival_instances JOIN arrivals ON arrivals.id = arrival_id
             WHERE study_uid = $1 AND series_uid = $2 ORDER BY sop_instance_uid",
            args![uids.study.as_str(), uids.series.as_str()],
        )
        .await?;
    let read = |row: &Row| Ok((read_uid(row, "sop_instance_uid")?, read_object(row)?));
    rows.iter().map(read).collect()
}

/// Removes settled series for which nothing has come since a time.
pub(super) async fn forget(
    connection: &mut Connection,
    before: i64,
    now: i64,
) -> Result<usize, StoreError> {
    let rows = connection
        .fetch_all(
            "SELECT id FROM arrivals WHERE state <> 'receiving' AND last_at <= $1",
            args![before],
        )
        .await?;
    for row in &rows {
        remove(connection, &row.get::<String>("id")?, now).await?;
    }
    Ok(rows.len())
}

/// Removes the series that a case came from, and those that are its layers, so that nothing of the patient stays. A series whose
/// images have changed since, or that is read again, stays: what was acknowledged is not of this case, or not of it alone.
pub(super) async fn remove_of_case(
    connection: &mut Connection,
    case: &CaseId,
    now: i64,
) -> Result<(), StoreError> {
    let rows = connection
        .fetch_all(
            "SELECT id FROM arrivals WHERE case_id = $1 AND state IN ('case', 'layer')",
            args![case.to_string()],
        )
        .await?;
    for row in &rows {
        remove(connection, &row.get::<String>("id")?, now).await?;
    }
    // A correction of it waits for nothing any more.
    connection
        .execute(
            "UPDATE arrivals SET state = 'receiving', reason = NULL
             WHERE state = 'nothing' AND reason LIKE $2
               AND id IN (SELECT arrival_id FROM arrival_instances
                          JOIN made_of ON made_of.sop_instance_uid = arrival_instances.sop_instance_uid
                          WHERE case_id = $1 AND layer_id = '' AND result_id = '')",
            args![case.to_string(), format!("%\"{INCOMPLETE_CORRECTION}\"%")],
        )
        .await?;
    Ok(())
}

async fn remove(connection: &mut Connection, id: &str, now: i64) -> Result<(), StoreError> {
    let images = objects(connection, id).await?;
    pins::abandon(connection, images, now).await?;
    jobs::remove(connection, id).await?;
    // Its images go with it (ON DELETE CASCADE).
    connection
        .execute("DELETE FROM arrivals WHERE id = $1", args![id])
        .await?;
    Ok(())
}

fn read_reason(row: &Row) -> Result<Option<Failure>, StoreError> {
    read_failure(row, "reason")
}

fn read_failure(row: &Row, column: &str) -> Result<Option<Failure>, StoreError> {
    let text: Option<String> = row.get(column)?;
    Ok(text.as_deref().map(serde_json::from_str).transpose()?)
}

fn read_taken(row: &Row) -> Result<Option<Taken>, StoreError> {
    let text: Option<String> = row.get("taken")?;
    Ok(text.as_deref().map(serde_json::from_str).transpose()?)
}

fn read(row: &Row) -> Result<Arrival, StoreError> {
    let [source, state]: [String; 2] = [row.get("source")?, row.get("state")?];
    let expected: Option<i64> = row.get("expected")?;
    Ok(Arrival {
        id: row.get("id")?,
        uids: read_uids(row)?,
        accession_number: read_accession_number(row)?,
        source: ArrivalSource::from_name(&source).ok_or_else(|| unreadable("a source"))?,
        label: row.get("label")?,
        state: ArrivalState::from_name(&state).ok_or_else(|| unreadable("a state"))?,
        reason: read_reason(row)?,
        taken: read_taken(row)?,
        refused: read_failure(row, "refused")?,
        case: read_case(row, "case_id")?,
        instances: read_count(row.get("instances")?),
        expected: expected.map(read_count),
        corrected: read_count(row.get("corrected")?),
        ignored: read_count(row.get("ignored")?),
        refused_objects: read_count(row.get("refused_objects")?),
        last_refusal: row.get("last_refusal")?,
        first_at: read_time(row, "first_at")?,
        last_at: read_time(row, "last_at")?,
    })
}
