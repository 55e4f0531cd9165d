//! Pins, which protect objects that no case references yet.

use super::connection::{Connection, Row};
use crate::args;
use crate::rows::Pinned;
use crate::{ObjectName, StoreError};

/// The holder of expired pins on objects that may be unneeded.
const NOBODY: &str = "nobody";

pub(super) async fn insert(
    connection: &mut Connection,
    pinned: &Pinned,
    until: i64,
) -> Result<(), StoreError> {
    for name in &pinned.names {
        connection
            .execute(
                "INSERT INTO pins (kind, digest, holder, expires_at) VALUES ($1, $2, $3, $4)
             ON CONFLICT (kind, digest, holder) DO UPDATE SET expires_at = excluded.expires_at",
                args![
                    name.kind.name(),
                    name.digest.to_string(),
                    &pinned.holder,
                    until
                ],
            )
            .await?;
    }
    Ok(())
}

pub(super) async fn expire(
    connection: &mut Connection,
    pinned: &Pinned,
    now: i64,
) -> Result<(), StoreError> {
    connection
        .execute(
            "UPDATE pins SET expires_at = $1 WHERE holder = $2",
            args![now, &pinned.holder],
        )
        .await?;
    Ok(())
}

pub(super) async fn expire_all(connection: &mut Connection, now: i64) -> Result<(), StoreError> {
    connection
        .execute("UPDATE pins SET expires_at = $1", args![now])
        .await?;
    Ok(())
}

/// Takes the holder's pins away; `false` if one of them has gone already.
pub async fn consume(connection: &mut Connection, pinned: &Pinned) -> Result<bool, StoreError> {
    for name in &pinned.names {
        let taken = connection
            .execute(
                "DELETE FROM pins WHERE kind = $1 AND digest = $2 AND holder = $3",
                args![name.kind.name(), name.digest.to_string(), &pinned.holder],
            )
            .await?;
        if taken == 0 {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Takes the pins of all writers away, who write their objects again. Those of objects that are to be removed stay.
pub(super) async fn forget_writers(connection: &mut Connection) -> Result<(), StoreError> {
    connection
        .execute("DELETE FROM pins WHERE holder <> $1", args![NOBODY])
        .await?;
    Ok(())
}

/// Leaves an expired pin on an object that may be unneeded, so that a sweep checks it.
pub async fn abandon(
    connection: &mut Connection,
    names: Vec<ObjectName>,
    now: i64,
) -> Result<(), StoreError> {
    let abandoned = Pinned {
        holder: NOBODY.to_owned(),
        names,
    };
    insert(connection, &abandoned, now).await
}

/// The name in a row with the columns `kind` and `digest`.
pub(super) fn read_name(row: &Row) -> Result<ObjectName, StoreError> {
    let [kind, digest]: [String; 2] = [row.get("kind")?, row.get("digest")?];
    ObjectName::parse(&kind, &digest)
        .ok_or_else(|| StoreError::Rows("a row names an object of an unknown kind".into()))
}
