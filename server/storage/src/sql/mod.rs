//! Rows in an SQL database: a file of SQLite, or PostgreSQL.
//!
//! The statements are written once ([`connection`]); the differences are in [`sqlite`] and [`postgres`]. Writing
//! transactions come one after another in both. The time of a transaction is read from the database inside of it, in
//! microseconds since 1970.

pub(crate) mod cases;
mod claims;
pub(crate) mod connection;
mod deletion;
pub(crate) mod expiry;
mod fence;
mod findings;
pub(crate) mod jobs;
pub(crate) mod layers;
pub(crate) mod made;
mod owners;
pub(crate) mod pins;
mod postgres;
pub(crate) mod preferences;
mod readings;
pub(crate) mod series;
mod sqlite;
mod store_id;
mod tombstones;
pub(crate) mod upkeep;

use crate::args;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::Duration;

use sqlx::migrate::{Migrate, MigrateError, Migration, MigrationType, Migrator};
use sqlx::postgres::PgConnectOptions;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{Pool, SqlSafeStr as _};

pub(crate) use self::connection::microseconds;
use self::connection::{Connection, Database, Migrations, Tables, Way};
use super::StoreError;

/// Development versions numbered their steps from 1 to 199.
const SQLITE: &Migrations = &[
    (
        200,
        "store",
        include_str!("../../migrations/sqlite/0200_store.sql"),
    ),
    (
        220,
        "readings",
        include_str!("../../migrations/sqlite/0220_readings.sql"),
    ),
    (
        240,
        "worklist",
        include_str!("../../migrations/sqlite/0240_worklist.sql"),
    ),
    (
        250,
        "preferences",
        include_str!("../../migrations/sqlite/0250_preferences.sql"),
    ),
];

const POSTGRES: &Migrations = &[
    (
        200,
        "store",
        include_str!("../../migrations/postgres/0200_store.sql"),
    ),
    (
        220,
        "readings",
        include_str!("../../migrations/postgres/0220_readings.sql"),
    ),
    (
        240,
        "worklist",
        include_str!("../../migrations/postgres/0240_worklist.sql"),
    ),
    (
        250,
        "preferences",
        include_str!("../../migrations/postgres/0250_preferences.sql"),
    ),
];

/// Rows in a file of SQLite, in memory, or in PostgreSQL.
#[derive(Debug, Clone)]
pub(crate) struct Rows {
    pub(crate) database: Database,
    tables: Arc<dyn Tables>,
    /// An offset of the clock in microseconds, for tests of leases; otherwise 0.
    ahead_us: Arc<AtomicI64>,
}

impl Rows {
    /// Opens a database file; creates and migrates it where necessary.
    ///
    /// # Errors
    /// If the file cannot be used, or was written by a newer version.
    pub(crate) async fn sqlite(file: &Path, tables: Arc<dyn Tables>) -> Result<Self, StoreError> {
        Self::on_sqlite(sqlite::in_file(file), sqlite::CONNECTIONS, tables).await
    }

    /// A database in memory, which ends with its last user.
    ///
    /// # Errors
    /// If there is no memory for it.
    pub(crate) async fn in_memory(tables: Arc<dyn Tables>) -> Result<Self, StoreError> {
        Self::on_connections(sqlite::Connections::in_memory().await?, tables).await
    }

    async fn on_sqlite(
        options: SqliteConnectOptions,
        connections: u32,
        tables: Arc<dyn Tables>,
    ) -> Result<Self, StoreError> {
        let connections = sqlite::Connections::open(options, connections).await?;
        Self::on_connections(connections, tables).await
    }

    async fn on_connections(
        connections: sqlite::Connections,
        tables: Arc<dyn Tables>,
    ) -> Result<Self, StoreError> {
        let [of_tables, _] = tables.migrations();
        migrate([SQLITE, of_tables], connections.pool()).await?;
        Self::of(Database::Sqlite(connections), tables)
            .completed()
            .await
    }

    /// Whether a database has the tables of a store.
    ///
    /// # Errors
    /// If it cannot be reached.
    pub(crate) async fn is_in_postgres(options: PgConnectOptions) -> Result<bool, StoreError> {
        postgres::has_cases(options).await
    }

    /// Opens a database that exists; creates and migrates the tables where necessary.
    ///
    /// # Errors
    /// If it cannot be reached or used, or was written by a newer version.
    pub(crate) async fn postgres(
        options: PgConnectOptions,
        tables: Arc<dyn Tables>,
    ) -> Result<Self, StoreError> {
        let connections = postgres::open(options).await?;
        // One process migrates at a time: the migrator takes a lock.
        let [_, of_tables] = tables.migrations();
        migrate([POSTGRES, of_tables], connections.pool()).await?;
        Self::of(Database::Postgres(connections), tables)
            .completed()
            .await
    }

    /// The rows, once they have what a migration left to the program.
    async fn completed(self) -> Result<Self, StoreError> {
        while cases::write_keys(&self).await? {}
        Ok(self)
    }

    fn of(database: Database, tables: Arc<dyn Tables>) -> Self {
        Self {
            database,
            tables,
            ahead_us: Arc::default(),
        }
    }

    /// Lets time pass on the clock of these rows and their clones.
    #[cfg(any(test, feature = "testing"))]
    pub(crate) fn pass_time(&self, by: Duration) {
        self.ahead_us.fetch_add(microseconds(by), Ordering::Relaxed);
    }

    /// How much time was let pass.
    pub(crate) fn ahead(&self) -> Duration {
        let ahead = self.ahead_us.load(Ordering::Relaxed);
        Duration::from_micros(ahead.max(0).unsigned_abs())
    }

    /// A connection on which each statement is a transaction.
    pub(crate) async fn connect(&self) -> Result<Connection, StoreError> {
        Ok(self.connection(self.database.connect().await?))
    }

    fn connection(&self, way: Way) -> Connection {
        let ahead = self.ahead_us.load(Ordering::Relaxed);
        Connection::new(way, Arc::clone(&self.tables), ahead)
    }

    /// Ends every lease and expires every pin, because no other process runs that could hold one.
    pub(crate) async fn forget_holders(&self) -> Result<(), StoreError> {
        let (mut transaction, now) = self.write().await?;
        for sql in [
            "UPDATE jobs SET lease_until = $1 WHERE state IN ('queued', 'running') AND lease_until > $1",
            "UPDATE pins SET expires_at = $1",
            "UPDATE tombstones SET lease_until = $1",
        ] {
            transaction.execute(sql, args![now]).await?;
        }
        transaction.commit().await?;
        self.database.empty_log().await;
        Ok(())
    }

    /// Begins a writing transaction; with it the time.
    pub(crate) async fn write(&self) -> Result<(Connection, i64), StoreError> {
        let mut transaction = self.connection(self.database.begin().await?);
        let now = transaction.now().await?;
        Ok((transaction, now))
    }
}

/// Migrates the tables. Tables of a newer version are not changed.
async fn migrate<D: sqlx::Database>(
    migrations: [&'static Migrations; 2],
    pool: &Pool<D>,
) -> Result<(), StoreError>
where
    D::Connection: Migrate,
{
    let migrations = migrations.concat();
    let versions = || migrations.iter().map(|&(version, ..)| version);
    let first = versions().min().unwrap_or_default();
    let known = versions().max().unwrap_or_default();
    let steps = migrations.iter().map(|&(version, name, statements)| {
        let (kind, statements) = (MigrationType::Simple, statements.into_sql_str());
        Migration::new(version, name.into(), kind, statements, false)
    });
    let migrator = Migrator::with_migrations(steps.collect());
    migrator.run(pool).await.map_err(|error| match error {
        MigrateError::VersionMissing(found) if found > first => {
            StoreError::NewerSchema { found, known }
        }
        MigrateError::VersionMissing(_) | MigrateError::VersionMismatch(_) => {
            StoreError::DevelopmentSchema
        }
        other => other.into(),
    })
}
