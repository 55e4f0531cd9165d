//! Results that are sent to a node.

use super::arrivals::{count, name_of, read_time, superseded_code, unreadable};
use super::connection::{Connection, Row};
use super::{jobs, pins};
use crate::arrivals::{ArrivalCursor, Superseded, TransferQuery, Uid};
use crate::jobs::{Job, NewJob};
use crate::results::{HeldResult, NewResult, ResultSeries, SentResult, object};
use crate::{ObjectName, StoreError};
use case::{CaseId, Failure, JobKind, JobState, Project};

/// Columns that `read` understands. `WHERE` and what follows may come after.
macro_rules! select_result {
    ($rest:literal) => {
        concat!(
            "SELECT id, case_id, node, study_uid, sop_instance_uid, sop_class_uid, series_uid, series_number,
                    series_description, digest, created_at FROM results ",
            $rest
        )
    };
}

/// A new result, or the one that is known already; it waits to be sent, unless it is on its way.
pub(super) async fn queue(
    connection: &mut Connection,
    new: &NewResult,
    job: JobKind,
    now: i64,
) -> Result<SentResult, StoreError> {
    let id = insert(connection, new, now).await?;
    let job = NewJob {
        case: Some(new.case),
        ..NewJob::new(job, id.clone())
    };
    jobs::enqueue(connection, &job, now).await?;
    let queued = one(connection, &id).await?;
    let queued = queued.ok_or_else(|| unreadable("id"))?;
    if queued.object != new.object() {
        pins::abandon(connection, vec![new.object()], now).await?;
    }
    Ok(queued)
}

/// Ends the jobs that send results of a case, with a reason.
pub(super) async fn fail_waiting(
    connection: &mut Connection,
    case: &CaseId,
    failure: &Failure,
    now: i64,
) -> Result<(), StoreError> {
    connection
        .query(
            "UPDATE jobs SET state = 'failed', failure = $1, ended_at = $2, fence = 0, lease_until = NULL
             WHERE case_id = $3 AND key IN (SELECT id FROM results WHERE case_id = $3) AND state IN ('queued', 'running')",
        )
        .bind(serde_json::to_string(failure)?)
        .bind(now)
        .bind(case.key())
        .execute()
        .await?;
    Ok(())
}

/// Writes the row of a result, unless it is there; returns its id.
async fn insert(
    connection: &mut Connection,
    new: &NewResult,
    now: i64,
) -> Result<String, StoreError> {
    connection
        .query(
            "INSERT INTO results (id, case_id, node, study_uid, sop_instance_uid, digest, created_at,
                                  sop_class_uid, series_uid, series_number, series_description, project)
             VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, $12)
             ON CONFLICT (sop_instance_uid, node, project) DO NOTHING",
        )
        .bind(uuid::Uuid::now_v7().simple().to_string())
        .bind(new.case.key())
        .bind(&new.node)
        .bind(new.study.as_str())
        .bind(new.instance.as_str())
        .bind(new.digest.to_string())
        .bind(now)
        .bind(new.series.sop_class_uid.as_str())
        .bind(new.series.series_uid.as_str())
        .bind(i64::from(new.series.number))
        .bind(&new.series.description)
        .bind(new.case.project().name())
        .execute()
        .await?;
    let row = connection
        .query("SELECT id FROM results WHERE sop_instance_uid = $1 AND node = $2 AND project = $3")
        .bind(new.instance.as_str())
        .bind(&new.node)
        .bind(new.case.project().name())
        .fetch_one()
        .await?;
    row.get("id")
}

/// Makes a result of another store, whose case is here, as it is there, with its job. One that is here keeps its object.
pub(super) async fn adopt(
    connection: &mut Connection,
    result: &SentResult,
    now: i64,
) -> Result<(), StoreError> {
    let new = NewResult {
        case: result.case,
        node: result.node.clone(),
        study: result.study.clone(),
        series: result.series.clone(),
        instance: result.instance.clone(),
        digest: result.object.digest,
    };
    let known = insert(connection, &new, now).await?;
    jobs::remove(connection, &known).await?;
    connection
        .query("UPDATE results SET id = $1, created_at = $2 WHERE id = $3")
        .bind(&result.id)
        .bind(result.created_at.as_microsecond())
        .bind(known)
        .execute()
        .await?;
    match &result.job {
        Some(job) => jobs::adopt(connection, job, now).await,
        None => Ok(()),
    }
}

pub(super) async fn page(
    connection: &mut Connection,
    (scope, query): (Option<Project>, &TransferQuery),
    after: Option<&ArrivalCursor>,
    limit: usize,
) -> Result<(Vec<SentResult>, Option<ArrivalCursor>), StoreError> {
    let (at, id) = match after {
        Some(cursor) => (cursor.at, cursor.id.clone()),
        None => (i64::MAX, String::new()),
    };
    let rows = connection
        .query(
            "SELECT id FROM results
             WHERE (created_at, id) < ($1, $2) AND coalesce($3, case_id) = case_id AND coalesce($6, project) = project
               AND ($4 IS NULL OR $4 = coalesce((SELECT jobs.state FROM jobs WHERE jobs.key = results.id
                                                 ORDER BY jobs.created_at DESC, jobs.id DESC LIMIT 1), 'done'))
             ORDER BY created_at DESC, id DESC LIMIT $5",
        )
        .bind(at)
        .bind(id)
        .bind(query.case.map(|case| case.key()))
        .bind(query.state.map(JobState::name))
        .bind(count(limit.saturating_add(1)))
        .bind(name_of(scope))
        .fetch_all()
        .await?;
    let mut results = Vec::with_capacity(rows.len());
    for row in &rows {
        results.extend(one(connection, &row.get::<String>("id")?).await?);
    }
    let has_more = results.len() > limit;
    results.truncate(limit);
    let last = results.last().filter(|_| has_more);
    let next = last.map(|last| ArrivalCursor {
        at: last.created_at.as_microsecond(),
        id: last.id.clone(),
    });
    Ok((results, next))
}

pub(super) async fn one(
    connection: &mut Connection,
    id: &str,
) -> Result<Option<SentResult>, StoreError> {
    let row = connection
        .query(select_result!("WHERE id = $1"))
        .bind(id)
        .fetch_optional()
        .await?;
    let Some(row) = row else {
        return Ok(None);
    };
    let job = jobs::latest_of_key(connection, id).await?;
    read(&row, job).map(Some)
}

/// Results for different nodes share one object.
pub(super) async fn of_instance(
    connection: &mut Connection,
    scope: Option<Project>,
    instance: &Uid,
) -> Result<Option<ObjectName>, StoreError> {
    let row = connection
        .query(
            "SELECT digest FROM results WHERE sop_instance_uid = $1 AND coalesce($2, project) = project
             ORDER BY created_at, id LIMIT 1",
        )
        .bind(instance.as_str())
        .bind(name_of(scope))
        .fetch_optional()
        .await?;
    row.as_ref().map(read_object).transpose()
}

/// A result that was sent to several nodes is there once.
pub(super) async fn of_study(
    connection: &mut Connection,
    scope: Option<Project>,
    study: &Uid,
    with_invalid: bool,
) -> Result<Vec<HeldResult>, StoreError> {
    let rows = connection
        .query(
            "SELECT case_id, sop_instance_uid, sop_class_uid, series_uid, series_number, series_description, digest FROM results
             WHERE study_uid = $1 AND coalesce($3, project) = project
               AND ($2 = 1 OR (sop_instance_uid, project) NOT IN (SELECT sop_instance_uid, project FROM rejections)
                              AND case_id NOT IN (SELECT case_id FROM case_series WHERE superseded >= $4))
             ORDER BY series_number, sop_instance_uid, created_at, id",
        )
        .bind(study.as_str())
        .bind(i64::from(with_invalid))
        .bind(name_of(scope))
        .bind(superseded_code(Some(Superseded::Corrected)))
        .fetch_all()
        .await?;
    let mut held = rows.iter().map(read_held).collect::<Result<Vec<_>, _>>()?;
    held.dedup_by(|later, earlier| later.instance == earlier.instance);
    Ok(held)
}

fn read_held(row: &Row) -> Result<HeldResult, StoreError> {
    Ok(HeldResult {
        case: read_case(row)?,
        instance: read_uid(row, "sop_instance_uid")?,
        series: read_series(row)?,
        object: read_object(row)?,
    })
}

fn read_series(row: &Row) -> Result<ResultSeries, StoreError> {
    let number: i64 = row.get("series_number")?;
    Ok(ResultSeries {
        sop_class_uid: read_uid(row, "sop_class_uid")?,
        series_uid: read_uid(row, "series_uid")?,
        number: u32::try_from(number).map_err(|_| unreadable("number"))?,
        description: row.get("series_description")?,
    })
}

fn read_uid(row: &Row, column: &str) -> Result<Uid, StoreError> {
    let text: String = row.get(column)?;
    Uid::parse(&text).ok_or_else(|| unreadable("UID"))
}

/// Removes results whose sending ended before a time, with their jobs, and abandons their objects.
pub(super) async fn forget(
    connection: &mut Connection,
    before: i64,
    now: i64,
) -> Result<(), StoreError> {
    let rows = connection
        .query(
            "DELETE FROM results
             WHERE created_at <= $1
               AND NOT EXISTS (SELECT 1 FROM jobs WHERE jobs.key = results.id
                               AND (jobs.ended_at IS NULL OR jobs.ended_at > $1))
             RETURNING id, digest",
        )
        .bind(before)
        .fetch_all()
        .await?;
    for row in &rows {
        jobs::remove(connection, &row.get::<String>("id")?).await?;
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
        .query("SELECT digest FROM results WHERE case_id = $1")
        .bind(case.key())
        .fetch_all()
        .await?;
    abandon(connection, &rows, now).await
}

async fn abandon(connection: &mut Connection, rows: &[Row], now: i64) -> Result<(), StoreError> {
    let objects = rows.iter().map(read_object).collect::<Result<_, _>>()?;
    pins::abandon(connection, objects, now).await
}

fn read_object(row: &Row) -> Result<ObjectName, StoreError> {
    let digest: String = row.get("digest")?;
    let digest = blake3::Hash::from_hex(digest).map_err(|_| unreadable("digest"))?;
    Ok(object(digest))
}

fn read_case(row: &Row) -> Result<CaseId, StoreError> {
    let case: String = row.get("case_id")?;
    CaseId::from_key(&case).ok_or_else(|| unreadable("case"))
}

fn read(row: &Row, job: Option<Job>) -> Result<SentResult, StoreError> {
    Ok(SentResult {
        id: row.get("id")?,
        case: read_case(row)?,
        node: row.get("node")?,
        study: read_uid(row, "study_uid")?,
        series: read_series(row)?,
        instance: read_uid(row, "sop_instance_uid")?,
        object: read_object(row)?,
        created_at: read_time(row, "created_at")?,
        job,
    })
}
