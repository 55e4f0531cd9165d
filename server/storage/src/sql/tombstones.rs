//! Tombstones, which mark objects that a sweep is removing.

use super::connection::{Connection, microseconds, read_name};
use crate::args;
use crate::rows::Sweep;
use crate::{ObjectName, Store, StoreError};

impl Store {
    /// At most `limit` objects that may have to be removed: with an expired pin, or with a tombstone whose lease has
    /// ended.
    pub(crate) async fn abandoned(&self, limit: usize) -> Result<Vec<ObjectName>, StoreError> {
        let mut connection = self.connect().await?;
        let now = connection.now().await?;
        let rows = connection
            .fetch_all(
                // A manifest goes before the sources that it names.
                "SELECT kind, digest FROM
                   (SELECT kind, digest FROM pins WHERE expires_at <= $1
                    UNION SELECT kind, digest FROM tombstones WHERE lease_until <= $1) AS unneeded
                 ORDER BY kind <> 'manifest' LIMIT $2",
                args![now, i64::try_from(limit).unwrap_or(i64::MAX)],
            )
            .await?;
        rows.iter().map(read_name).collect()
    }

    /// Leaves the sweep's tombstone on those of the given objects that no case needs, no live pin protects and no other
    /// live sweep removes, and forgets the expired pins of all of them. The objects with the sweep's tombstone are its
    /// own to delete.
    pub(crate) async fn mark(
        &self,
        names: &[ObjectName],
        sweep: &Sweep,
    ) -> Result<Vec<ObjectName>, StoreError> {
        let (mut transaction, now) = self.write().await?;
        let mut marked = Vec::new();
        for name in names {
            forget_expired_pins(&mut transaction, name, now).await?;
            if !is_needed(&mut transaction, name).await?
                && take(&mut transaction, name, sweep, now).await?
            {
                marked.push(*name);
            }
        }
        transaction.commit().await?;
        Ok(marked)
    }

    /// Removes the tombstones of a sweep after their objects are deleted, if the sweep still holds them.
    pub(crate) async fn remove_tombstones(&self, holder: &str) -> Result<(), StoreError> {
        let (mut transaction, _) = self.write().await?;
        transaction
            .execute("DELETE FROM tombstones WHERE holder = $1", args![holder])
            .await?;
        transaction.commit().await
    }

    /// Those of the given objects that no case needs, no pin protects and no sweep removes.
    pub(crate) async fn unneeded(
        &self,
        names: &[ObjectName],
    ) -> Result<Vec<ObjectName>, StoreError> {
        let mut connection = self.connect().await?;
        let mut unneeded = Vec::new();
        for name in names {
            if !is_needed(&mut connection, name).await?
                && !any_of(&mut connection, &[*name]).await?
            {
                unneeded.push(*name);
            }
        }
        Ok(unneeded)
    }
}

/// Whether one of the objects has a tombstone.
pub(super) async fn any_of(
    connection: &mut Connection,
    names: &[ObjectName],
) -> Result<bool, StoreError> {
    for name in names {
        let row = connection.fetch_one(
            "SELECT EXISTS (SELECT 1 FROM tombstones WHERE kind = $1 AND digest = $2) AS marked",
            args![name.kind.name(), name.digest.to_string()],
        )
        .await?;
        if row.get("marked")? {
            return Ok(true);
        }
    }
    Ok(false)
}

async fn forget_expired_pins(
    connection: &mut Connection,
    name: &ObjectName,
    now: i64,
) -> Result<(), StoreError> {
    connection
        .execute(
            "DELETE FROM pins WHERE kind = $1 AND digest = $2 AND expires_at <= $3",
            args![name.kind.name(), name.digest.to_string(), now],
        )
        .await?;
    Ok(())
}

/// Whether a case, a layer or a row of other tables refers to the object, or a pin that is left protects it.
async fn is_needed(connection: &mut Connection, name: &ObjectName) -> Result<bool, StoreError> {
    let row = connection
        .fetch_one(
            "SELECT EXISTS (SELECT 1 FROM case_objects WHERE kind = $1 AND digest = $2)
             OR EXISTS (SELECT 1 FROM layer_objects WHERE kind = $1 AND digest = $2)
             OR EXISTS (SELECT 1 FROM pins WHERE kind = $1 AND digest = $2) AS needed",
            args![name.kind.name(), name.digest.to_string()],
        )
        .await?;
    let tables = connection.tables();
    Ok(row.get("needed")? || tables.needs(connection, name).await?)
}

/// Leaves a tombstone, or takes over one whose lease has ended; whether it is the sweep's own now.
async fn take(
    connection: &mut Connection,
    name: &ObjectName,
    sweep: &Sweep,
    now: i64,
) -> Result<bool, StoreError> {
    let taken = connection.execute(
        "INSERT INTO tombstones (kind, digest, holder, lease_until) VALUES ($1, $2, $3, $4)
         ON CONFLICT (kind, digest) DO UPDATE SET holder = excluded.holder, lease_until = excluded.lease_until
         WHERE tombstones.lease_until <= $5",
        args![
            name.kind.name(), name.digest.to_string(), &sweep.holder,
            now + microseconds(sweep.lease), now,
        ],
    )
    .await?;
    Ok(taken > 0)
}
