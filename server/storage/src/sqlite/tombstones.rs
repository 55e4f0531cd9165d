//! Tombstones: what is being removed, and by whom.

use sqlx::sqlite::SqliteConnection;

use super::{microseconds, pins};
use crate::rows::Sweep;
use crate::{ObjectName, StoreError};

/// Whether one of the objects has a tombstone.
pub(super) async fn any_of(
    connection: &mut SqliteConnection,
    names: &[ObjectName],
) -> Result<bool, StoreError> {
    for name in names {
        let marked: bool = sqlx::query_scalar(
            "SELECT EXISTS (SELECT 1 FROM tombstones WHERE kind = ? AND digest = ?)",
        )
        .bind(name.kind.name())
        .bind(name.digest.to_string())
        .fetch_one(&mut *connection)
        .await?;
        if marked {
            return Ok(true);
        }
    }
    Ok(false)
}

pub(super) async fn abandoned(
    connection: &mut SqliteConnection,
    now: i64,
    limit: usize,
) -> Result<Vec<ObjectName>, StoreError> {
    let rows: Vec<(String, String)> = sqlx::query_as(
        "SELECT kind, digest FROM pins WHERE expires_at <= ?1
         UNION SELECT kind, digest FROM tombstones WHERE lease_until <= ?1 LIMIT ?2",
    )
    .bind(now)
    .bind(i64::try_from(limit).unwrap_or(i64::MAX))
    .fetch_all(connection)
    .await?;
    rows.iter().map(pins::read_name).collect()
}

pub(super) async fn mark(
    connection: &mut SqliteConnection,
    names: &[ObjectName],
    sweep: &Sweep,
    now: i64,
) -> Result<Vec<ObjectName>, StoreError> {
    let mut marked = Vec::new();
    for name in names {
        forget_expired_pins(connection, name, now).await?;
        if !is_needed(connection, name).await? && take(connection, name, sweep, now).await? {
            marked.push(*name);
        }
    }
    Ok(marked)
}

async fn forget_expired_pins(
    connection: &mut SqliteConnection,
    name: &ObjectName,
    now: i64,
) -> Result<(), StoreError> {
    sqlx::query("DELETE FROM pins WHERE kind = ? AND digest = ? AND expires_at <= ?")
        .bind(name.kind.name())
        .bind(name.digest.to_string())
        .bind(now)
        .execute(connection)
        .await?;
    Ok(())
}

/// Whether a case refers to the object, or a pin that is left protects it.
async fn is_needed(
    connection: &mut SqliteConnection,
    name: &ObjectName,
) -> Result<bool, StoreError> {
    let needed: bool = sqlx::query_scalar(
        "SELECT EXISTS (SELECT 1 FROM case_objects WHERE kind = ?1 AND digest = ?2)
             OR EXISTS (SELECT 1 FROM pins WHERE kind = ?1 AND digest = ?2)",
    )
    .bind(name.kind.name())
    .bind(name.digest.to_string())
    .fetch_one(connection)
    .await?;
    Ok(needed)
}

/// Leaves a tombstone, or takes over one whose lease has ended; whether it is the sweep's own now.
async fn take(
    connection: &mut SqliteConnection,
    name: &ObjectName,
    sweep: &Sweep,
    now: i64,
) -> Result<bool, StoreError> {
    let taken = sqlx::query(
        "INSERT INTO tombstones (kind, digest, holder, lease_until) VALUES (?1, ?2, ?3, ?4)
         ON CONFLICT DO UPDATE SET holder = excluded.holder, lease_until = excluded.lease_until
         WHERE tombstones.lease_until <= ?5",
    )
    .bind(name.kind.name())
    .bind(name.digest.to_string())
    .bind(&sweep.holder)
    .bind(now + microseconds(sweep.lease))
    .bind(now)
    .execute(connection)
    .await?;
    Ok(taken.rows_affected() > 0)
}

pub(super) async fn bury(
    connection: &mut SqliteConnection,
    holder: &str,
) -> Result<(), StoreError> {
    sqlx::query("DELETE FROM tombstones WHERE holder = ?")
        .bind(holder)
        .execute(connection)
        .await?;
    Ok(())
}

pub(super) async fn end_leases(
    connection: &mut SqliteConnection,
    now: i64,
) -> Result<(), StoreError> {
    sqlx::query("UPDATE tombstones SET lease_until = ?")
        .bind(now)
        .execute(connection)
        .await?;
    Ok(())
}
