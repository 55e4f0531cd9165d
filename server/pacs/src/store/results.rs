//! Results that are sent to a node of the PACS. Each is a DICOM object that is durable before the request for it is
//! acknowledged, so every attempt sends the same bytes.

use bytes::Bytes;
use case::images::Image;
use case::series::Uid;
use case::{CaseId, Failure, JobState, LayerId};
use storage::args;
use storage::tables::{
    Connection, Referred, Row, Writing, jobs, layers, made, new_id, pins, read_case, read_closed,
    read_time, read_uid, unreadable,
};
use storage::{Cursor, Job, Made, NewJob, ObjectName, Pinned, StoreError};

use super::PacsStore;
use super::columns::{count, read_digest};
use super::images;
use crate::values::{
    NewResult, NotValid, ResultSeries, SEND, SentResult, TransferQuery, result_object,
};

/// Columns that `read` understands. `WHERE` and what follows may come after.
macro_rules! select_result {
    ($rest:literal) => {
        concat!(
            "SELECT id, case_id, node, study_uid, sop_instance_uid, sop_class_uid, series_uid,
                    digest, created_at, layers, closed,
                    (SELECT closed FROM cases WHERE cases.id = results.case_id) AS case_closed,
                    (SELECT count(*) FROM rejections WHERE rejections.sop_instance_uid = results.sop_instance_uid) AS rejected
             FROM results ",
            $rest
        )
    };
}

impl PacsStore {
    /// Keeps a result and queues the job that sends it. Afterwards it is durable. The operation completes even if the caller drops the future.
    ///
    /// # Errors
    /// If the rows or the objects cannot be written, or there is no such case.
    pub(crate) async fn queue_result(
        &self,
        new: NewResult,
        file: Bytes,
    ) -> Result<SentResult, StoreError> {
        let store = self.clone();
        tokio::spawn(async move { store.queue_result_now(&new, file).await }).await?
    }

    async fn queue_result_now(
        &self,
        new: &NewResult,
        file: Bytes,
    ) -> Result<SentResult, StoreError> {
        let spooled = self.store.spools().of(file).await?;
        let object = Writing::File(new.object(), &spooled);
        let insert = |pinned: Pinned| async move { self.insert_result(new, &pinned).await };
        let queued = self.store.with_pinned(&[object], insert).await?;
        self.store.signals().queued();
        Ok(queued)
    }

    /// Queues a result for its node, and turns the pin of its object into a reference. A result that was sent to the node
    /// before, or could not be, is sent there again with its first object; one that still waits is left as it is.
    pub(crate) async fn insert_result(
        &self,
        new: &NewResult,
        pinned: &Pinned,
    ) -> Result<Referred<SentResult>, StoreError> {
        let (mut transaction, now) = self.store.write().await?;
        if !pins::consume(&mut transaction, pinned).await? {
            return Ok(Referred::PinLost);
        }
        let here = layers::of_case(&mut transaction, &new.case).await?;
        let is_here = |id: &LayerId| here.iter().any(|layer| layer.id == *id);
        // A note rejects what it was.
        if new.series.sop_class_uid.as_str() != REJECTION_NOTE && !new.layers.iter().all(is_here) {
            return Err(StoreError::NoSuchLayer);
        }
        let id = insert(&mut transaction, new, now).await?;
        images::make_result(&mut transaction, &Made::result(&new.case, &id), &new.layers).await?;
        let job = NewJob {
            case: Some(new.case),
            ..NewJob::new(SEND, id.clone())
        };
        jobs::enqueue(&mut transaction, &job, now).await?;
        let queued = one(&mut transaction, &id).await?;
        let queued = queued.ok_or_else(|| unreadable("an id"))?;
        if queued.what.object() != new.object() {
            pins::abandon(&mut transaction, vec![new.object()], now).await?;
        }
        transaction.commit().await?;
        Ok(Referred::Done(queued))
    }

    /// Makes a result of another store as it is there, whose layers are made of these images, and turns the pin of its object into a
    /// reference; one that was on its way waits again. `false`, and nothing has changed, if the pin is gone or its case is not here.
    pub(crate) async fn write_copied_result(
        &self,
        result: &SentResult,
        made_of: &[Image],
        pinned: &Pinned,
    ) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.store.write().await?;
        if !transaction.has_case(&result.what.case.to_string()).await?
            || !pins::consume(&mut transaction, pinned).await?
        {
            return Ok(false);
        }
        let known = insert(&mut transaction, &result.what, now).await?;
        jobs::remove(&mut transaction, &known).await?;
        transaction
            .execute(
                "UPDATE results SET id = $1, created_at = $2 WHERE id = $3",
                args![&result.id, result.created_at.as_microsecond(), known],
            )
            .await?;
        let result_images = Made::result(&result.what.case, &result.id);
        made::make(&mut transaction, &result_images, made_of).await?;
        if let Some(job) = &result.job {
            jobs::write_copied(&mut transaction, job, now).await?;
        }
        transaction.commit().await?;
        Ok(true)
    }

    /// At most `limit` results after a cursor, newest first, and the cursor of the next page.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub(crate) async fn results(
        &self,
        query: &TransferQuery,
        after: Option<&Cursor>,
        limit: usize,
    ) -> Result<(Vec<SentResult>, Option<Cursor>), StoreError> {
        let mut connection = self.store.connect().await?;
        let (at, id) = Cursor::place(after);
        let rows = connection
            .fetch_all(
                "SELECT id FROM results
                 WHERE (created_at, id) < ($1, $2) AND coalesce($3, case_id) = case_id
                   AND ($4 IS NULL OR $4 = coalesce((SELECT jobs.state FROM jobs WHERE jobs.key = results.id
                                                     ORDER BY jobs.created_at DESC, jobs.id DESC LIMIT 1), 'done'))
                 ORDER BY created_at DESC, id DESC LIMIT $5",
                args![
                    at, id, query.case.map(|case| case.to_string()), query.state.map(JobState::name),
                    count(limit.saturating_add(1)),
                ],
            )
            .await?;
        let mut results = Vec::with_capacity(rows.len());
        for row in &rows {
            results.extend(one(&mut connection, &row.get::<String>("id")?).await?);
        }
        Ok(Cursor::page(results, limit, |result: &SentResult| {
            (result.created_at, result.id.clone())
        }))
    }

    /// A result.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub(crate) async fn result(&self, id: &str) -> Result<Option<SentResult>, StoreError> {
        one(&mut self.store.connect().await?, id).await
    }

    /// The object of a result that was queued before; results for different nodes share one.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub(crate) async fn object_of_result(
        &self,
        instance: &Uid,
    ) -> Result<Option<ObjectName>, StoreError> {
        let mut connection = self.store.connect().await?;
        let row = connection
            .fetch_optional(
                "SELECT digest FROM results WHERE sop_instance_uid = $1 ORDER BY created_at, id LIMIT 1",
                args![instance.as_str()],
            )
            .await?;
        row.as_ref().map(read_object).transpose()
    }

    /// The results of a study and their series, each once, the first one first. Those that do not count any more are among them.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub(crate) async fn results_of(
        &self,
        study: &Uid,
    ) -> Result<Vec<(Uid, ResultSeries)>, StoreError> {
        let mut connection = self.store.connect().await?;
        let rows = connection
            .fetch_all(
                "SELECT sop_instance_uid, sop_class_uid, series_uid FROM results WHERE study_uid = $1
                 GROUP BY sop_instance_uid, sop_class_uid, series_uid ORDER BY min(created_at), sop_instance_uid",
                args![study.as_str()],
            )
            .await?;
        let read = |row: &Row| Ok((read_uid(row, "sop_instance_uid")?, read_series(row)?));
        rows.iter().map(read).collect()
    }
}

/// Writes the row of a result, unless it is there; returns its id.
async fn insert(
    connection: &mut Connection,
    new: &NewResult,
    now: i64,
) -> Result<String, StoreError> {
    connection
        .execute(
            "INSERT INTO results (id, case_id, node, study_uid, sop_instance_uid, digest, created_at,
                                  sop_class_uid, series_uid, layers)
             VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10)
             ON CONFLICT (sop_instance_uid, node) DO NOTHING",
            args![
                new_id(), new.case.to_string(), &new.node, new.study.as_str(),
                new.instance.as_str(), new.digest.to_string(), now,
                new.series.sop_class_uid.as_str(), new.series.series_uid.as_str(),
                written(&new.layers),
            ],
        )
        .await?;
    let row = connection
        .fetch_one(
            "SELECT id FROM results WHERE sop_instance_uid = $1 AND node = $2",
            args![new.instance.as_str(), &new.node],
        )
        .await?;
    row.get("id")
}

async fn one(connection: &mut Connection, id: &str) -> Result<Option<SentResult>, StoreError> {
    let row = connection
        .fetch_optional(select_result!("WHERE id = $1"), args![id])
        .await?;
    let Some(row) = row else {
        return Ok(None);
    };
    let job = jobs::latest_of_key(connection, id).await?;
    read(&row, job).map(Some)
}

/// Why a result may not be sent any more, if so: it was withdrawn, or it or its case is closed. A rejection note may always be sent.
pub(super) async fn not_to_send(
    connection: &mut Connection,
    id: &str,
) -> Result<Option<Failure>, StoreError> {
    let result = one(connection, id).await?;
    let result =
        result.filter(|result| result.what.series.sop_class_uid.as_str() != REJECTION_NOTE);
    let why = result.and_then(|result| result.not_valid);
    Ok(why.map(|why| Failure::unusable(why.name(), why.sentence())))
}

/// The class of rejection notes, Key Object Selection, which no other result has.
pub(crate) const REJECTION_NOTE: &str = "1.2.840.10008.5.1.4.1.1.88.59";

fn read_series(row: &Row) -> Result<ResultSeries, StoreError> {
    Ok(ResultSeries {
        sop_class_uid: read_uid(row, "sop_class_uid")?,
        series_uid: read_uid(row, "series_uid")?,
    })
}

/// Removes results whose sending ended before a time, with their jobs, and abandons their objects.
pub(super) async fn forget(
    connection: &mut Connection,
    before: i64,
    now: i64,
) -> Result<(), StoreError> {
    let rows = connection
        .fetch_all(
            "DELETE FROM results
             WHERE created_at <= $1
               AND NOT EXISTS (SELECT 1 FROM jobs WHERE jobs.key = results.id
                               AND (jobs.ended_at IS NULL OR jobs.ended_at > $1))
             RETURNING id, digest, case_id",
            args![before],
        )
        .await?;
    for row in &rows {
        let id: String = row.get("id")?;
        jobs::remove(connection, &id).await?;
        made::forget(connection, &Made::result(&read_case_of(row)?, &id)).await?;
    }
    abandon(connection, &rows, now).await
}

/// Abandons the objects of the results of a case, whose rows go with it.
pub(super) async fn abandon_of_case(
    connection: &mut Connection,
    case: &CaseId,
    now: i64,
) -> Result<(), StoreError> {
    let rows = connection
        .fetch_all(
            "SELECT digest FROM results WHERE case_id = $1",
            args![case.to_string()],
        )
        .await?;
    abandon(connection, &rows, now).await
}

async fn abandon(connection: &mut Connection, rows: &[Row], now: i64) -> Result<(), StoreError> {
    let objects = rows.iter().map(read_object).collect::<Result<_, _>>()?;
    pins::abandon(connection, objects, now).await
}

fn read_object(row: &Row) -> Result<ObjectName, StoreError> {
    read_digest(row).map(result_object)
}

fn read_case_of(row: &Row) -> Result<CaseId, StoreError> {
    read_case(row, "case_id")?.ok_or_else(|| unreadable("a case"))
}

/// The ids of layers, as a column has them.
fn written(layers: &[LayerId]) -> String {
    let ids: Vec<_> = layers.iter().map(LayerId::to_string).collect();
    ids.join(" ")
}

/// What a column has between spaces.
fn read_each<T>(
    row: &Row,
    column: &'static str,
    parse: impl Fn(&str) -> Option<T>,
) -> Result<Vec<T>, StoreError> {
    let words: String = row.get(column)?;
    let words = words.split_whitespace();
    words
        .map(|word| parse(word).ok_or_else(|| unreadable(column)))
        .collect()
}

fn read_not_valid(row: &Row) -> Result<Option<NotValid>, StoreError> {
    if row.get::<i64>("rejected")? > 0 {
        return Ok(Some(NotValid::Withdrawn));
    }
    let of_layers = read_closed(row, "closed")?;
    let of_case = read_closed(row, "case_closed")?;
    Ok(of_case.or(of_layers).map(NotValid::Closed))
}

fn read(row: &Row, job: Option<Job>) -> Result<SentResult, StoreError> {
    Ok(SentResult {
        id: row.get("id")?,
        what: NewResult {
            case: read_case_of(row)?,
            node: row.get("node")?,
            study: read_uid(row, "study_uid")?,
            series: read_series(row)?,
            instance: read_uid(row, "sop_instance_uid")?,
            layers: read_each(row, "layers", LayerId::parse)?,
            digest: read_digest(row)?,
        },
        created_at: read_time(row, "created_at")?,
        not_valid: read_not_valid(row)?,
        job,
    })
}
