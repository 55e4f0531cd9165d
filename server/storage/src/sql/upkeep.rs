//! Digests that protect the facts of cases.

use super::connection::Database;
use crate::StoreError;
use case::CaseId;

/// The digest of facts, as it is stored beside them.
pub(super) fn digest(facts: &str) -> String {
    blake3::hash(facts.as_bytes()).to_string()
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
