//! Rows in an SQL database: a file of SQLite, or PostgreSQL.
//!
//! The statements are written once ([`connection`]); the differences are in [`sqlite`] and [`postgres`]. Writing
//! transactions come one after another in both. The time of a transaction is read from the database inside of it, in
//! microseconds since 1970.

mod arrivals;
mod cases;
mod connection;
mod fence;
mod jobs;
mod layer_rows;
mod layers;
mod pacs;
mod pins;
mod postgres;
mod rebuilds;
mod result_rows;
mod results;
mod retrievals;
mod sqlite;
mod tombstones;
mod transfers;
mod upkeep;

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::Duration;

use async_trait::async_trait;
use futures_util::stream::BoxStream;
use sqlx::Pool;
use sqlx::migrate::{Migrate, MigrateError, Migrator};
use sqlx::postgres::PgConnectOptions;
use sqlx::sqlite::SqliteConnectOptions;

use self::connection::{Connection, Database, microseconds};
use super::rows::{
    CaseRows, Change, Claim, Inserted, LeaseTerms, NewCase, Pinned, Published, Release, Sweep,
};
use super::{Cursor, ObjectName, Page, StoreError};
use case::{Case, CaseFacts, CaseId, Failure, ObjectKind, Progress};

/// Rows in a file of SQLite, in memory, or in PostgreSQL.
#[derive(Debug, Clone)]
pub struct SqlRows {
    database: Database,
    /// An offset of the clock in microseconds, for tests of leases; otherwise 0.
    ahead_us: Arc<AtomicI64>,
}

impl SqlRows {
    /// Opens a database file; creates and migrates it where necessary.
    ///
    /// # Errors
    /// If the file cannot be used, or was written by a newer version.
    pub async fn sqlite(file: &Path) -> Result<Self, StoreError> {
        Self::on_sqlite(sqlite::in_file(file), sqlite::CONNECTIONS).await
    }

    /// A database in memory, which ends with its last user.
    ///
    /// # Errors
    /// If there is no memory for it.
    pub async fn in_memory() -> Result<Self, StoreError> {
        Self::on_connections(sqlite::Connections::in_memory().await?).await
    }

    async fn on_sqlite(
        options: SqliteConnectOptions,
        connections: u32,
    ) -> Result<Self, StoreError> {
        Self::on_connections(sqlite::Connections::open(options, connections).await?).await
    }

    async fn on_connections(connections: sqlite::Connections) -> Result<Self, StoreError> {
        migrate(&sqlx::migrate!("migrations/sqlite"), connections.pool()).await?;
        let rows = Self::of(Database::Sqlite(connections));
        upkeep::add_missing_digests(&rows.database).await?;
        Ok(rows)
    }

    /// Whether a database has the tables of a store.
    ///
    /// # Errors
    /// If it cannot be reached.
    pub async fn is_in_postgres(options: PgConnectOptions) -> Result<bool, StoreError> {
        postgres::has_cases(options).await
    }

    /// Opens a database that exists; creates and migrates the tables where necessary.
    ///
    /// # Errors
    /// If it cannot be reached or used, or was written by a newer version.
    pub async fn postgres(options: PgConnectOptions) -> Result<Self, StoreError> {
        let connections = postgres::open(options).await?;
        // One process migrates at a time: the migrator takes a lock.
        migrate(&sqlx::migrate!("migrations/postgres"), connections.pool()).await?;
        Ok(Self::of(Database::Postgres(connections)))
    }

    fn of(database: Database) -> Self {
        Self {
            database,
            ahead_us: Arc::default(),
        }
    }

    /// Lets time pass on the clock of these rows and their clones.
    #[cfg(any(test, feature = "conformance"))]
    pub fn pass_time(&self, by: Duration) {
        self.ahead_us.fetch_add(microseconds(by), Ordering::Relaxed);
    }

    /// The time by the database's clock.
    async fn now(&self, connection: &mut Connection) -> Result<i64, StoreError> {
        Ok(connection.now().await? + self.ahead_us.load(Ordering::Relaxed))
    }

    /// Begins a writing transaction; with it the time.
    async fn write(&self) -> Result<(Connection, i64), StoreError> {
        let mut transaction = self.database.begin().await?;
        let now = self.now(&mut transaction).await?;
        Ok((transaction, now))
    }

    /// Deletes a case with its layers and commits; whether it existed.
    async fn delete_in(
        &self,
        mut transaction: Connection,
        id: &CaseId,
        now: i64,
    ) -> Result<bool, StoreError> {
        layers::abandon_all(&mut transaction, id, now).await?;
        let deleted = cases::delete(&mut transaction, id, now).await?;
        transaction.commit().await?;
        if deleted {
            self.database.empty_log().await;
        }
        Ok(deleted)
    }
}

/// Migrates the tables. Tables of a newer version are not changed.
async fn migrate<D: sqlx::Database>(migrations: &Migrator, pool: &Pool<D>) -> Result<(), StoreError>
where
    D::Connection: Migrate,
{
    migrations.run(pool).await.map_err(|error| match error {
        MigrateError::VersionMissing(found) => StoreError::NewerSchema {
            found,
            known: migrations
                .iter()
                .map(|step| step.version)
                .max()
                .unwrap_or(0),
        },
        other => other.into(),
    })
}

#[async_trait]
impl CaseRows for SqlRows {
    async fn pin(&self, pinned: &Pinned, lease: Duration) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.write().await?;
        if tombstones::any_of(&mut transaction, &pinned.names).await? {
            return Ok(false);
        }
        pins::insert(&mut transaction, pinned, now + microseconds(lease)).await?;
        transaction.commit().await?;
        Ok(true)
    }

    async fn unpin(&self, pinned: &Pinned) -> Result<(), StoreError> {
        let (mut transaction, now) = self.write().await?;
        pins::expire(&mut transaction, pinned, now).await?;
        transaction.commit().await
    }

    async fn insert(&self, new: &NewCase) -> Result<Inserted, StoreError> {
        let (mut transaction, now) = self.write().await?;
        let inserted = jobs::submit(&mut transaction, new, now).await?;
        if !matches!(inserted, Inserted::QueueFull | Inserted::PinLost) {
            transaction.commit().await?;
        }
        Ok(inserted)
    }

    async fn case(&self, id: &CaseId) -> Result<Option<Case>, StoreError> {
        match cases::one(&mut self.database.connect().await?, id).await {
            Err(StoreError::DamagedFacts(id)) => {
                upkeep::prepare_again(&self.database, &id).await?;
                cases::one(&mut self.database.connect().await?, &id).await
            }
            read => read,
        }
    }

    async fn cases(&self, after: Option<&Cursor>, limit: usize) -> Result<Page, StoreError> {
        loop {
            match cases::page(&mut self.database.connect().await?, after, limit).await {
                Err(StoreError::DamagedFacts(id)) => {
                    upkeep::prepare_again(&self.database, &id).await?;
                }
                read => return read,
            }
        }
    }

    async fn cases_with_voxels(&self, values: &str, limit: usize) -> Result<Vec<Case>, StoreError> {
        cases::with_voxels(&mut self.database.connect().await?, values, limit).await
    }

    async fn objects(&self, id: &CaseId) -> Result<Vec<ObjectName>, StoreError> {
        cases::objects(&mut self.database.connect().await?, id).await
    }

    async fn rename(&self, id: &CaseId, name: &str) -> Result<(), StoreError> {
        let (mut transaction, _) = self.write().await?;
        cases::rename(&mut transaction, id, name).await?;
        transaction.commit().await
    }

    async fn delete(&self, id: &CaseId) -> Result<bool, StoreError> {
        let (transaction, now) = self.write().await?;
        self.delete_in(transaction, id, now).await
    }

    async fn uploaded_again(&self, id: &CaseId) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.write().await?;
        let exists = cases::uploaded_again(&mut transaction, id, now).await?;
        transaction.commit().await?;
        Ok(exists)
    }

    async fn keep(&self, id: &CaseId, kept: bool) -> Result<bool, StoreError> {
        let (mut transaction, _) = self.write().await?;
        let exists = cases::keep(&mut transaction, id, kept).await?;
        transaction.commit().await?;
        Ok(exists)
    }

    async fn expired(&self, age: Duration, limit: usize) -> Result<Vec<CaseId>, StoreError> {
        let mut connection = self.database.connect().await?;
        let before = self
            .now(&mut connection)
            .await?
            .saturating_sub(microseconds(age));
        cases::uploaded_before(&mut connection, before, limit).await
    }

    async fn delete_expired(&self, id: &CaseId, age: Duration) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.write().await?;
        let before = now.saturating_sub(microseconds(age));
        if !cases::is_uploaded_before(&mut transaction, id, before).await? {
            return Ok(false);
        }
        self.delete_in(transaction, id, now).await
    }

    async fn waiting(&self) -> Result<usize, StoreError> {
        let mut connection = self.database.connect().await?;
        jobs::waiting(&mut connection).await
    }

    async fn claim(&self, terms: &LeaseTerms) -> Result<Option<Claim>, StoreError> {
        // Most queries find nothing and must not wait for writers.
        let mut reader = self.database.connect().await?;
        let now = self.now(&mut reader).await?;
        if jobs::oldest_available(&mut reader, now).await?.is_none() {
            return Ok(None);
        }
        drop(reader);
        let (mut transaction, now) = self.write().await?;
        let claim = jobs::claim(&mut transaction, terms, now).await?;
        transaction.commit_soon().await?;
        Ok(claim)
    }

    async fn renew(
        &self,
        claim: &Claim,
        lease: Duration,
        progress: Option<Progress>,
    ) -> Result<bool, StoreError> {
        let mut connection = self.database.connect().await?;
        let until = self.now(&mut connection).await? + microseconds(lease);
        jobs::renew(&mut connection, claim, until, progress).await
    }

    async fn release(&self, claim: &Claim, release: Release) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.write().await?;
        let released = jobs::release(&mut transaction, claim, release, now).await?;
        transaction.commit().await?;
        Ok(released)
    }

    async fn publish(
        &self,
        claim: &Claim,
        derived: &Pinned,
        facts: &CaseFacts,
    ) -> Result<Published, StoreError> {
        let (mut transaction, now) = self.write().await?;
        if !jobs::finish(&mut transaction, claim).await? {
            return Ok(Published::Fenced);
        }
        if !cases::refer(&mut transaction, &claim.id, derived, now).await? {
            return Ok(Published::PinLost);
        }
        cases::make_ready(&mut transaction, &claim.id, facts).await?;
        transaction.commit().await?;
        Ok(Published::Done)
    }

    async fn fail(&self, claim: &Claim, failure: &Failure) -> Result<bool, StoreError> {
        let (mut transaction, _) = self.write().await?;
        let ours = jobs::finish(&mut transaction, claim).await?;
        if ours {
            cases::make_failed(&mut transaction, &claim.id, failure).await?;
            transaction.commit().await?;
        }
        Ok(ours)
    }

    async fn replace(&self, id: &CaseId, derived: &Pinned) -> Result<Published, StoreError> {
        let (mut transaction, now) = self.write().await?;
        if !cases::is_ready(&mut transaction, id).await? {
            return Ok(Published::Fenced);
        }
        if !cases::refer(&mut transaction, id, derived, now).await? {
            return Ok(Published::PinLost);
        }
        transaction.commit().await?;
        Ok(Published::Done)
    }

    async fn condemn(&self, id: &CaseId, failure: &Failure) -> Result<bool, StoreError> {
        let (mut transaction, _) = self.write().await?;
        let ready = cases::is_ready(&mut transaction, id).await?;
        if ready {
            cases::make_failed(&mut transaction, id, failure).await?;
            transaction.commit().await?;
        }
        Ok(ready)
    }

    async fn begin_rebuild(
        &self,
        id: &CaseId,
        holder: &str,
        lease: Duration,
    ) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.write().await?;
        let times = [now, now + microseconds(lease)];
        let taken = rebuilds::take(&mut transaction, id, holder, times).await?;
        transaction.commit().await?;
        Ok(taken)
    }

    async fn end_rebuild(&self, id: &CaseId, holder: &str) -> Result<(), StoreError> {
        let (mut transaction, _) = self.write().await?;
        rebuilds::end(&mut transaction, id, holder).await?;
        transaction.commit().await
    }

    async fn abandoned(&self, limit: usize) -> Result<Vec<ObjectName>, StoreError> {
        let mut connection = self.database.connect().await?;
        let now = self.now(&mut connection).await?;
        tombstones::abandoned(&mut connection, now, limit).await
    }

    async fn mark(
        &self,
        names: &[ObjectName],
        sweep: &Sweep,
    ) -> Result<Vec<ObjectName>, StoreError> {
        let (mut transaction, now) = self.write().await?;
        let marked = tombstones::mark(&mut transaction, names, sweep, now).await?;
        transaction.commit().await?;
        Ok(marked)
    }

    async fn bury(&self, holder: &str) -> Result<(), StoreError> {
        let (mut transaction, _) = self.write().await?;
        tombstones::bury(&mut transaction, holder).await?;
        transaction.commit().await
    }

    async fn unneeded(&self, names: &[ObjectName]) -> Result<Vec<ObjectName>, StoreError> {
        let mut connection = self.database.connect().await?;
        tombstones::unneeded(&mut connection, names).await
    }

    async fn pacs_objects(
        &self,
        kind: ObjectKind,
        after: Option<&ObjectName>,
        limit: usize,
    ) -> Result<Vec<ObjectName>, StoreError> {
        let mut connection = self.database.connect().await?;
        pacs::objects(&mut connection, kind, after, limit).await
    }

    async fn adopt(&self, case: &Case, objects: &Pinned) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.write().await?;
        if !cases::adopt(&mut transaction, case).await? {
            return Ok(false);
        }
        if !cases::refer(&mut transaction, &case.id, objects, now).await? {
            return Err(StoreError::Rows("a pin was lost".into()));
        }
        jobs::forget(&mut transaction, &case.id).await?;
        if !case.state.is_final() {
            jobs::insert(&mut transaction, &case.id, now).await?;
        }
        transaction.commit().await?;
        Ok(true)
    }

    async fn forget_holders(&self) -> Result<(), StoreError> {
        self.database.check_file().await?;
        let (mut transaction, now) = self.write().await?;
        jobs::end_leases(&mut transaction, now).await?;
        pins::expire_all(&mut transaction, now).await?;
        tombstones::end_leases(&mut transaction, now).await?;
        rebuilds::end_all(&mut transaction).await?;
        arrivals::end_leases(&mut transaction).await?;
        retrievals::end_leases(&mut transaction).await?;
        results::end_leases(&mut transaction).await?;
        layers::end_leases(&mut transaction, now).await?;
        transaction.commit().await?;
        self.database.empty_log().await;
        Ok(())
    }

    async fn check(&self) -> Result<(), StoreError> {
        self.database.check().await
    }

    async fn inspect(&self) -> Result<(), StoreError> {
        self.database.check_file().await
    }

    async fn changes(&self) -> Result<Option<BoxStream<'static, Change>>, StoreError> {
        self.database.changes().await
    }

    async fn close(&self) {
        self.database.close().await;
    }
}
