//! Results that are sent to a node.

use super::arrivals::{count, read_reason, read_time, unreadable};
use super::connection::{Connection, Row};
use super::transfers::AfterAttempt;
use super::{fence, pins};
use crate::arrivals::{ArrivalCursor, TransferEnd, TransferQuery, TransferState, Uid};
use crate::results::{HeldResult, NewResult, ResultSeries, SentResult, object};
use crate::{ObjectName, StoreError};
use case::CaseId;

/// Columns that `read` understands. `WHERE` and what follows may come after.
macro_rules! select_result {
    ($rest:literal) => {
        concat!(
            "SELECT id, case_id, node, study_uid, sop_instance_uid, sop_class_uid, series_uid, series_number,
                    series_description, digest, state, reason, created_at, fence, attempts
             FROM results ",
            $rest
        )
    };
}

/// A new result, or the one that is known already, which waits again unless it is on its way.
pub(super) async fn queue(
    connection: &mut Connection,
    new: &NewResult,
    now: i64,
) -> Result<SentResult, StoreError> {
    connection
        .query(
            "INSERT INTO results (id, case_id, node, study_uid, sop_instance_uid, digest, state, created_at, available_at,
                                  sop_class_uid, series_uid, series_number, series_description)
             VALUES ($1, $2, $3, $4, $5, $6, 'queued', $7, $7, $8, $9, $10, $11)
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
        .bind(i64::from(new.series.number))
        .bind(&new.series.description)
        .execute()
        .await?;
    connection
        .query(
            "UPDATE results SET state = 'queued', reason = NULL, attempts = 0, available_at = $1, lease_until = NULL
             WHERE sop_instance_uid = $2 AND node = $3 AND state IN ('done', 'failed')",
        )
        .bind(now)
        .bind(new.instance.as_str())
        .bind(&new.node)
        .execute()
        .await?;
    let row = connection
        .query(select_result!("WHERE sop_instance_uid = $1 AND node = $2"))
        .bind(new.instance.as_str())
        .bind(&new.node)
        .fetch_one()
        .await?;
    let queued = read(&row)?;
    if queued.object != new.object() {
        pins::abandon(connection, vec![new.object()], now).await?;
    }
    Ok(queued)
}

/// Makes a result of another store, whose case is here, as it is there. One that is here keeps its object.
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
    queue(connection, &new, now).await?;
    let state = match result.state {
        TransferState::Running => TransferState::Queued,
        state => state,
    };
    let reason = result.reason.as_ref().map(serde_json::to_string);
    connection
        .query(
            "UPDATE results SET id = $1, state = $2, reason = $3, attempts = $4, created_at = $5, lease_until = NULL
             WHERE sop_instance_uid = $6 AND node = $7",
        )
        .bind(&result.id)
        .bind(state.name())
        .bind(reason.transpose()?)
        .bind(i64::from(result.attempts))
        .bind(result.created_at.as_microsecond())
        .bind(result.instance.as_str())
        .bind(&result.node)
        .execute()
        .await?;
    Ok(())
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
        .query(select_result!(
            "WHERE (created_at, id) < ($1, $2) AND coalesce($3, case_id) = case_id AND coalesce($4, state) = state
             ORDER BY created_at DESC, id DESC LIMIT $5"
        ))
        .bind(at)
        .bind(id)
        .bind(query.case.map(|case| case.to_string()))
        .bind(query.state.map(TransferState::name))
        .bind(count(limit.saturating_add(1)))
        .fetch_all()
        .await?;
    let mut results = rows.iter().map(read).collect::<Result<Vec<_>, _>>()?;
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
    row.as_ref().map(read).transpose()
}

/// Results for different nodes share one object.
pub(super) async fn of_instance(
    connection: &mut Connection,
    instance: &Uid,
) -> Result<Option<ObjectName>, StoreError> {
    let row = connection
        .query("SELECT digest FROM results WHERE sop_instance_uid = $1 ORDER BY created_at, id LIMIT 1")
        .bind(instance.as_str())
        .fetch_optional()
        .await?;
    row.as_ref().map(read_object).transpose()
}

/// A result that was sent to several nodes is there once.
pub(super) async fn of_study(
    connection: &mut Connection,
    study: &Uid,
    with_withdrawn: bool,
) -> Result<Vec<HeldResult>, StoreError> {
    let rows = connection
        .query(
            "SELECT sop_instance_uid, sop_class_uid, series_uid, series_number, series_description, digest FROM results
             WHERE study_uid = $1 AND ($2 = 1 OR sop_instance_uid NOT IN (SELECT sop_instance_uid FROM rejections))
             ORDER BY series_number, sop_instance_uid, created_at, id",
        )
        .bind(study.as_str())
        .bind(i64::from(with_withdrawn))
        .fetch_all()
        .await?;
    let mut held = rows.iter().map(read_held).collect::<Result<Vec<_>, _>>()?;
    held.dedup_by(|later, earlier| later.instance == earlier.instance);
    Ok(held)
}

fn read_held(row: &Row) -> Result<HeldResult, StoreError> {
    Ok(HeldResult {
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

/// The result that has waited longest.
pub(super) async fn available(
    connection: &mut Connection,
    now: i64,
) -> Result<Option<String>, StoreError> {
    let row = connection
        .query(
            "SELECT id FROM results
             WHERE state IN ('queued', 'running') AND available_at <= $1 AND (lease_until IS NULL OR lease_until <= $1)
             ORDER BY available_at, id LIMIT 1",
        )
        .bind(now)
        .fetch_optional()
        .await?;
    row.map(|row| row.get("id")).transpose()
}

pub(super) async fn lease(
    connection: &mut Connection,
    id: &str,
    until: i64,
) -> Result<Option<SentResult>, StoreError> {
    let fence = fence::next(connection, until).await?;
    connection
        .query(
            "UPDATE results SET state = 'running', attempts = attempts + 1, fence = $1, lease_until = $2
             WHERE id = $3",
        )
        .bind(fence)
        .bind(until)
        .bind(id)
        .execute()
        .await?;
    one(connection, id).await
}

pub(super) async fn end(
    connection: &mut Connection,
    result: &SentResult,
    end: &TransferEnd,
    now: i64,
) -> Result<bool, StoreError> {
    let after = AfterAttempt::new(end, now)?;
    let ended = connection
        .query(
            "UPDATE results SET state = $1, reason = $2, available_at = $3, lease_until = NULL
             WHERE id = $4 AND fence = $5 AND state = 'running'",
        )
        .bind(after.state)
        .bind(after.reason)
        .bind(after.available_at)
        .bind(&result.id)
        .bind(result.fence)
        .execute()
        .await?;
    Ok(ended > 0)
}

/// Removes results that ended and last waited before a time, and abandons their objects.
pub(super) async fn forget(
    connection: &mut Connection,
    before: i64,
    now: i64,
) -> Result<(), StoreError> {
    let rows = connection
        .query(
            "SELECT digest FROM results WHERE state IN ('done', 'failed') AND available_at <= $1",
        )
        .bind(before)
        .fetch_all()
        .await?;
    abandon(connection, &rows, now).await?;
    connection
        .query("DELETE FROM results WHERE state IN ('done', 'failed') AND available_at <= $1")
        .bind(before)
        .execute()
        .await?;
    Ok(())
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

pub(super) async fn end_leases(connection: &mut Connection) -> Result<(), StoreError> {
    connection
        .query("UPDATE results SET lease_until = NULL")
        .execute()
        .await?;
    Ok(())
}

fn read_object(row: &Row) -> Result<ObjectName, StoreError> {
    let digest: String = row.get("digest")?;
    let digest = blake3::Hash::from_hex(digest).map_err(|_| unreadable("digest"))?;
    Ok(object(digest))
}

fn read(row: &Row) -> Result<SentResult, StoreError> {
    let [case, state]: [String; 2] = [row.get("case_id")?, row.get("state")?];
    let attempts: i64 = row.get("attempts")?;
    Ok(SentResult {
        id: row.get("id")?,
        case: CaseId::parse(&case).ok_or_else(|| unreadable("case"))?,
        node: row.get("node")?,
        study: read_uid(row, "study_uid")?,
        series: read_series(row)?,
        instance: read_uid(row, "sop_instance_uid")?,
        object: read_object(row)?,
        state: TransferState::from_name(&state).ok_or_else(|| unreadable("state"))?,
        reason: read_reason(row)?,
        created_at: read_time(row, "created_at")?,
        fence: row.get("fence")?,
        attempts: u32::try_from(attempts).unwrap_or(u32::MAX),
    })
}
