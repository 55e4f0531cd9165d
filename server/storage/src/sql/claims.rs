//! Which job comes next, and what fails with it.

use std::time::Duration;

use case::{Failure, JobKind, STORE_FAILED};

use super::connection::{Connection, microseconds};
use super::{cases, fence, jobs, layers};
use crate::jobs::Claim;
use crate::rows::Owner;
use crate::{StoreError, args};

/// Which jobs a worker would do.
#[derive(Clone, Copy)]
pub(super) struct Wanted<'a> {
    pub(super) kind: JobKind,
    /// Any, if it is not given.
    pub(super) key: Option<&'a str>,
}

/// A job that may be leased.
pub(super) struct Available {
    id: String,
    key: String,
    attempts: i64,
    failure: Option<String>,
}

/// The statement for a job that may be leased, in an order. The queue of preparations is short, other queues may be long.
macro_rules! select_available {
    ($order:literal) => {
        concat!(
            "SELECT id, key, attempts, failure FROM jobs
             WHERE kind = $1 AND state IN ('queued', 'running') AND available_at <= $2
               AND (lease_until IS NULL OR lease_until <= $2) AND coalesce($3, key) = key
               AND (NOT needs_ready OR EXISTS (SELECT 1 FROM cases WHERE cases.id = case_id AND cases.state = 'ready'))
             ORDER BY ",
            $order,
            " created_at, id LIMIT 1"
        )
    };
}

/// The client whose last preparation ended the longest ago, or that had none, comes first; one for which another is running
/// comes last.
const IN_TURNS: &str = select_available!(
    "(SELECT coalesce(max(CASE WHEN served.state = 'running' AND served.lease_until > $2 THEN $2
                               ELSE coalesce(served.ended_at, 0) END), 0)
      FROM jobs AS served WHERE served.kind = jobs.kind AND served.client = jobs.client),"
);

/// The oldest wanted job that waits or whose lease has ended; of preparations the next, for the clients take turns.
pub(super) async fn oldest_available(
    connection: &mut Connection,
    wanted: Wanted<'_>,
    now: i64,
) -> Result<Option<Available>, StoreError> {
    let row = connection
        .fetch_optional(
            match wanted.kind == JobKind::PREPARE {
                true => IN_TURNS,
                false => select_available!(""),
            },
            args![wanted.kind.name(), now, wanted.key],
        )
        .await?;
    row.map(|row| {
        Ok(Available {
            id: row.get("id")?,
            key: row.get("key")?,
            attempts: row.get("attempts")?,
            failure: row.get("failure")?,
        })
    })
    .transpose()
}

/// Leases the oldest wanted job. Those with too many attempts behind them fail on the way.
pub(super) async fn claim(
    connection: &mut Connection,
    wanted: Wanted<'_>,
    max_attempts: u32,
    time: Duration,
    now: i64,
) -> Result<Option<Claim>, StoreError> {
    let kind = wanted.kind;
    while let Some(job) = oldest_available(connection, wanted, now).await? {
        let tables = connection.tables();
        if let Some(failure) = tables.refusal(connection, kind, &job.key).await? {
            jobs::end(connection, &job.id, Err(&failure), now).await?;
            continue;
        }
        if job.attempts < i64::from(max_attempts) {
            return lease(connection, kind, &job.id, time, now).await.map(Some);
        }
        let attempts = u32::try_from(job.attempts).unwrap_or(u32::MAX);
        let last = jobs::read_failure(job.failure)?;
        let failure = Failure::after_attempts(kind, attempts, last);
        jobs::end(connection, &job.id, Err(&failure), now).await?;
        fail_item(connection, kind, &job.key, &failure, now).await?;
    }
    Ok(None)
}

async fn lease(
    connection: &mut Connection,
    kind: JobKind,
    id: &str,
    time: Duration,
    now: i64,
) -> Result<Claim, StoreError> {
    let until = now + microseconds(time);
    let fence = fence::next(connection, until).await?;
    let row = connection
        .fetch_one(
            // The reason of an attempt is that of the latest one, and one that was killed has none.
            "UPDATE jobs SET state = 'running', attempts = attempts + 1, fence = $1, lease_until = $2,
                             progress = NULL, failure = NULL
             WHERE id = $3 RETURNING key, case_id, payload, attempts, created_at",
            args![fence, until, id],
        )
        .await?;
    let (attempts, created_at): (i64, i64) = (row.get("attempts")?, row.get("created_at")?);
    Ok(Claim {
        id: id.to_owned(),
        kind,
        key: row.get("key")?,
        case: jobs::read_case(&row)?,
        payload: row.get("payload")?,
        fence,
        attempt: u32::try_from(attempts).unwrap_or(u32::MAX),
        age: Duration::from_micros((now - created_at).max(0).unsigned_abs()),
    })
}

/// Makes what a job is about failed, if the store knows it.
pub(super) async fn fail_item(
    connection: &mut Connection,
    kind: JobKind,
    key: &str,
    failure: &Failure,
    now: i64,
) -> Result<(), StoreError> {
    match kind {
        // A store that fails is no reason to give up a case that is ready.
        JobKind::REBUILD if failure.name == STORE_FAILED => Ok(()),
        JobKind::PREPARE | JobKind::REBUILD | JobKind::LAYER => {
            let owner = Owner::of_key(key).ok_or_else(|| jobs::unreadable("key"))?;
            match owner.layer {
                None => cases::make_failed(connection, &owner.case, failure, now).await,
                Some(_) => layers::make_failed(connection, owner, failure, now).await,
            }
        }
        _ => {
            let tables = connection.tables();
            tables.job_failed(connection, kind, key, failure).await
        }
    }
}
