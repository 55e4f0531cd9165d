//! Jobs and their leases.

use super::connection::{Connection, microseconds};
use super::{cases, fence, findings, layers};
use crate::StoreError;
use crate::rows::{Claim, Inserted, LeaseTerms, NewCase, Release};
use case::{CaseId, Failure, FailureKind, Progress};

/// Inserts a case with its references, its job, and, for a version, the layers and the findings of the case that it is a version of.
pub(super) async fn submit(
    connection: &mut Connection,
    new: &NewCase,
    now: i64,
) -> Result<Inserted, StoreError> {
    let state = cases::state(connection, &new.id).await?;
    if state.is_some() {
        cases::uploaded_again(connection, &new.id, now).await?;
    }
    if state.as_deref().is_some_and(|state| state != "failed") {
        return Ok(Inserted::Exists);
    }
    if waiting(connection).await? >= new.queue_limit {
        return Ok(Inserted::QueueFull);
    }
    let inserted = if state.is_none() {
        cases::insert(connection, new, now).await?;
        Inserted::Created
    } else {
        cases::queue_again(connection, &new.id).await?;
        Inserted::Requeued
    };
    if !cases::refer(connection, &new.id, &new.sources, now).await? {
        return Ok(Inserted::PinLost);
    }
    insert(connection, &new.id, now).await?;
    if let (Inserted::Created, Some(previous)) = (inserted, &new.previous) {
        layers::inherit(connection, &new.id, previous, now).await?;
        findings::inherit(connection, &new.id, previous).await?;
    }
    Ok(inserted)
}

pub(super) async fn insert(
    connection: &mut Connection,
    id: &CaseId,
    now: i64,
) -> Result<(), StoreError> {
    connection
        .query("INSERT INTO jobs (case_id, queued_at, available_at) VALUES ($1, $2, $2)")
        .bind(id.to_string())
        .bind(now)
        .execute()
        .await?;
    Ok(())
}

pub(super) async fn waiting(connection: &mut Connection) -> Result<usize, StoreError> {
    let row = connection
        .query("SELECT count(*) AS count FROM jobs WHERE lease_until IS NULL")
        .fetch_one()
        .await?;
    let count: i64 = row.get("count")?;
    Ok(usize::try_from(count).unwrap_or(0))
}

pub(super) struct Available {
    id: CaseId,
    attempts: i64,
}

pub(super) async fn oldest_available(
    connection: &mut Connection,
    now: i64,
) -> Result<Option<Available>, StoreError> {
    let row = connection
        .query(
            "SELECT case_id, attempts FROM jobs
         WHERE available_at <= $1 AND (lease_until IS NULL OR lease_until <= $1)
         ORDER BY queued_at, case_id LIMIT 1",
        )
        .bind(now)
        .fetch_optional()
        .await?;
    row.map(|row| {
        let id: String = row.get("case_id")?;
        let id = CaseId::parse(&id).ok_or_else(|| StoreError::Rows("a job has no case".into()))?;
        let attempts = row.get("attempts")?;
        Ok(Available { id, attempts })
    })
    .transpose()
}

pub(super) async fn claim(
    connection: &mut Connection,
    terms: &LeaseTerms,
    now: i64,
) -> Result<Option<Claim>, StoreError> {
    while let Some(job) = oldest_available(connection, now).await? {
        if job.attempts < i64::from(terms.max_attempts) {
            return Ok(Some(
                lease(connection, job, now + microseconds(terms.lease)).await?,
            ));
        }
        give_up(connection, &job).await?;
    }
    Ok(None)
}

async fn lease(
    connection: &mut Connection,
    job: Available,
    until: i64,
) -> Result<Claim, StoreError> {
    let fence = fence::next(connection, until).await?;
    let attempt = job.attempts + 1;
    connection.query(
        "UPDATE jobs SET attempts = $1, fence = $2, lease_until = $3, stage = NULL, fraction = NULL
         WHERE case_id = $4",
    )
    .bind(attempt)
    .bind(fence)
    .bind(until)
    .bind(job.id.to_string())
    .execute()
    .await?;
    let row = connection
        .query(
            "UPDATE cases SET state = 'preparing' WHERE id = $1
         RETURNING closing_radius_mm, parameters, name",
        )
        .bind(job.id.to_string())
        .fetch_one()
        .await?;
    let mut sources = cases::objects(connection, &job.id).await?;
    sources.retain(|object| object.kind.is_source());
    Ok(Claim {
        id: job.id,
        parameters: cases::read_parameters(&row)?,
        sources,
        fence,
        attempt: u32::try_from(attempt).unwrap_or(u32::MAX),
    })
}

/// Removes the job of a case, if it has one.
pub(super) async fn forget(connection: &mut Connection, id: &CaseId) -> Result<(), StoreError> {
    connection
        .query("DELETE FROM jobs WHERE case_id = $1")
        .bind(id.to_string())
        .execute()
        .await?;
    Ok(())
}

/// Fails a case after all its preparations ended without a result, because they were killed or crashed.
async fn give_up(connection: &mut Connection, job: &Available) -> Result<(), StoreError> {
    let detail = format!(
        "the preparation was interrupted {} times and abandoned; upload the volume again to retry",
        job.attempts
    );
    let failure = Failure::new(FailureKind::Internal, "preparation-interrupted", detail);
    forget(connection, &job.id).await?;
    cases::make_failed(connection, &job.id, &failure).await
}

pub(super) async fn renew(
    connection: &mut Connection,
    claim: &Claim,
    until: i64,
    progress: Option<Progress>,
) -> Result<bool, StoreError> {
    let renewed = connection.query(
        "UPDATE jobs SET lease_until = $1, stage = $2, fraction = $3 WHERE case_id = $4 AND fence = $5",
    )
    .bind(until)
    .bind(progress.map(|progress| progress.stage.name()))
    .bind(progress.map(|progress| progress.fraction))
    .bind(claim.id.to_string())
    .bind(claim.fence)
    .execute()
    .await?;
    Ok(renewed > 0)
}

pub(super) async fn release(
    connection: &mut Connection,
    claim: &Claim,
    release: Release,
    now: i64,
) -> Result<bool, StoreError> {
    // No worker gets this fence number, so the former holder can neither renew nor publish.
    let released = connection.query(
        "UPDATE jobs SET lease_until = NULL, fence = 0, available_at = $1, attempts = attempts - $2,
                         stage = NULL, fraction = NULL
         WHERE case_id = $3 AND fence = $4",
    )
    .bind(now + microseconds(release.after))
    .bind(i64::from(!release.counts))
    .bind(claim.id.to_string())
    .bind(claim.fence)
    .execute()
    .await?;
    if released == 0 {
        return Ok(false);
    }
    connection
        .query("UPDATE cases SET state = 'queued' WHERE id = $1")
        .bind(claim.id.to_string())
        .execute()
        .await?;
    Ok(true)
}

/// Takes the job away where the lease is still the claim's; whether it was.
pub(super) async fn finish(connection: &mut Connection, claim: &Claim) -> Result<bool, StoreError> {
    let finished = connection
        .query("DELETE FROM jobs WHERE case_id = $1 AND fence = $2")
        .bind(claim.id.to_string())
        .bind(claim.fence)
        .execute()
        .await?;
    Ok(finished > 0)
}

pub(super) async fn end_leases(connection: &mut Connection, now: i64) -> Result<(), StoreError> {
    connection
        .query("UPDATE jobs SET lease_until = $1 WHERE lease_until > $1")
        .bind(now)
        .execute()
        .await?;
    Ok(())
}
