//! Digests that protect the facts of cases.

use super::connection::Database;
use crate::StoreError;
use case::CaseId;

/// The digest of facts, as it is stored beside them.
pub(super) fn digest(facts: &str) -> String {
    blake3::hash(facts.as_bytes()).to_string()
}

/// Gives rows of an earlier version their digests.
pub(super) async fn add_missing_digests(database: &Database) -> Result<(), StoreError> {
    let mut transaction = database.begin().await?;
    let rows = transaction
        .query("SELECT id, facts FROM cases WHERE facts IS NOT NULL AND facts_digest IS NULL")
        .fetch_all()
        .await?;
    for row in rows {
        let [id, facts]: [String; 2] = [row.get("id")?, row.get("facts")?];
        transaction
            .query("UPDATE cases SET facts_digest = $1 WHERE id = $2")
            .bind(digest(&facts))
            .bind(id)
            .execute()
            .await?;
    }
    transaction.commit().await
}

/// Queues a case again whose facts are damaged: they are made again from the source.
pub(super) async fn prepare_again(database: &Database, id: &CaseId) -> Result<(), StoreError> {
    tracing::error!(
        "the facts of a case are damaged; the case will be prepared again from its source"
    );
    let mut transaction = database.begin().await?;
    transaction
        .query("UPDATE cases SET state = 'queued', facts = NULL, facts_digest = NULL WHERE id = $1")
        .bind(id.to_string())
        .execute()
        .await?;
    transaction
        .query(
            "INSERT INTO jobs (case_id, queued_at, available_at)
             SELECT id, created_at, created_at FROM cases WHERE id = $1
             ON CONFLICT DO NOTHING",
        )
        .bind(id.to_string())
        .execute()
        .await?;
    transaction.commit().await
}
