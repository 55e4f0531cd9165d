//! Pins, which protect objects that no case references yet.

use std::time::Duration;

use super::connection::{Connection, microseconds};
use super::tombstones;
use crate::args;
use crate::rows::Pinned;
use crate::{ObjectName, Store, StoreError};

/// The holder of expired pins on objects that may be unneeded.
const NOBODY: &str = "nobody";

impl Store {
    /// Protects objects from removal for a time, before they are written. `false`, and nothing has changed, if one of
    /// them has a tombstone: try again once the tombstone is removed.
    pub(crate) async fn try_pin(
        &self,
        pinned: &Pinned,
        lease: Duration,
    ) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.write().await?;
        if tombstones::any_of(&mut transaction, &pinned.names).await? {
            return Ok(false);
        }
        insert(&mut transaction, pinned, now + microseconds(lease)).await?;
        transaction.commit().await?;
        Ok(true)
    }

    /// Makes pins expire at once, because the objects are not needed.
    pub(crate) async fn unpin(&self, pinned: &Pinned) -> Result<(), StoreError> {
        let (mut transaction, now) = self.write().await?;
        transaction
            .execute(
                "UPDATE pins SET expires_at = $1 WHERE holder = $2",
                args![now, &pinned.holder],
            )
            .await?;
        transaction.commit().await
    }
}

/// Forgets who was writing objects when the rows were saved from which they were restored: what was written may have been
/// acknowledged since, and no sweep must remove it. A process that is writing now writes again. The pins of objects that are to be
/// removed stay.
///
/// # Errors
/// If the rows cannot be written.
pub async fn forget_writers(store: &Store) -> Result<(), StoreError> {
    let (mut transaction, _) = store.write().await?;
    transaction
        .execute("DELETE FROM pins WHERE holder <> $1", args![NOBODY])
        .await?;
    transaction.commit().await
}

/// Pins objects that are there until the end of the transaction.
///
/// # Errors
/// If one of them is being removed, or the rows cannot be written.
pub async fn hold(
    transaction: &mut Connection,
    objects: &Pinned,
    now: i64,
) -> Result<(), StoreError> {
    if tombstones::any_of(transaction, &objects.names).await? {
        return Err(StoreError::Rows("an object is being removed".into()));
    }
    insert(transaction, objects, now).await
}

async fn insert(
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
