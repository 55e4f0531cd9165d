//! Cases and the objects they need.

use jiff::Timestamp;
use sqlx::Row;
use sqlx::sqlite::{SqliteConnection, SqlitePool, SqliteRow};

use super::{jobs, pins, upkeep};
use crate::rows::{Inserted, NewCase, Pinned};
use crate::{Cursor, ObjectName, Page, StoreError};
use case::{Case, CaseFacts, CaseId, CaseState, Failure, Parameters, Progress, Stage};

/// A case with its job's progress, which `read` understands. A `WHERE` or `ORDER BY` may follow.
macro_rules! select_case {
    ($rest:literal) => {
        concat!(
            "SELECT id, closing_radius_mm, parameters, name, state, failure, facts, facts_digest, created_at, previous, stage, fraction,
                    (SELECT group_concat(id) FROM (SELECT id FROM cases AS version WHERE version.previous = cases.id
                                                   ORDER BY created_at, id)) AS next
             FROM cases LEFT JOIN jobs ON jobs.case_id = cases.id ",
            $rest
        )
    };
}

pub(super) async fn insert(
    connection: &mut SqliteConnection,
    new: &NewCase,
    now: i64,
) -> Result<Inserted, StoreError> {
    let state: Option<String> = sqlx::query_scalar("SELECT state FROM cases WHERE id = ?")
        .bind(new.id.to_string())
        .fetch_optional(&mut *connection)
        .await?;
    if state.as_deref().is_some_and(|state| state != "failed") {
        return Ok(Inserted::Exists);
    }
    if jobs::waiting(connection).await? >= new.queue_limit {
        return Ok(Inserted::QueueFull);
    }
    if state.is_none() {
        insert_row(connection, new, now).await?;
    } else {
        queue_again(connection, &new.id).await?;
    }
    if !refer(connection, &new.id, &new.sources, now).await? {
        return Ok(Inserted::PinLost);
    }
    jobs::insert(connection, &new.id, now).await?;
    Ok(if state.is_none() {
        Inserted::Created
    } else {
        Inserted::Requeued
    })
}

async fn insert_row(
    connection: &mut SqliteConnection,
    new: &NewCase,
    now: i64,
) -> Result<(), StoreError> {
    sqlx::query(
        "INSERT INTO cases (id, closing_radius_mm, parameters, name, state, created_at, previous)
         VALUES (?, ?, ?, ?, 'queued', ?, (SELECT id FROM cases WHERE id = ?))",
    )
    .bind(new.id.to_string())
    .bind(new.parameters.closing_radius_mm)
    .bind(without_columns(&new.parameters)?)
    .bind(&new.parameters.name)
    .bind(now)
    .bind(new.previous.map(|id| id.to_string()))
    .execute(connection)
    .await?;
    Ok(())
}

/// The parameters that have no column of their own, as JSON.
fn without_columns(parameters: &Parameters) -> Result<String, StoreError> {
    let mut json = serde_json::to_value(parameters)?;
    if let Some(members) = json.as_object_mut() {
        members.remove("closing_radius_mm");
        members.remove("name");
    }
    Ok(json.to_string())
}

/// The parameters of a row with the columns `closing_radius_mm`, `parameters` and `name`.
pub(super) fn read_parameters(row: &SqliteRow) -> Result<Parameters, StoreError> {
    let others: String = row.try_get("parameters")?;
    Ok(Parameters {
        closing_radius_mm: row.try_get("closing_radius_mm")?,
        name: row.try_get("name")?,
        ..serde_json::from_str(&others)?
    })
}

async fn queue_again(connection: &mut SqliteConnection, id: &CaseId) -> Result<(), StoreError> {
    sqlx::query("UPDATE cases SET state = 'queued', failure = NULL, facts = NULL, facts_digest = NULL WHERE id = ?")
        .bind(id.to_string())
        .execute(connection)
        .await?;
    Ok(())
}

/// Turns pins into references of a case; `false` where a pin has gone. What the case ceases to need is abandoned.
pub(super) async fn refer(
    connection: &mut SqliteConnection,
    id: &CaseId,
    pinned: &Pinned,
    now: i64,
) -> Result<bool, StoreError> {
    if !pins::consume(connection, pinned).await? {
        return Ok(false);
    }
    let before = objects(&mut *connection, id).await?;
    for name in &pinned.names {
        sqlx::query(
            "INSERT INTO case_objects (case_id, kind, digest) VALUES (?, ?, ?)
             ON CONFLICT DO UPDATE SET digest = excluded.digest",
        )
        .bind(id.to_string())
        .bind(name.kind.name())
        .bind(name.digest.to_string())
        .execute(&mut *connection)
        .await?;
    }
    let after = objects(&mut *connection, id).await?;
    let dropped = before.into_iter().filter(|name| !after.contains(name));
    pins::abandon(connection, dropped.collect(), now).await?;
    Ok(true)
}

pub(super) async fn is_ready(
    connection: &mut SqliteConnection,
    id: &CaseId,
) -> Result<bool, StoreError> {
    let ready =
        sqlx::query_scalar("SELECT EXISTS (SELECT 1 FROM cases WHERE id = ? AND state = 'ready')")
            .bind(id.to_string())
            .fetch_one(connection)
            .await?;
    Ok(ready)
}

pub(super) async fn make_ready(
    connection: &mut SqliteConnection,
    id: &CaseId,
    facts: &CaseFacts,
) -> Result<(), StoreError> {
    let facts = serde_json::to_string(facts)?;
    sqlx::query(
        "UPDATE cases SET state = 'ready', facts = ?, facts_digest = ?, failure = NULL WHERE id = ?",
    )
    .bind(&facts)
    .bind(upkeep::digest(&facts))
    .bind(id.to_string())
    .execute(connection)
    .await?;
    Ok(())
}

pub(super) async fn make_failed(
    connection: &mut SqliteConnection,
    id: &CaseId,
    failure: &Failure,
) -> Result<(), StoreError> {
    sqlx::query("UPDATE cases SET state = 'failed', failure = ?, facts = NULL, facts_digest = NULL WHERE id = ?")
        .bind(serde_json::to_string(failure)?)
        .bind(id.to_string())
        .execute(connection)
        .await?;
    Ok(())
}

pub(super) async fn rename(
    connection: &mut SqliteConnection,
    id: &CaseId,
    name: &str,
) -> Result<(), StoreError> {
    sqlx::query("UPDATE cases SET name = ? WHERE id = ?")
        .bind(name)
        .bind(id.to_string())
        .execute(connection)
        .await?;
    Ok(())
}

pub(super) async fn delete(
    connection: &mut SqliteConnection,
    id: &CaseId,
    now: i64,
) -> Result<bool, StoreError> {
    let needed = objects(&mut *connection, id).await?;
    pins::abandon(connection, needed, now).await?;
    // Its versions become those of the case that it is itself a version of.
    sqlx::query("UPDATE cases SET previous = (SELECT previous FROM cases WHERE id = ?1) WHERE previous = ?1")
        .bind(id.to_string())
        .execute(&mut *connection)
        .await?;
    // The job and the references go with the case (ON DELETE CASCADE).
    let deleted = sqlx::query("DELETE FROM cases WHERE id = ?")
        .bind(id.to_string())
        .execute(connection)
        .await?;
    Ok(deleted.rows_affected() > 0)
}

pub(super) async fn objects<'e>(
    executor: impl sqlx::SqliteExecutor<'e>,
    id: &CaseId,
) -> Result<Vec<ObjectName>, StoreError> {
    let rows: Vec<(String, String)> =
        sqlx::query_as("SELECT kind, digest FROM case_objects WHERE case_id = ? ORDER BY kind")
            .bind(id.to_string())
            .fetch_all(executor)
            .await?;
    rows.iter().map(pins::read_name).collect()
}

pub(super) async fn one(pool: &SqlitePool, id: &CaseId) -> Result<Option<Case>, StoreError> {
    let row = sqlx::query(select_case!("WHERE id = ?"))
        .bind(id.to_string())
        .fetch_optional(pool)
        .await?;
    row.as_ref().map(read).transpose()
}

pub(super) async fn page(
    pool: &SqlitePool,
    after: Option<&Cursor>,
    limit: usize,
) -> Result<Page, StoreError> {
    let (created_at, id) = match after {
        Some(cursor) => (cursor.created_at.as_microsecond(), cursor.id.to_string()),
        None => (i64::MAX, String::new()),
    };
    let rows = sqlx::query(select_case!(
        "WHERE (created_at, id) < (?, ?) ORDER BY created_at DESC, id DESC LIMIT ?"
    ))
    .bind(created_at)
    .bind(id)
    .bind(i64::try_from(limit.saturating_add(1)).unwrap_or(i64::MAX))
    .fetch_all(pool)
    .await?;
    let mut cases = rows.iter().map(read).collect::<Result<Vec<_>, _>>()?;
    let more = cases.len() > limit;
    cases.truncate(limit);
    let next = cases.last().filter(|_| more).map(Cursor::after);
    Ok(Page { cases, next })
}

fn read(row: &SqliteRow) -> Result<Case, StoreError> {
    let unreadable =
        |what: &str| StoreError::Rows(format!("a case's row has an unknown {what}").into());
    let id: String = row.try_get("id")?;
    let state: String = row.try_get("state")?;
    let failure: Option<String> = row.try_get("failure")?;
    let facts: Option<String> = row.try_get("facts")?;
    let id = CaseId::parse(&id).ok_or_else(|| unreadable("id"))?;
    let digest: Option<String> = row.try_get("facts_digest")?;
    if facts.as_deref().map(upkeep::digest) != digest {
        return Err(StoreError::DamagedFacts(id));
    }
    let [previous, next]: [Option<String>; 2] = [row.try_get("previous")?, row.try_get("next")?];
    let versions = |ids: Option<String>| {
        let ids = ids.unwrap_or_default();
        let ids = ids.split(',').filter(|id| !id.is_empty());
        ids.map(|id| CaseId::parse(id).ok_or_else(|| unreadable("version")))
            .collect::<Result<Vec<_>, _>>()
    };
    let created_at = Timestamp::from_microsecond(row.try_get("created_at")?);
    Ok(Case {
        id,
        parameters: read_parameters(row)?,
        state: read_state(&state).ok_or_else(|| unreadable("state"))?,
        progress: read_progress(row)?,
        failure: failure
            .as_deref()
            .map(serde_json::from_str::<Failure>)
            .transpose()?,
        facts: facts
            .as_deref()
            .map(serde_json::from_str::<CaseFacts>)
            .transpose()?,
        previous: versions(previous)?.pop(),
        next: versions(next)?,
        created_at: created_at.map_err(|_| unreadable("time"))?,
    })
}

fn read_state(name: &str) -> Option<CaseState> {
    match name {
        "queued" => Some(CaseState::Queued),
        "preparing" => Some(CaseState::Preparing),
        "ready" => Some(CaseState::Ready),
        "failed" => Some(CaseState::Failed),
        _ => None,
    }
}

fn read_progress(row: &SqliteRow) -> Result<Option<Progress>, StoreError> {
    let stage: Option<String> = row.try_get("stage")?;
    let fraction: Option<f32> = row.try_get("fraction")?;
    let stage = stage.as_deref().and_then(Stage::from_name);
    Ok(stage
        .zip(fraction)
        .map(|(stage, fraction)| Progress { stage, fraction }))
}
