//! Jobs: who prepares which case, and until when.

use sqlx::sqlite::SqliteConnection;

use super::{cases, microseconds};
use crate::StoreError;
use crate::rows::{Claim, LeaseTerms, Release};
use case::{CaseId, Failure, FailureKind, Progress};

pub(super) async fn insert(
    connection: &mut SqliteConnection,
    id: &CaseId,
    now: i64,
) -> Result<(), StoreError> {
    sqlx::query("INSERT INTO jobs (case_id, queued_at, available_at) VALUES (?1, ?2, ?2)")
        .bind(id.to_string())
        .bind(now)
        .execute(connection)
        .await?;
    Ok(())
}

pub(super) async fn waiting(connection: &mut SqliteConnection) -> Result<usize, StoreError> {
    let count: i64 = sqlx::query_scalar("SELECT count(*) FROM jobs WHERE lease_until IS NULL")
        .fetch_one(connection)
        .await?;
    Ok(usize::try_from(count).unwrap_or(0))
}

pub(super) struct Available {
    id: CaseId,
    attempts: u32,
}

pub(super) async fn oldest_available(
    connection: &mut SqliteConnection,
    now: i64,
) -> Result<Option<Available>, StoreError> {
    let row: Option<(String, u32)> = sqlx::query_as(
        "SELECT case_id, attempts FROM jobs
         WHERE available_at <= ?1 AND (lease_until IS NULL OR lease_until <= ?1)
         ORDER BY queued_at, case_id LIMIT 1",
    )
    .bind(now)
    .fetch_optional(connection)
    .await?;
    row.map(|(id, attempts)| {
        let id = CaseId::parse(&id).ok_or_else(|| StoreError::Rows("a job has no case".into()))?;
        Ok(Available { id, attempts })
    })
    .transpose()
}

pub(super) async fn claim(
    connection: &mut SqliteConnection,
    terms: &LeaseTerms,
    now: i64,
) -> Result<Option<Claim>, StoreError> {
    while let Some(job) = oldest_available(connection, now).await? {
        if job.attempts < terms.max_attempts {
            return Ok(Some(
                lease(connection, job, now + microseconds(terms.lease)).await?,
            ));
        }
        give_up(connection, &job).await?;
    }
    Ok(None)
}

async fn lease(
    connection: &mut SqliteConnection,
    job: Available,
    until: i64,
) -> Result<Claim, StoreError> {
    let fence: i64 = sqlx::query_scalar("UPDATE fence SET value = value + 1 RETURNING value")
        .fetch_one(&mut *connection)
        .await?;
    let attempt = job.attempts + 1;
    sqlx::query(
        "UPDATE jobs SET attempts = ?, fence = ?, lease_until = ?, stage = NULL, fraction = NULL
         WHERE case_id = ?",
    )
    .bind(attempt)
    .bind(fence)
    .bind(until)
    .bind(job.id.to_string())
    .execute(&mut *connection)
    .await?;
    let row = sqlx::query(
        "UPDATE cases SET state = 'preparing' WHERE id = ?
         RETURNING closing_radius_mm, parameters, name",
    )
    .bind(job.id.to_string())
    .fetch_one(&mut *connection)
    .await?;
    let mut sources = cases::objects(&mut *connection, &job.id).await?;
    sources.retain(|object| object.kind.is_source());
    Ok(Claim {
        id: job.id,
        parameters: cases::read_parameters(&row)?,
        sources,
        fence,
        attempt,
    })
}

/// Fails a case whose preparations all ended without a word: they were killed, or took the process with them.
async fn give_up(connection: &mut SqliteConnection, job: &Available) -> Result<(), StoreError> {
    let detail = format!(
        "the preparation was interrupted {} times and given up; upload the volume again to retry",
        job.attempts
    );
    let failure = Failure::new(FailureKind::Internal, "preparation-interrupted", detail);
    sqlx::query("DELETE FROM jobs WHERE case_id = ?")
        .bind(job.id.to_string())
        .execute(&mut *connection)
        .await?;
    cases::make_failed(connection, &job.id, &failure).await
}

pub(super) async fn renew(
    connection: &mut SqliteConnection,
    claim: &Claim,
    until: i64,
    progress: Option<Progress>,
) -> Result<bool, StoreError> {
    let renewed = sqlx::query(
        "UPDATE jobs SET lease_until = ?, stage = ?, fraction = ? WHERE case_id = ? AND fence = ?",
    )
    .bind(until)
    .bind(progress.map(|progress| progress.stage.name()))
    .bind(progress.map(|progress| progress.fraction))
    .bind(claim.id.to_string())
    .bind(claim.fence)
    .execute(connection)
    .await?;
    Ok(renewed.rows_affected() > 0)
}

pub(super) async fn release(
    connection: &mut SqliteConnection,
    claim: &Claim,
    release: Release,
    now: i64,
) -> Result<bool, StoreError> {
    // The fence number goes to nobody: whoever held the lease can neither renew nor publish.
    let released = sqlx::query(
        "UPDATE jobs SET lease_until = NULL, fence = 0, available_at = ?, attempts = attempts - ?,
                         stage = NULL, fraction = NULL
         WHERE case_id = ? AND fence = ?",
    )
    .bind(now + microseconds(release.after))
    .bind(i64::from(!release.counts))
    .bind(claim.id.to_string())
    .bind(claim.fence)
    .execute(&mut *connection)
    .await?;
    if released.rows_affected() == 0 {
        return Ok(false);
    }
    sqlx::query("UPDATE cases SET state = 'queued' WHERE id = ?")
        .bind(claim.id.to_string())
        .execute(connection)
        .await?;
    Ok(true)
}

/// Takes the job away where the lease is still the claim's; whether it was.
pub(super) async fn finish(
    connection: &mut SqliteConnection,
    claim: &Claim,
) -> Result<bool, StoreError> {
    let finished = sqlx::query("DELETE FROM jobs WHERE case_id = ? AND fence = ?")
        .bind(claim.id.to_string())
        .bind(claim.fence)
        .execute(connection)
        .await?;
    Ok(finished.rows_affected() > 0)
}

pub(super) async fn end_leases(
    connection: &mut SqliteConnection,
    now: i64,
) -> Result<(), StoreError> {
    sqlx::query("UPDATE jobs SET lease_until = ? WHERE lease_until > ?1")
        .bind(now)
        .execute(connection)
        .await?;
    Ok(())
}
