//! Pins: what keeps an object from being removed while no case needs it yet.

use async_trait::async_trait;
use jiff::Timestamp;
use sqlx::sqlite::{SqliteConnection, SqlitePool};
use sqlx::{Sqlite, Transaction};

use crate::rows::{Pinned, Removal};
use crate::{ObjectName, StoreError};

pub(super) async fn insert(
    connection: &mut SqliteConnection,
    pinned: &Pinned,
    until: Timestamp,
) -> Result<(), StoreError> {
    for name in &pinned.names {
        sqlx::query(
            "INSERT INTO pins (kind, digest, holder, expires_at) VALUES (?, ?, ?, ?)
             ON CONFLICT DO UPDATE SET expires_at = excluded.expires_at",
        )
        .bind(name.kind.name())
        .bind(name.digest.to_string())
        .bind(&pinned.holder)
        .bind(until.as_microsecond())
        .execute(&mut *connection)
        .await?;
    }
    Ok(())
}

pub(super) async fn expire(
    connection: &mut SqliteConnection,
    pinned: &Pinned,
    now: Timestamp,
) -> Result<(), StoreError> {
    sqlx::query("UPDATE pins SET expires_at = ? WHERE holder = ?")
        .bind(now.as_microsecond())
        .bind(&pinned.holder)
        .execute(connection)
        .await?;
    Ok(())
}

pub(super) async fn expire_all(
    connection: &mut SqliteConnection,
    now: Timestamp,
) -> Result<(), StoreError> {
    sqlx::query("UPDATE pins SET expires_at = ?")
        .bind(now.as_microsecond())
        .execute(connection)
        .await?;
    Ok(())
}

/// Takes the holder's pins away; `false` where one of them has gone already.
pub(super) async fn consume(
    connection: &mut SqliteConnection,
    pinned: &Pinned,
) -> Result<bool, StoreError> {
    for name in &pinned.names {
        let taken = sqlx::query("DELETE FROM pins WHERE kind = ? AND digest = ? AND holder = ?")
            .bind(name.kind.name())
            .bind(name.digest.to_string())
            .bind(&pinned.holder)
            .execute(&mut *connection)
            .await?;
        if taken.rows_affected() == 0 {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Leaves an expired pin on an object that may not be needed any more, so that it is looked at.
pub(super) async fn abandon(
    connection: &mut SqliteConnection,
    names: Vec<ObjectName>,
    now: Timestamp,
) -> Result<(), StoreError> {
    let abandoned = Pinned {
        holder: "nobody".to_owned(),
        names,
    };
    insert(connection, &abandoned, now).await
}

pub(super) async fn expired(
    pool: &SqlitePool,
    now: Timestamp,
    limit: usize,
) -> Result<Vec<ObjectName>, StoreError> {
    let rows: Vec<(String, String)> =
        sqlx::query_as("SELECT DISTINCT kind, digest FROM pins WHERE expires_at <= ? LIMIT ?")
            .bind(now.as_microsecond())
            .bind(i64::try_from(limit).unwrap_or(i64::MAX))
            .fetch_all(pool)
            .await?;
    rows.iter().map(read_name).collect()
}

pub(super) fn read_name((kind, digest): &(String, String)) -> Result<ObjectName, StoreError> {
    ObjectName::parse(kind, digest)
        .ok_or_else(|| StoreError::Rows("a row names an object of an unknown kind".into()))
}

/// A removal inside of a writing transaction: the database's own lock keeps everybody else from pinning.
pub(super) struct PinnedRemoval {
    transaction: Transaction<'static, Sqlite>,
    candidates: Vec<ObjectName>,
    removable: Vec<ObjectName>,
    now: Timestamp,
}

impl PinnedRemoval {
    pub(super) async fn begin(
        mut transaction: Transaction<'static, Sqlite>,
        names: &[ObjectName],
        now: Timestamp,
    ) -> Result<Self, StoreError> {
        let mut removable = Vec::new();
        for name in names {
            if !is_needed(&mut transaction, name, now).await? {
                removable.push(*name);
            }
        }
        Ok(Self {
            transaction,
            candidates: names.to_vec(),
            removable,
            now,
        })
    }
}

async fn is_needed(
    connection: &mut SqliteConnection,
    name: &ObjectName,
    now: Timestamp,
) -> Result<bool, StoreError> {
    let needed: bool = sqlx::query_scalar(
        "SELECT EXISTS (SELECT 1 FROM case_objects WHERE kind = ?1 AND digest = ?2)
             OR EXISTS (SELECT 1 FROM pins WHERE kind = ?1 AND digest = ?2 AND expires_at > ?3)",
    )
    .bind(name.kind.name())
    .bind(name.digest.to_string())
    .bind(now.as_microsecond())
    .fetch_one(connection)
    .await?;
    Ok(needed)
}

#[async_trait]
impl Removal for PinnedRemoval {
    fn names(&self) -> &[ObjectName] {
        &self.removable
    }

    async fn finish(mut self: Box<Self>) -> Result<(), StoreError> {
        for name in &self.candidates {
            sqlx::query("DELETE FROM pins WHERE kind = ? AND digest = ? AND expires_at <= ?")
                .bind(name.kind.name())
                .bind(name.digest.to_string())
                .bind(self.now.as_microsecond())
                .execute(&mut *self.transaction)
                .await?;
        }
        Ok(self.transaction.commit().await?)
    }
}
