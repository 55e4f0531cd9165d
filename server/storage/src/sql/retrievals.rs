//! Series that are fetched from a node.

use super::arrivals::{count, read_count, read_reason, read_time, read_uids};
use super::connection::{Connection, Row};
use super::fence;
use super::transfers::AfterAttempt;
use crate::StoreError;
use crate::arrivals::{
    ArrivalCursor, Retrieval, SeriesUids, TransferEnd, TransferQuery, TransferState,
};

/// Columns that `read` understands. `WHERE` and what follows may come after.
macro_rules! select_retrieval {
    ($rest:literal) => {
        concat!(
            "SELECT id, node, study_uid, series_uid, state, reason, received, expected, created_at, fence, attempts
             FROM retrievals ",
            $rest
        )
    };
}

/// The retrieval of a series that waits for a lease, or a new one.
pub(super) async fn request(
    connection: &mut Connection,
    node: &str,
    uids: &SeriesUids,
    now: i64,
) -> Result<Retrieval, StoreError> {
    let waiting = connection
        .query(select_retrieval!(
            "WHERE node = $1 AND study_uid = $2 AND series_uid = $3 AND state = 'queued' ORDER BY created_at LIMIT 1"
        ))
        .bind(node)
        .bind(uids.study.as_str())
        .bind(uids.series.as_str())
        .fetch_optional()
        .await?;
    if let Some(row) = waiting {
        return read(&row);
    }
    let id = uuid::Uuid::now_v7().simple().to_string();
    connection
        .query(
            "INSERT INTO retrievals (id, node, study_uid, series_uid, state, created_at, available_at)
             VALUES ($1, $2, $3, $4, 'queued', $5, $5)",
        )
        .bind(&id)
        .bind(node)
        .bind(uids.study.as_str())
        .bind(uids.series.as_str())
        .bind(now)
        .execute()
        .await?;
    let new = one(connection, &id).await?;
    new.ok_or_else(|| StoreError::Rows("a retrieval is missing".into()))
}

pub(super) async fn page(
    connection: &mut Connection,
    query: &TransferQuery,
    after: Option<&ArrivalCursor>,
    limit: usize,
) -> Result<(Vec<Retrieval>, Option<ArrivalCursor>), StoreError> {
    let (at, id) = match after {
        Some(cursor) => (cursor.at, cursor.id.clone()),
        None => (i64::MAX, String::new()),
    };
    let rows = connection
        .query(select_retrieval!(
            "WHERE (created_at, id) < ($1, $2) AND coalesce($3, state) = state
               AND ($4 = '' OR EXISTS (SELECT 1 FROM case_series
                                       WHERE case_id = $4 AND case_series.study_uid = retrievals.study_uid
                                         AND case_series.series_uid = retrievals.series_uid))
             ORDER BY created_at DESC, id DESC LIMIT $5"
        ))
        .bind(at)
        .bind(id)
        .bind(query.state.map(TransferState::name))
        .bind(query.case.map_or_else(String::new, |case| case.to_string()))
        .bind(count(limit.saturating_add(1)))
        .fetch_all()
        .await?;
    let mut retrievals = rows.iter().map(read).collect::<Result<Vec<_>, _>>()?;
    let has_more = retrievals.len() > limit;
    retrievals.truncate(limit);
    let last = retrievals.last().filter(|_| has_more);
    let next = last.map(|last| ArrivalCursor {
        at: last.created_at.as_microsecond(),
        id: last.id.clone(),
    });
    Ok((retrievals, next))
}

pub(super) async fn one(
    connection: &mut Connection,
    id: &str,
) -> Result<Option<Retrieval>, StoreError> {
    let row = connection
        .query(select_retrieval!("WHERE id = $1"))
        .bind(id)
        .fetch_optional()
        .await?;
    row.as_ref().map(read).transpose()
}

/// The retrieval that has waited longest.
pub(super) async fn available(
    connection: &mut Connection,
    now: i64,
) -> Result<Option<String>, StoreError> {
    let row = connection
        .query(
            "SELECT id FROM retrievals
             WHERE state IN ('queued', 'running') AND available_at <= $1 AND (lease_until IS NULL OR lease_until <= $1)
             ORDER BY created_at, id LIMIT 1",
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
) -> Result<Option<Retrieval>, StoreError> {
    let fence = fence::next(connection, until).await?;
    connection
        .query(
            "UPDATE retrievals SET state = 'running', attempts = attempts + 1, fence = $1, lease_until = $2, received = 0
             WHERE id = $3",
        )
        .bind(fence)
        .bind(until)
        .bind(id)
        .execute()
        .await?;
    one(connection, id).await
}

pub(super) async fn progress(
    connection: &mut Connection,
    retrieval: &Retrieval,
    received: usize,
    expected: Option<usize>,
    until: i64,
) -> Result<bool, StoreError> {
    let noted = connection
        .query(
            "UPDATE retrievals SET received = $1, expected = $2, lease_until = $3
             WHERE id = $4 AND fence = $5 AND state = 'running'",
        )
        .bind(count(received))
        .bind(expected.map(count))
        .bind(until)
        .bind(&retrieval.id)
        .bind(retrieval.fence)
        .execute()
        .await?;
    Ok(noted > 0)
}

pub(super) async fn end(
    connection: &mut Connection,
    retrieval: &Retrieval,
    fetched: &TransferEnd,
    now: i64,
) -> Result<bool, StoreError> {
    let after = AfterAttempt::new(fetched, now)?;
    let ended = connection
        .query(
            "UPDATE retrievals SET state = $1, reason = $2, available_at = $3, lease_until = NULL
             WHERE id = $4 AND fence = $5 AND state = 'running'",
        )
        .bind(after.state)
        .bind(after.reason)
        .bind(after.available_at)
        .bind(&retrieval.id)
        .bind(retrieval.fence)
        .execute()
        .await?;
    Ok(ended > 0)
}

/// Removes retrievals that ended and were requested before a time.
pub(super) async fn forget(connection: &mut Connection, before: i64) -> Result<(), StoreError> {
    connection
        .query("DELETE FROM retrievals WHERE state IN ('done', 'failed') AND created_at <= $1")
        .bind(before)
        .execute()
        .await?;
    Ok(())
}

pub(super) async fn end_leases(connection: &mut Connection) -> Result<(), StoreError> {
    connection
        .query("UPDATE retrievals SET lease_until = NULL")
        .execute()
        .await?;
    Ok(())
}

fn read(row: &Row) -> Result<Retrieval, StoreError> {
    let state: String = row.get("state")?;
    let state = TransferState::from_name(&state)
        .ok_or_else(|| StoreError::Rows("a retrieval has an unknown state".into()))?;
    let expected: Option<i64> = row.get("expected")?;
    let attempts: i64 = row.get("attempts")?;
    Ok(Retrieval {
        id: row.get("id")?,
        node: row.get("node")?,
        uids: read_uids(row)?,
        state,
        reason: read_reason(row)?,
        received: read_count(row.get("received")?),
        expected: expected.map(read_count),
        created_at: read_time(row, "created_at")?,
        fence: row.get("fence")?,
        attempts: u32::try_from(attempts).unwrap_or(u32::MAX),
    })
}
