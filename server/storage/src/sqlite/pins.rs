//! Pins: what keeps an object from being removed while no case needs it yet.

use sqlx::sqlite::SqliteConnection;

use crate::rows::Pinned;
use crate::{ObjectName, StoreError};

pub(super) async fn insert(
    connection: &mut SqliteConnection,
    pinned: &Pinned,
    until: i64,
) -> Result<(), StoreError> {
    for name in &pinned.names {
        sqlx::query(
            "INSERT INTO pins (kind, digest, holder, expires_at) VALUES (?, ?, ?, ?)
             ON CONFLICT DO UPDATE SET expires_at = excluded.expires_at",
        )
        .bind(name.kind.name())
        .bind(name.digest.to_string())
        .bind(&pinned.holder)
        .bind(until)
        .execute(&mut *connection)
        .await?;
    }
    Ok(())
}

pub(super) async fn expire(
    connection: &mut SqliteConnection,
    pinned: &Pinned,
    now: i64,
) -> Result<(), StoreError> {
    sqlx::query("UPDATE pins SET expires_at = ? WHERE holder = ?")
        .bind(now)
        .bind(&pinned.holder)
        .execute(connection)
        .await?;
    Ok(())
}

pub(super) async fn expire_all(
    connection: &mut SqliteConnection,
    now: i64,
) -> Result<(), StoreError> {
    sqlx::query("UPDATE pins SET expires_at = ?")
        .bind(now)
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
    now: i64,
) -> Result<(), StoreError> {
    let abandoned = Pinned {
        holder: "nobody".to_owned(),
        names,
    };
    insert(connection, &abandoned, now).await
}

pub(super) fn read_name((kind, digest): &(String, String)) -> Result<ObjectName, StoreError> {
    ObjectName::parse(kind, digest)
        .ok_or_else(|| StoreError::Rows("a row names an object of an unknown kind".into()))
}
