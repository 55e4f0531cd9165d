//! What keeps the file sound: a check when it is opened, a digest of each case's facts, and nothing left of what was deleted.

use sqlx::Row as _;
use sqlx::sqlite::SqlitePool;

use crate::StoreError;
use case::CaseId;

/// Whether the file's structure is whole.
///
/// # Errors
/// When it is not, in SQLite's words.
pub(super) async fn check_file(pool: &SqlitePool) -> Result<(), StoreError> {
    let found: String = sqlx::query_scalar("PRAGMA quick_check(1)")
        .fetch_one(pool)
        .await?;
    match found.as_str() {
        "ok" => Ok(()),
        fault => Err(StoreError::DamagedFile(fault.to_owned())),
    }
}

/// Writes the log into the file and empties it. What was deleted is in neither from then on (`secure_delete` has overwritten it).
///
/// What fails is done at the next deletion, or when the file is opened or closed.
pub(super) async fn empty_log(pool: &SqlitePool) {
    let emptied = sqlx::query("PRAGMA wal_checkpoint(TRUNCATE)")
        .fetch_one(pool)
        .await;
    match emptied.and_then(|row| row.try_get::<i64, _>(0)) {
        Ok(0) => {}
        Ok(_) => tracing::warn!("the database's log is emptied later: somebody reads it"),
        Err(error) => tracing::warn!(%error, "the database's log is emptied later"),
    }
}

/// The digest of facts, as it is stored beside them.
pub(super) fn digest(facts: &str) -> String {
    blake3::hash(facts.as_bytes()).to_string()
}

/// Gives rows of an earlier version their digests.
pub(super) async fn add_missing_digests(pool: &SqlitePool) -> Result<(), StoreError> {
    let mut transaction = pool.begin_with("BEGIN IMMEDIATE").await?;
    let rows: Vec<(String, String)> = sqlx::query_as(
        "SELECT id, facts FROM cases WHERE facts IS NOT NULL AND facts_digest IS NULL",
    )
    .fetch_all(&mut *transaction)
    .await?;
    for (id, facts) in rows {
        sqlx::query("UPDATE cases SET facts_digest = ? WHERE id = ?")
            .bind(digest(&facts))
            .bind(id)
            .execute(&mut *transaction)
            .await?;
    }
    Ok(transaction.commit().await?)
}

/// Queues a case again whose facts are damaged: they are made again from the source.
pub(super) async fn prepare_again(pool: &SqlitePool, id: &CaseId) -> Result<(), StoreError> {
    tracing::error!(
        "the facts of a case are damaged, for their digest is wrong: it is prepared again from its source"
    );
    let mut transaction = pool.begin_with("BEGIN IMMEDIATE").await?;
    sqlx::query(
        "UPDATE cases SET state = 'queued', facts = NULL, facts_digest = NULL WHERE id = ?",
    )
    .bind(id.to_string())
    .execute(&mut *transaction)
    .await?;
    sqlx::query(
        "INSERT INTO jobs (case_id, queued_at, available_at)
         SELECT id, created_at, created_at FROM cases WHERE id = ?
         ON CONFLICT DO NOTHING",
    )
    .bind(id.to_string())
    .execute(&mut *transaction)
    .await?;
    Ok(transaction.commit().await?)
}
