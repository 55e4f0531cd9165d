//! What the upkeep of a store asks the rows: digests that protect the facts of cases, and how old the rows are.

use super::connection::Connection;
use super::{Rows, jobs};
use crate::StoreError;
use crate::args;
use crate::jobs::NewJob;
use case::CaseId;

/// The digest of facts, as it is stored beside them.
pub(super) fn digest(facts: &str) -> String {
    blake3::hash(facts.as_bytes()).to_string()
}

/// Queues a case again whose facts are damaged: they are made again from the source.
pub(super) async fn prepare_again(rows: &Rows, id: &CaseId) -> Result<(), StoreError> {
    tracing::error!(
        case = id.short(),
        "the facts of a case are damaged; the case will be prepared again from its source"
    );
    let (mut transaction, now) = rows.write().await?;
    let found = transaction
        .execute(
            "UPDATE cases SET state = 'queued', facts = NULL, facts_digest = NULL WHERE id = $1",
            args![id.to_string()],
        )
        .await?;
    if found > 0 {
        jobs::enqueue(&mut transaction, &NewJob::prepare(id), now).await?;
    }
    transaction.commit().await
}

/// Lets the age of a case count from now; whether it exists.
pub(super) async fn uploaded_again(
    connection: &mut Connection,
    id: &CaseId,
    now: i64,
) -> Result<bool, StoreError> {
    let changed = connection
        .execute(
            "UPDATE cases SET uploaded_at = $1 WHERE id = $2",
            args![now, id.to_string()],
        )
        .await?;
    Ok(changed > 0)
}

/// When the latest case, layer or finding was written; `None` if there is none.
pub(super) async fn newest_row(connection: &mut Connection) -> Result<Option<i64>, StoreError> {
    let row = connection
        .fetch_one(
            "SELECT max(at) AS newest FROM
               (SELECT max(COALESCE(uploaded_at, created_at)) AS at FROM cases
                UNION ALL SELECT max(created_at) FROM layers
                UNION ALL SELECT max(changed_at) FROM findings) AS times",
            args![],
        )
        .await?;
    row.get("newest")
}
