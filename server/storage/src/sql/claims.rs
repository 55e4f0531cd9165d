//! Which job comes next, and what fails with it.

use std::time::Duration;

use case::{Failure, JobKind, STORE_FAILED};

use super::connection::{Connection, microseconds};
use super::{cases, fence, jobs, layers};
use crate::jobs::{Claim, NewJob};
use crate::rows::Owner;
use crate::{Store, StoreError, args};

impl Store {
    /// Leases the oldest job of a kind. Those with as many attempts behind them fail on the way.
    ///
    /// # Errors
    /// If the rows cannot be written, or do not belong to the objects.
    pub async fn claim(
        &self,
        kind: JobKind,
        max_attempts: u32,
    ) -> Result<Option<Claim>, StoreError> {
        let wanted = Wanted { kind, key: None };
        // Most queries find nothing and must not wait for writers.
        let mut reader = self.connect().await?;
        let now = reader.now().await?;
        let found = oldest_available(&mut reader, wanted, now).await?;
        drop(reader);
        if found.is_none() {
            return Ok(None);
        }
        self.id().await?;
        let (mut transaction, now) = self.write().await?;
        let lease = self.options().lease;
        let claim = claim(&mut transaction, wanted, max_attempts, lease, now).await?;
        transaction.commit_soon().await?;
        if let Some(case) = claim.as_ref().and_then(|claim| claim.case) {
            self.signals().changed(&case);
        }
        Ok(claim)
    }

    /// Ends a job, if the lease is still ours; returns whether it was. With one that has failed for good, what it is about fails.
    ///
    /// # Errors
    /// If the rows or the objects cannot be written. It may have ended even so; objects that nobody needs are then
    /// removed later.
    pub async fn finish(
        &self,
        claim: &Claim,
        result: Result<(), &Failure>,
    ) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.write().await?;
        let is_ours = jobs::finish(&mut transaction, claim, result, now).await?;
        if let Err(failure) = result
            && is_ours
        {
            fail_item(&mut transaction, claim.kind, &claim.key, failure, now).await?;
        }
        transaction.commit().await?;
        self.job_changed(claim);
        if is_ours && result.is_err() && claim.kind == JobKind::LAYER {
            self.collect().await?;
        }
        Ok(is_ours)
    }

    /// Queues a job, unless there is an open one, and leases it; `None` if another process has it, or it failed just now.
    pub(crate) async fn enqueue_and_claim(
        &self,
        new: &NewJob,
        max_attempts: u32,
    ) -> Result<Option<Claim>, StoreError> {
        let (mut transaction, now) = self.write().await?;
        if !jobs::enqueue_of_case(&mut transaction, new, now).await? {
            return Ok(None);
        }
        let wanted = Wanted {
            kind: new.kind,
            key: Some(&new.key),
        };
        let lease = self.options().lease;
        let claim = claim(&mut transaction, wanted, max_attempts, lease, now).await?;
        transaction.commit().await?;
        Ok(claim)
    }
}

/// Which jobs a worker would do.
#[derive(Clone, Copy)]
struct Wanted<'a> {
    kind: JobKind,
    /// Any, if it is not given.
    key: Option<&'a str>,
}

/// A job that may be leased.
struct Available {
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
async fn oldest_available(
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
async fn claim(
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
async fn fail_item(
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
