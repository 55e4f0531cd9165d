//! Leases for rebuilding the derived objects of a case.

use super::connection::Connection;
use crate::StoreError;
use case::CaseId;

/// Takes the rebuild of a case, or keeps it; `false` if another one has it, or there is no such case.
pub(super) async fn take(
    connection: &mut Connection,
    id: &CaseId,
    holder: &str,
    [now, until]: [i64; 2],
) -> Result<bool, StoreError> {
    let taken = connection
        .query(
            "INSERT INTO rebuilds (case_id, holder, lease_until) SELECT id, $2, $3 FROM cases WHERE id = $1
             ON CONFLICT (case_id) DO UPDATE SET holder = excluded.holder, lease_until = excluded.lease_until
             WHERE rebuilds.lease_until <= $4 OR rebuilds.holder = excluded.holder",
        )
        .bind(id.to_string())
        .bind(holder)
        .bind(until)
        .bind(now)
        .execute()
        .await?;
    Ok(taken > 0)
}

pub(super) async fn end(
    connection: &mut Connection,
    id: &CaseId,
    holder: &str,
) -> Result<(), StoreError> {
    connection
        .query("DELETE FROM rebuilds WHERE case_id = $1 AND holder = $2")
        .bind(id.to_string())
        .bind(holder)
        .execute()
        .await?;
    Ok(())
}

pub(super) async fn end_all(connection: &mut Connection) -> Result<(), StoreError> {
    connection.query("DELETE FROM rebuilds").execute().await?;
    Ok(())
}
