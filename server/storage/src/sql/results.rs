//! Results that are sent to a node.

use super::arrivals::{count, read_count, read_time, superseded_code, unreadable};
use super::connection::{Connection, Row};
use super::{jobs, layers, pins};
use crate::arrivals::{ArrivalCursor, Superseded, TransferQuery, Uid};
use crate::jobs::{Job, NewJob};
use crate::results::{NewResult, NotValid, ResultSeries, SentResult, object};
use crate::{ObjectName, StoreError};
use case::{CaseId, Failure, JobKind, JobState, LayerId};

/// Columns that `read` understands. `WHERE` and what follows may come after.
macro_rules! select_result {
    ($rest:literal) => {
        concat!(
            "SELECT id, case_id, node, study_uid, sop_instance_uid, sop_class_uid, series_uid,
                    digest, created_at, layers, layer_series, layer_withdrawn,
                    (SELECT superseded FROM case_series WHERE case_series.case_id = results.case_id) AS superseded,
                    (SELECT count(*) FROM rejections WHERE rejections.sop_instance_uid = results.sop_instance_uid) AS rejected
             FROM results ",
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
    let mut series = Vec::new();
    for layer in &new.layers {
        series.extend(layers::series_of(connection, &new.case, layer).await?);
    }
    let id = insert(connection, new, &series, now).await?;
    // A layer may have been withdrawn while the result was drawn, and may have come back since it was first requested.
    let are_there = layers::are_there(connection, &new.case, &new.layers).await?;
    note_layers(connection, new, !are_there).await?;
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

/// Notes whether a layer that a result shows was withdrawn, for all nodes.
async fn note_layers(
    connection: &mut Connection,
    result: &NewResult,
    is_withdrawn: bool,
) -> Result<(), StoreError> {
    connection
        .query("UPDATE results SET layer_withdrawn = $1 WHERE sop_instance_uid = $2")
        .bind(i64::from(is_withdrawn))
        .bind(result.instance.as_str())
        .execute()
        .await?;
    Ok(())
}

/// What a result shows, or may show.
#[derive(Debug, Clone, Copy)]
pub(super) enum Shown<'a> {
    /// A layer of a case.
    Layer(&'a CaseId, &'a LayerId),
    /// Any layer that is or was made of a series.
    Series(&'a Uid),
}

/// Notes that a layer was withdrawn, and ends the jobs that send results that may show it, with a reason. Returns how many have
/// been sent and were valid.
pub(super) async fn withdraw_showing(
    connection: &mut Connection,
    shown: Shown<'_>,
    failure: &Failure,
    now: i64,
) -> Result<usize, StoreError> {
    // Neither an id nor a UID is ever a part of the other column.
    let (case, pattern) = match shown {
        Shown::Layer(case, layer) => (Some(case.to_string()), format!("%{layer}%")),
        Shown::Series(series) => (None, format!("% {} %", series.as_str())),
    };
    let row = connection
        .query(
            "SELECT count(*) AS sent FROM results
             WHERE coalesce($1, case_id) = case_id AND (layers LIKE $2 OR layer_series LIKE $2)
               AND layer_withdrawn = 0
               AND 'done' = coalesce((SELECT jobs.state FROM jobs WHERE jobs.key = results.id
                                      ORDER BY jobs.created_at DESC, jobs.id DESC LIMIT 1), 'done')",
        )
        .bind(case.clone())
        .bind(&pattern)
        .fetch_one()
        .await?;
    let sent = row.get("sent").map(read_count)?;
    connection
        .query(
            "UPDATE results SET layer_withdrawn = 1
             WHERE coalesce($1, case_id) = case_id AND (layers LIKE $2 OR layer_series LIKE $2)",
        )
        .bind(case.clone())
        .bind(&pattern)
        .execute()
        .await?;
    connection
        .query(
            "UPDATE jobs SET state = 'failed', failure = $1, ended_at = $2, fence = 0, lease_until = NULL
             WHERE state IN ('queued', 'running') AND key IN (
                 SELECT id FROM results
                 WHERE coalesce($3, case_id) = case_id AND (layers LIKE $4 OR layer_series LIKE $4))",
        )
        .bind(serde_json::to_string(failure)?)
        .bind(now)
        .bind(case)
        .bind(&pattern)
        .execute()
        .await?;
    Ok(sent)
}

/// Writes the row of a result, unless it is there; returns its id.
async fn insert(
    connection: &mut Connection,
    new: &NewResult,
    series: &[Uid],
    now: i64,
) -> Result<String, StoreError> {
    connection
        .query(
            "INSERT INTO results (id, case_id, node, study_uid, sop_instance_uid, digest, created_at,
                                  sop_class_uid, series_uid, layers, layer_series)
             VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11)
             ON CONFLICT (sop_instance_uid, node) DO NOTHING",
        )
        .bind(uuid::Uuid::now_v7().simple().to_string())
        .bind(new.case.to_string())
        .bind(&new.node)
        .bind(new.study.as_str())
        .bind(new.instance.as_str())
        .bind(new.digest.to_string())
        .bind(now)
        .bind(new.series.sop_class_uid.as_str())
        .bind(new.series.series_uid.as_str())
        .bind(written(&new.layers))
        .bind(written_series(series))
        .execute()
        .await?;
    let row = connection
        .query("SELECT id FROM results WHERE sop_instance_uid = $1 AND node = $2")
        .bind(new.instance.as_str())
        .bind(&new.node)
        .fetch_one()
        .await?;
    row.get("id")
}

/// Makes a result of another store, whose case is here, as it is there, with its job. One that is here keeps its object.
pub(super) async fn write_copied(
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
        layers: result.layers.clone(),
        digest: result.object.digest,
    };
    let known = insert(connection, &new, &result.layer_series, now).await?;
    let is_withdrawn = result.not_valid == Some(NotValid::LayerWithdrawn);
    note_layers(connection, &new, is_withdrawn).await?;
    jobs::remove(connection, &known).await?;
    connection
        .query("UPDATE results SET id = $1, created_at = $2 WHERE id = $3")
        .bind(&result.id)
        .bind(result.created_at.as_microsecond())
        .bind(known)
        .execute()
        .await?;
    match &result.job {
        Some(job) => jobs::write_copied(connection, job, now).await,
        None => Ok(()),
    }
}

pub(super) async fn page(
    connection: &mut Connection,
    query: &TransferQuery,
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
             WHERE (created_at, id) < ($1, $2) AND coalesce($3, case_id) = case_id
               AND ($4 IS NULL OR $4 = coalesce((SELECT jobs.state FROM jobs WHERE jobs.key = results.id
                                                 ORDER BY jobs.created_at DESC, jobs.id DESC LIMIT 1), 'done'))
             ORDER BY created_at DESC, id DESC LIMIT $5",
        )
        .bind(at)
        .bind(id)
        .bind(query.case.map(|case| case.to_string()))
        .bind(query.state.map(JobState::name))
        .bind(count(limit.saturating_add(1)))
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
    instance: &Uid,
) -> Result<Option<ObjectName>, StoreError> {
    let row = connection
        .query(
            "SELECT digest FROM results WHERE sop_instance_uid = $1 ORDER BY created_at, id LIMIT 1",
        )
        .bind(instance.as_str())
        .fetch_optional()
        .await?;
    row.as_ref().map(read_object).transpose()
}

/// A result that was sent to several nodes is there once.
pub(super) async fn of_study(
    connection: &mut Connection,
    study: &Uid,
) -> Result<Vec<(Uid, ResultSeries)>, StoreError> {
    let rows = connection
        .query(
            "SELECT sop_instance_uid, sop_class_uid, series_uid FROM results WHERE study_uid = $1
             GROUP BY sop_instance_uid, sop_class_uid, series_uid ORDER BY min(created_at), sop_instance_uid",
        )
        .bind(study.as_str())
        .fetch_all()
        .await?;
    let read = |row: &Row| Ok((read_uid(row, "sop_instance_uid")?, read_series(row)?));
    rows.iter().map(read).collect()
}

fn read_series(row: &Row) -> Result<ResultSeries, StoreError> {
    Ok(ResultSeries {
        sop_class_uid: read_uid(row, "sop_class_uid")?,
        series_uid: read_uid(row, "series_uid")?,
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
        .bind(case.to_string())
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
    CaseId::parse(&case).ok_or_else(|| unreadable("case"))
}

/// The ids of layers, as a column has them.
fn written(layers: &[LayerId]) -> String {
    let ids: Vec<_> = layers.iter().map(LayerId::to_string).collect();
    ids.join(" ")
}

/// Series, as a column has them: a space before and after each.
fn written_series(series: &[Uid]) -> String {
    let spaced = series.iter().map(|uid| format!(" {}", uid.as_str()));
    spaced.chain([" ".to_owned()]).collect()
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
    let superseded: Option<i64> = row.get("superseded")?;
    let is_final = superseded.unwrap_or(0) >= superseded_code(Some(Superseded::Corrected));
    let reasons = [
        (row.get::<i64>("rejected")? > 0, NotValid::Withdrawn),
        (
            row.get::<i64>("layer_withdrawn")? > 0,
            NotValid::LayerWithdrawn,
        ),
        (is_final, NotValid::Superseded),
    ];
    let reason = reasons.into_iter().find(|(is_true, _)| *is_true);
    Ok(reason.map(|(_, reason)| reason))
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
        layers: read_each(row, "layers", LayerId::parse)?,
        layer_series: read_each(row, "layer_series", Uid::parse)?,
        created_at: read_time(row, "created_at")?,
        not_valid: read_not_valid(row)?,
        job,
    })
}
