//! The one table of jobs.

use std::time::Duration;

use case::{CaseId, CaseState, Failure, JobKind, JobState};
use jiff::Timestamp;

use super::connection::{Connection, Row, microseconds, new_id};
use crate::args;
use crate::jobs::{Claim, Job, JobQuery, NewJob, Release};
use crate::{Cursor, Store, StoreError};

impl Store {
    /// Queues a job, unless there is an open one of its kind and key; returns the open one. `None` if there is no such
    /// case.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub async fn enqueue(&self, new: &NewJob) -> Result<Option<Job>, StoreError> {
        let (mut transaction, now) = self.write().await?;
        if !enqueue_of_case(&mut transaction, new, now).await? {
            return Ok(None);
        }
        let job = latest(&mut transaction, new.kind, &new.key).await?;
        transaction.commit().await?;
        self.signals().queued();
        Ok(job)
    }

    /// Forgets jobs that ended this long ago, but those that other tables keep.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub async fn forget_jobs(&self, ended: Duration) -> Result<(), StoreError> {
        let (mut transaction, now) = self.write().await?;
        let kept = transaction.tables().kept_jobs().map_or("", JobKind::name);
        transaction
            .execute(
                "DELETE FROM jobs WHERE state IN ('done', 'failed') AND ended_at <= $1 AND kind <> $2",
                args![now - microseconds(ended), kept],
            )
            .await?;
        transaction.commit().await
    }

    /// Refuses one more job of a kind of the client of this store, before anything is done for it.
    ///
    /// # Errors
    /// [`StoreError::QueueFull`], or if the rows cannot be read.
    pub(crate) async fn check_room(&self, kind: JobKind) -> Result<(), StoreError> {
        let mut connection = self.connect().await?;
        let now = connection.now().await?;
        let most = self.options().queue_limit;
        check_room(&mut connection, kind, most, &self.client, now).await
    }

    /// Renews a lease from now on and notes the progress; `false` if the lease is not ours any more.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub async fn renew(&self, claim: &Claim, progress: Option<&str>) -> Result<bool, StoreError> {
        let mut connection = self.connect().await?;
        let until = connection.now().await? + microseconds(self.options().lease);
        renew(&mut connection, claim, until, progress).await
    }

    /// Returns a lease; `false` if it is not ours any more.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub async fn release(&self, claim: &Claim, release: &Release) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.write().await?;
        // No process gets this fence number, so the former holder can neither renew nor publish.
        let failure = release.failure.as_ref();
        let failure = failure.map(serde_json::to_string).transpose()?;
        let released = transaction
            .execute(
                "UPDATE jobs SET state = 'queued', lease_until = NULL, fence = 0, available_at = $1,
                                 attempts = attempts - $2, progress = NULL, failure = $3
                 WHERE id = $4 AND fence = $5 AND state = 'running'",
                args![
                    now + microseconds(release.after),
                    i64::from(!release.counts),
                    failure,
                    &claim.id,
                    claim.fence
                ],
            )
            .await?;
        transaction.commit().await?;
        self.job_changed(claim);
        Ok(released > 0)
    }

    pub(crate) fn job_changed(&self, claim: &Claim) {
        if let Some(case) = &claim.case {
            self.signals().changed(case);
        }
    }
}

/// Columns that `read` understands. `WHERE` and what follows may come after.
macro_rules! select_job {
    ($rest:literal) => {
        concat!(
            "SELECT id, kind, key, case_id, payload, state, progress, failure, attempts, created_at, ended_at FROM jobs ",
            $rest
        )
    };
}

pub(super) fn unreadable(what: &str) -> StoreError {
    StoreError::Rows(format!("a job has an unknown {what}").into())
}

/// Adds a job, unless there is an open one of its kind and key, which stays as it is.
pub async fn enqueue(
    connection: &mut Connection,
    new: &NewJob,
    now: i64,
) -> Result<(), StoreError> {
    enqueue_for(connection, new, "", now).await
}

/// The same for a client, which takes turns with others.
pub(super) async fn enqueue_for(
    connection: &mut Connection,
    new: &NewJob,
    client: &str,
    now: i64,
) -> Result<(), StoreError> {
    connection
        .execute(
            "INSERT INTO jobs (id, kind, key, case_id, needs_ready, payload, state, created_at, available_at, client)
             VALUES ($1, $2, $3, $4, $5, $6, 'queued', $7, $7, $8)
             ON CONFLICT DO NOTHING",
            args![
                new_id(), new.kind.name(), &new.key, new.case.map(|case| case.to_string()),
                new.needs_ready, &new.payload, now, client,
            ],
        )
        .await?;
    Ok(())
}

/// Adds a job, unless there is an open one; `false` if there is no such case.
pub(super) async fn enqueue_of_case(
    connection: &mut Connection,
    new: &NewJob,
    now: i64,
) -> Result<bool, StoreError> {
    if let Some(case) = &new.case
        && !connection.has_case(&case.to_string()).await?
    {
        return Ok(false);
    }
    enqueue(connection, new, now).await?;
    Ok(true)
}

/// Makes a job of another store, whose case is here, as it is there; one that is open waits here.
pub async fn write_copied(
    connection: &mut Connection,
    job: &Job,
    now: i64,
) -> Result<(), StoreError> {
    let state = match job.state.has_ended() {
        true => job.state,
        false => JobState::Queued,
    };
    let failure = job.failure.as_ref().map(serde_json::to_string);
    connection
        .execute(
            "INSERT INTO jobs (id, kind, key, case_id, needs_ready, payload, state, failure, attempts, created_at,
                               available_at, ended_at)
             VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, $12)
             ON CONFLICT DO NOTHING",
            args![
                &job.id, &job.kind, &job.key, job.case.map(|case| case.to_string()), false,
                &job.payload, state.name(), failure.transpose()?, i64::from(job.attempts),
                job.created_at.as_microsecond(), now, job.ended_at.map(Timestamp::as_microsecond),
            ],
        )
        .await?;
    Ok(())
}

/// A job; `None` if there is none, or if it ended some days ago.
pub async fn one(connection: &mut Connection, id: &str) -> Result<Option<Job>, StoreError> {
    let row = connection
        .fetch_optional(select_job!("WHERE id = $1"), args![id])
        .await?;
    row.as_ref().map(read).transpose()
}

/// The latest job of a kind and a key.
pub async fn latest(
    connection: &mut Connection,
    kind: JobKind,
    key: &str,
) -> Result<Option<Job>, StoreError> {
    let row = connection
        .fetch_optional(
            select_job!("WHERE kind = $1 AND key = $2 ORDER BY created_at DESC, id DESC LIMIT 1"),
            args![kind.name(), key],
        )
        .await?;
    row.as_ref().map(read).transpose()
}

/// The latest job with a key, of any kind.
pub async fn latest_of_key(
    connection: &mut Connection,
    key: &str,
) -> Result<Option<Job>, StoreError> {
    let row = connection
        .fetch_optional(
            select_job!("WHERE key = $1 ORDER BY created_at DESC, id DESC LIMIT 1"),
            args![key],
        )
        .await?;
    row.as_ref().map(read).transpose()
}

/// At most `limit` jobs after a cursor, newest first, and the cursor of the next page.
pub async fn page(
    connection: &mut Connection,
    query: &JobQuery,
    after: Option<&Cursor>,
    limit: usize,
) -> Result<(Vec<Job>, Option<Cursor>), StoreError> {
    let (at, id) = Cursor::place(after);
    let rows = connection
        .fetch_all(
            select_job!(
                "WHERE kind = $1 AND (created_at, id) < ($2, $3) AND coalesce($4, state) = state
               AND substr(key, 1, length($5)) = $5
             ORDER BY created_at DESC, id DESC LIMIT $6"
            ),
            args![
                query.kind.name(),
                at,
                id,
                query.state.map(JobState::name),
                &query.key_prefix,
                i64::try_from(limit.saturating_add(1)).unwrap_or(i64::MAX)
            ],
        )
        .await?;
    let jobs = rows.iter().map(read).collect::<Result<_, _>>()?;
    Ok(Cursor::page(jobs, limit, |job: &Job| {
        (job.created_at, job.id.clone())
    }))
}

/// For how long the oldest open job of each kind has been there.
pub(super) async fn oldest_of_each_kind(
    connection: &mut Connection,
    now: i64,
) -> Result<Vec<(String, Duration)>, StoreError> {
    let rows = connection
        .fetch_all(
            "SELECT kind, min(created_at) AS oldest FROM jobs WHERE state IN ('queued', 'running')
             GROUP BY kind ORDER BY kind",
            args![],
        )
        .await?;
    let read = |row: &Row| {
        let oldest: i64 = row.get("oldest")?;
        let age = now.saturating_sub(oldest).max(0).unsigned_abs();
        Ok((row.get("kind")?, Duration::from_micros(age)))
    };
    rows.iter().map(read).collect()
}

/// Refuses one more job of a kind of a client if `most` wait, or a quarter of `most` of the client.
/// Without a client, the program itself asks, which may take all.
pub(super) async fn check_room(
    connection: &mut Connection,
    kind: JobKind,
    most: usize,
    client: &str,
    now: i64,
) -> Result<(), StoreError> {
    let mut wait = time_to_a_place(connection, kind, most, "", now).await?;
    if !client.is_empty() {
        let share = most.div_ceil(4);
        wait = wait.max(time_to_a_place(connection, kind, share, client, now).await?);
    }
    wait.map_or(Ok(()), |wait| Err(StoreError::QueueFull(wait)))
}

/// After how long fewer than `most` jobs of a kind will wait, of a client or, if it is empty, of all; `None` if fewer do.
///
/// Since the oldest one came, there has always been one, so those that have ended since then tell the pace.
async fn time_to_a_place(
    connection: &mut Connection,
    kind: JobKind,
    most: usize,
    client: &str,
    now: i64,
) -> Result<Option<Duration>, StoreError> {
    let row = connection
        .fetch_one(
            "SELECT count(*) AS count, coalesce(min(created_at), 0) AS oldest FROM jobs
             WHERE kind = $1 AND state IN ('queued', 'running') AND state = 'queued'
               AND ($2 = '' OR client = $2)",
            args![kind.name(), client],
        )
        .await?;
    let (count, oldest): (i64, i64) = (row.get("count")?, row.get("oldest")?);
    let count = usize::try_from(count).unwrap_or(0);
    if count < most {
        return Ok(None);
    }
    let row = connection
        .fetch_one(
            "SELECT count(*) AS ended, coalesce(max(ended_at), $3) AS last FROM jobs
             WHERE kind = $1 AND state IN ('done', 'failed') AND ended_at > $3
               AND ($2 = '' OR client = $2)",
            args![kind.name(), client, oldest],
        )
        .await?;
    let (ended, last): (i64, i64) = (row.get("ended")?, row.get("last")?);
    let of_one = (now - oldest).max(0) / ended.max(1);
    let of_next = match ended {
        // It takes at least as long as it has taken.
        0 => of_one,
        _ => (of_one - (now - last)).max(of_one / 8),
    };
    let beyond = i64::try_from(count - most).unwrap_or(0);
    let wait = of_next.saturating_add(of_one.saturating_mul(beyond));
    Ok(Some(Duration::from_micros(wait.unsigned_abs())))
}

async fn renew(
    connection: &mut Connection,
    claim: &Claim,
    until: i64,
    progress: Option<&str>,
) -> Result<bool, StoreError> {
    let renewed = connection
        .execute(
            "UPDATE jobs SET lease_until = $1, progress = coalesce($2, progress)
             WHERE id = $3 AND fence = $4 AND state = 'running'",
            args![until, progress, &claim.id, claim.fence],
        )
        .await?;
    Ok(renewed > 0)
}

/// Ends a job if the lease is still the claim's; whether it was.
pub async fn finish(
    connection: &mut Connection,
    claim: &Claim,
    result: Result<(), &Failure>,
    now: i64,
) -> Result<bool, StoreError> {
    // It also reports whose lease it is.
    let is_ours = renew(connection, claim, now, None).await?;
    if is_ours {
        end(connection, &claim.id, result, now).await?;
    }
    Ok(is_ours)
}

pub(super) async fn end(
    connection: &mut Connection,
    id: &str,
    result: Result<(), &Failure>,
    now: i64,
) -> Result<(), StoreError> {
    let state = match result {
        Ok(()) => JobState::Done,
        Err(_) => JobState::Failed,
    };
    let failure = result.err().map(serde_json::to_string).transpose()?;
    connection
        .execute(
            "UPDATE jobs SET state = $1, failure = $2, ended_at = $3, fence = 0, lease_until = NULL WHERE id = $4",
            args![state.name(), failure, now, id],
        )
        .await?;
    Ok(())
}

/// Notes the case that came of a job. The job goes with it.
pub async fn became(
    connection: &mut Connection,
    claim: &Claim,
    case: &CaseId,
) -> Result<(), StoreError> {
    connection
        .execute(
            "UPDATE jobs SET case_id = $1 WHERE id = $2",
            args![case.to_string(), &claim.id],
        )
        .await?;
    Ok(())
}

/// Removes the open job of a kind and a key, so that its holder can neither renew nor end it.
pub async fn cancel(
    connection: &mut Connection,
    kind: JobKind,
    key: &str,
) -> Result<(), StoreError> {
    connection
        .execute(
            "DELETE FROM jobs WHERE kind = $1 AND key = $2 AND state IN ('queued', 'running')",
            args![kind.name(), key],
        )
        .await?;
    Ok(())
}

/// Removes all jobs with a key.
pub async fn remove(connection: &mut Connection, key: &str) -> Result<(), StoreError> {
    connection
        .execute("DELETE FROM jobs WHERE key = $1", args![key])
        .await?;
    Ok(())
}

pub(super) fn read_case(row: &Row) -> Result<Option<CaseId>, StoreError> {
    let case: Option<String> = row.get("case_id")?;
    case.map(|case| CaseId::parse(&case).ok_or_else(|| unreadable("case")))
        .transpose()
}

pub(super) fn read_failure(failure: Option<String>) -> Result<Option<Failure>, StoreError> {
    Ok(failure.as_deref().map(serde_json::from_str).transpose()?)
}

fn read(row: &Row) -> Result<Job, StoreError> {
    let state: String = row.get("state")?;
    let attempts: i64 = row.get("attempts")?;
    let time = |at| Timestamp::from_microsecond(at).map_err(|_| unreadable("time"));
    let ended_at: Option<i64> = row.get("ended_at")?;
    Ok(Job {
        id: row.get("id")?,
        kind: row.get("kind")?,
        key: row.get("key")?,
        case: read_case(row)?,
        payload: row.get("payload")?,
        state: JobState::from_name(&state).ok_or_else(|| unreadable("state"))?,
        progress: row.get("progress")?,
        failure: read_failure(row.get("failure")?)?,
        attempts: u32::try_from(attempts).unwrap_or(u32::MAX),
        created_at: time(row.get("created_at")?)?,
        ended_at: ended_at.map(time).transpose()?,
    })
}

/// The state of a case or a layer, and of its job.
pub fn read_state(row: &Row) -> Option<CaseState> {
    let state: String = row.get("state").ok()?;
    let job: Option<String> = row.get("job_state").ok()?;
    match (state.as_str(), job.as_deref()) {
        ("queued", Some("running")) => Some(CaseState::Preparing),
        ("queued", _) => Some(CaseState::Queued),
        ("ready", _) => Some(CaseState::Ready),
        ("failed", _) => Some(CaseState::Failed),
        _ => None,
    }
}
