//! The numbers of leases, which are unique in a store: a greater one fences the others off.
//!
//! A lease may be lost in a power cut while its holder goes on elsewhere ([`Connection::commit_soon`]). So that no number is given twice, each is
//! at least the time at which its lease ends, in microseconds.

use super::connection::Connection;
use crate::StoreError;
use crate::args;

/// The next number, for a lease until a time.
pub(super) async fn next(connection: &mut Connection, until: i64) -> Result<i64, StoreError> {
    let row = connection
        .fetch_one(
            "UPDATE fence SET value = CASE WHEN value < $1 THEN $1 ELSE value + 1 END RETURNING value",
            args![until],
        )
        .await?;
    row.get("value")
}
