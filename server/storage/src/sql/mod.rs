//! Rows in an SQL database: a file of SQLite, or PostgreSQL.
//!
//! The statements are written once ([`connection`]); the differences are in [`sqlite`] and [`postgres`]. Writing
//! transactions come one after another in both. The time of a transaction is read from the database inside of it, in
//! microseconds since 1970.

mod cases;
mod claims;
pub(crate) mod connection;
mod expiry;
mod fence;
mod findings;
mod job_rows;
pub(crate) mod jobs;
mod layer_rows;
pub(crate) mod layers;
pub(crate) mod made;
pub(crate) mod pins;
mod postgres;
pub(crate) mod series;
mod sqlite;
mod store_id;
mod tombstones;
mod upkeep;

use crate::args;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::Duration;

use futures_util::stream::BoxStream;
use sqlx::migrate::{Migrate, MigrateError, Migration, MigrationType, Migrator};
use sqlx::postgres::PgConnectOptions;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{Pool, SqlSafeStr as _};

pub(crate) use self::connection::microseconds;
use self::connection::{Connection, Database, Migrations, Row, Tables};
use super::jobs::{Claim, NewJob};
use super::rows::{
    Change, Inserted, Made, NewCase, NewLayer, Pinned, Published, Referred, RowCounts, Sweep,
};
use super::{CaseQuery, Cursor, ObjectName, Page, Store, StoreError};
use case::images::{Closed, Image};
use case::series::{CaseSeries, SeriesQuery};
use case::{Case, CaseFacts, CaseId, Failure, JobKind, LayerId, ObjectKind};

const SQLITE: &Migrations = &[(
    100,
    "store",
    include_str!("../../migrations/sqlite/0100_store.sql"),
)];

const POSTGRES: &Migrations = &[(
    100,
    "store",
    include_str!("../../migrations/postgres/0100_store.sql"),
)];

/// Rows in a file of SQLite, in memory, or in PostgreSQL.
#[derive(Debug, Clone)]
pub(crate) struct Rows {
    database: Database,
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
        Ok(Self::of(Database::Sqlite(connections), tables))
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
        Ok(Self::of(Database::Postgres(connections), tables))
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
        let way = self.database.connect().await?;
        Ok(Connection::new(way, Arc::clone(&self.tables)))
    }

    /// Ends every lease and expires every pin, because no other process runs that could hold one.
    pub(crate) async fn forget_holders(&self) -> Result<(), StoreError> {
        let (mut transaction, now) = self.write().await?;
        jobs::end_leases(&mut transaction, now).await?;
        pins::expire_all(&mut transaction, now).await?;
        tombstones::end_leases(&mut transaction, now).await?;
        transaction.commit().await?;
        self.database.empty_log().await;
        Ok(())
    }

    /// Checks the integrity of the database itself. Takes as long as reading it.
    pub(crate) async fn check_file(&self) -> Result<(), StoreError> {
        self.database.check_file().await
    }

    /// Finishes all work before the process ends. No other method may be called afterwards.
    pub(crate) async fn close(&self) {
        self.database.close().await;
    }

    /// The changes of all processes from now on, as they are committed; `None` if the database cannot report them. Some
    /// may be missed, so a process that waits for one must also poll.
    pub(crate) async fn changes(&self) -> Result<Option<BoxStream<'static, Change>>, StoreError> {
        self.database.changes().await
    }

    /// Whether the rows can be read and written. Changes nothing.
    pub(crate) async fn check(&self) -> Result<(), StoreError> {
        self.database.check().await
    }

    /// The time by the database's clock.
    pub(crate) async fn now(&self, connection: &mut Connection) -> Result<i64, StoreError> {
        Ok(connection.now().await? + self.ahead_us.load(Ordering::Relaxed))
    }

    /// Begins a writing transaction; with it the time.
    pub(crate) async fn write(&self) -> Result<(Connection, i64), StoreError> {
        let way = self.database.begin().await?;
        let mut transaction = Connection::new(way, Arc::clone(&self.tables));
        let now = self.now(&mut transaction).await?;
        Ok((transaction, now))
    }

    /// Deletes a case and commits; whether it existed.
    async fn delete_in(
        &self,
        mut transaction: Connection,
        id: &CaseId,
        now: i64,
    ) -> Result<bool, StoreError> {
        let deleted = cases::delete(&mut transaction, id, now).await?;
        transaction.commit().await?;
        if deleted {
            self.database.empty_log().await;
        }
        Ok(deleted)
    }
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
    pins::insert(transaction, objects, now).await
}

/// Migrates the tables. Tables of a newer version, and of one before 0.1.0, are not changed.
async fn migrate<D: sqlx::Database>(
    migrations: [&'static Migrations; 2],
    pool: &Pool<D>,
) -> Result<(), StoreError>
where
    D::Connection: Migrate,
{
    let migrations = migrations.concat();
    let known = migrations.iter().map(|&(version, ..)| version).max();
    let known = known.unwrap_or_default();
    let steps = migrations.iter().map(|&(version, name, statements)| {
        let (kind, statements) = (MigrationType::Simple, statements.into_sql_str());
        Migration::new(version, name.into(), kind, statements, false)
    });
    let migrator = Migrator::with_migrations(steps.collect());
    migrator.run(pool).await.map_err(|error| match error {
        MigrateError::VersionMissing(found) if found > known => {
            StoreError::NewerSchema { found, known }
        }
        MigrateError::VersionMissing(_) | MigrateError::VersionMismatch(_) => {
            StoreError::OlderSchema
        }
        other => other.into(),
    })
}

impl Store {
    /// Protects objects from removal for a time, before they are written. `false`, and nothing has changed, if one of
    /// them has a tombstone: try again once the tombstone is removed.
    pub(crate) async fn try_pin(
        &self,
        pinned: &Pinned,
        lease: Duration,
    ) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        if tombstones::any_of(&mut transaction, &pinned.names).await? {
            return Ok(false);
        }
        pins::insert(&mut transaction, pinned, now + microseconds(lease)).await?;
        transaction.commit().await?;
        Ok(true)
    }

    /// Makes pins expire at once, because the objects are not needed.
    pub(crate) async fn unpin(&self, pinned: &Pinned) -> Result<(), StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        pins::expire(&mut transaction, pinned, now).await?;
        transaction.commit().await
    }

    /// Makes a case and its job, and turns its pins into references; or queues a failed one again. A version gets the
    /// layers of the case that it is a version of.
    pub(crate) async fn insert_case(
        &self,
        new: &NewCase,
    ) -> Result<Referred<Inserted>, StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        let inserted = cases::submit(&mut transaction, new, now).await?;
        if inserted != Referred::PinLost {
            transaction.commit().await?;
        }
        Ok(inserted)
    }

    /// One case.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn case(&self, id: &CaseId) -> Result<Option<Case>, StoreError> {
        let mut read = cases::one(&mut self.rows().connect().await?, id).await;
        if let Err(StoreError::DamagedFacts(id)) = read {
            upkeep::prepare_again(self.rows(), &id).await?;
            read = cases::one(&mut self.rows().connect().await?, &id).await;
        }
        Ok(read?.map(|case| self.completed(case)))
    }

    /// At most `limit` cases after a cursor, newest first.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn cases(&self, after: Option<Cursor>, limit: usize) -> Result<Page, StoreError> {
        self.search(&CaseQuery::default(), after, limit).await
    }

    /// At most `limit` cases of a search after a cursor, newest first.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn search(
        &self,
        query: &CaseQuery,
        after: Option<Cursor>,
        limit: usize,
    ) -> Result<Page, StoreError> {
        let mut page = loop {
            let mut connection = self.rows().connect().await?;
            match cases::page(&mut connection, query, after.as_ref(), limit).await {
                Err(StoreError::DamagedFacts(id)) => {
                    drop(connection);
                    upkeep::prepare_again(self.rows(), &id).await?;
                }
                read => break read?,
            }
        };
        let cases = page.cases.into_iter();
        page.cases = cases.map(|case| self.completed(case)).collect();
        Ok(page)
    }

    /// At most `limit` ready cases whose volumes have the same stored values in any order
    /// ([`VoxelFacts::values`](case::VoxelFacts::values)), newest first.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn cases_with_voxels(
        &self,
        values: &str,
        limit: usize,
    ) -> Result<Vec<Case>, StoreError> {
        cases::with_voxels(&mut self.rows().connect().await?, values, limit).await
    }

    /// The objects that a case needs; none if there is no such case.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn case_objects(&self, id: &CaseId) -> Result<Vec<ObjectName>, StoreError> {
        cases::objects(&mut self.rows().connect().await?, id).await
    }

    /// Doubts the axes of a ready case, because another one has the same voxels with other axes; nothing if it has no verdict.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn doubt_axes(&self, id: &CaseId) -> Result<(), StoreError> {
        let (mut transaction, _) = self.rows().write().await?;
        let case = cases::one(&mut transaction, id).await?;
        let Some(mut facts) = case.and_then(|case| case.facts) else {
            return Ok(());
        };
        let quality = facts.quality.as_mut();
        if !quality.is_some_and(|quality| quality.set_axes_corrected(true)) {
            return Ok(());
        }
        cases::change_facts(&mut transaction, id, &facts).await?;
        transaction.commit().await?;
        self.signals().changed(id);
        Ok(())
    }

    /// Changes the label of a case; nothing if there is no such case.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn rename(&self, id: &CaseId, name: &str) -> Result<(), StoreError> {
        let (mut transaction, _) = self.rows().write().await?;
        cases::rename(&mut transaction, id, name).await?;
        transaction.commit().await
    }

    /// Removes a case with its job and its layers; returns whether it existed. Its objects are left with expired pins;
    /// its versions become those of the case that it is a version of.
    pub(crate) async fn delete_case(&self, id: &CaseId) -> Result<bool, StoreError> {
        let (transaction, now) = self.rows().write().await?;
        self.rows().delete_in(transaction, id, now).await
    }

    /// Lets the age of a case count from now, because its input was uploaded again, made of these images; returns whether it exists.
    pub(crate) async fn uploaded_again(
        &self,
        id: &CaseId,
        images: &[Image],
    ) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        let exists = upkeep::uploaded_again(&mut transaction, id, now).await?;
        if exists && !images.is_empty() {
            made::make(&mut transaction, &Made::case(id), images).await?;
        }
        transaction.commit().await?;
        Ok(exists)
    }

    /// Why a case is closed, if it is.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn closed(&self, id: &CaseId) -> Result<Option<Closed>, StoreError> {
        cases::closed(&mut self.rows().connect().await?, id).await
    }

    /// Keeps a case for good, or no longer; returns whether it exists.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn keep(&self, id: &CaseId, kept: bool) -> Result<bool, StoreError> {
        let (mut transaction, _) = self.rows().write().await?;
        let exists = cases::keep(&mut transaction, id, kept).await?;
        transaction.commit().await?;
        Ok(exists)
    }

    /// At most `limit` cases that are ready or failed, not kept, and were last uploaded at least `age` ago; oldest first.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn expired(&self, age: Duration, limit: usize) -> Result<Vec<CaseId>, StoreError> {
        let mut connection = self.rows().connect().await?;
        let before = self
            .rows()
            .now(&mut connection)
            .await?
            .saturating_sub(microseconds(age));
        cases::uploaded_before(&mut connection, before, limit).await
    }

    /// Makes a case ready, ends its job and queues the next ones, if the lease is still ours.
    pub(crate) async fn make_case_ready(
        &self,
        claim: &Claim,
        derived: &Pinned,
        facts: &CaseFacts,
        next: &[JobKind],
    ) -> Result<Referred<Published>, StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        let Some(id) = &claim.case else {
            return Ok(Referred::Unneeded(Published::Fenced));
        };
        if !jobs::finish(&mut transaction, claim, Ok(()), now).await? {
            return Ok(Referred::Unneeded(Published::Fenced));
        }
        if !cases::refer(&mut transaction, id, derived, now).await? {
            return Ok(Referred::PinLost);
        }
        cases::make_ready(&mut transaction, id, facts).await?;
        for &kind in next {
            jobs::enqueue(&mut transaction, &NewJob::of_ready_case(kind, id), now).await?;
        }
        transaction.commit().await?;
        Ok(Referred::Done(Published::Done))
    }

    /// Gives a ready case other derived objects, after a rebuild. [`Published::Fenced`] where it is not ready.
    pub(crate) async fn replace_objects(
        &self,
        id: &CaseId,
        derived: &Pinned,
    ) -> Result<Referred<Published>, StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        if !cases::is_ready(&mut transaction, id).await? {
            return Ok(Referred::Unneeded(Published::Fenced));
        }
        if !cases::refer(&mut transaction, id, derived, now).await? {
            return Ok(Referred::PinLost);
        }
        transaction.commit().await?;
        Ok(Referred::Done(Published::Done))
    }

    /// Makes a ready case failed, because its source is lost; returns whether it was ready.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn make_case_failed(
        &self,
        id: &CaseId,
        failure: &Failure,
    ) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        let ready = cases::is_ready(&mut transaction, id).await?;
        if ready {
            cases::make_failed(&mut transaction, id, failure, now).await?;
            transaction.commit().await?;
        }
        Ok(ready)
    }

    /// Queues a failed case again; returns whether it had failed.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub async fn prepare_failed_again(&self, id: &CaseId) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        let had_failed = cases::prepare_failed_again(&mut transaction, id, now).await?;
        transaction.commit().await?;
        self.signals().queued();
        self.signals().changed(id);
        Ok(had_failed)
    }

    /// When the latest case, layer or finding was written, in microseconds.
    pub(crate) async fn newest_row(&self) -> Result<Option<i64>, StoreError> {
        upkeep::newest_row(&mut self.rows().connect().await?).await
    }

    /// At most `limit` objects that may have to be removed: with an expired pin, or with a tombstone whose lease has
    /// ended.
    pub(crate) async fn abandoned(&self, limit: usize) -> Result<Vec<ObjectName>, StoreError> {
        let mut connection = self.rows().connect().await?;
        let now = self.rows().now(&mut connection).await?;
        tombstones::abandoned(&mut connection, now, limit).await
    }

    /// Leaves the sweep's tombstone on those of the given objects that no case needs, no live pin protects and no other
    /// live sweep removes, and forgets the expired pins of all of them. The objects with the sweep's tombstone are its
    /// own to delete.
    pub(crate) async fn mark(
        &self,
        names: &[ObjectName],
        sweep: &Sweep,
    ) -> Result<Vec<ObjectName>, StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        let marked = tombstones::mark(&mut transaction, names, sweep, now).await?;
        transaction.commit().await?;
        Ok(marked)
    }

    /// Forgets who was writing objects when the rows were saved from which they were restored: what was written may have been
    /// acknowledged since, and no sweep must remove it. A process that is writing now writes again.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub async fn forget_writers(&self) -> Result<(), StoreError> {
        let (mut transaction, _) = self.rows().write().await?;
        pins::forget_writers(&mut transaction).await?;
        transaction.commit().await
    }

    /// As [`Store::insert_case`], of objects that are there and that nothing refers to; whether it was inserted.
    pub(crate) async fn insert_adopted_case(&self, new: &NewCase) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        hold(&mut transaction, &new.sources, now).await?;
        let inserted = cases::submit(&mut transaction, new, now).await?;
        self.commit_adopted(transaction, &inserted).await
    }

    /// The same for a layer.
    pub(crate) async fn insert_adopted_layer(&self, new: &NewLayer) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        hold(&mut transaction, &new.sources, now).await?;
        let inserted = layers::submit(&mut transaction, new, now).await?;
        self.commit_adopted(transaction, &inserted).await
    }

    /// Commits what was inserted and queued; whether anything was.
    async fn commit_adopted<T>(
        &self,
        transaction: Connection,
        inserted: &Referred<T>,
    ) -> Result<bool, StoreError> {
        let is_inserted = matches!(inserted, Referred::Done(_));
        if is_inserted {
            transaction.commit().await?;
            self.signals().queued();
        }
        Ok(is_inserted)
    }

    /// Makes a pinned manifest that of a case or of one of its layers, if that is there.
    pub(crate) async fn refer_to_manifest(
        &self,
        case: &CaseId,
        layer: Option<&LayerId>,
        manifest: &Pinned,
    ) -> Result<Referred<()>, StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        let referred = match layer {
            None if !transaction.has_case(&case.to_string()).await? => {
                return Ok(Referred::Unneeded(()));
            }
            None => cases::refer(&mut transaction, case, manifest, now).await?,
            Some(layer) if !layers::are_there(&mut transaction, case, &[*layer]).await? => {
                return Ok(Referred::Unneeded(()));
            }
            Some(layer) => layers::refer(&mut transaction, case, layer, manifest, now).await?,
        };
        if !referred {
            return Ok(Referred::PinLost);
        }
        transaction.commit().await?;
        Ok(Referred::Done(()))
    }

    /// Removes the tombstones of a sweep after their objects are deleted, if the sweep still holds them.
    pub(crate) async fn remove_tombstones(&self, holder: &str) -> Result<(), StoreError> {
        let (mut transaction, _) = self.rows().write().await?;
        tombstones::remove_tombstones(&mut transaction, holder).await?;
        transaction.commit().await
    }

    /// Those of the given objects that no case needs, no pin protects and no sweep removes.
    pub(crate) async fn unneeded(
        &self,
        names: &[ObjectName],
    ) -> Result<Vec<ObjectName>, StoreError> {
        let mut connection = self.rows().connect().await?;
        tombstones::unneeded(&mut connection, names).await
    }

    /// The next objects of one kind to which rows of other tables refer, by digest.
    pub(crate) async fn objects_of_tables(
        &self,
        kind: ObjectKind,
        after: Option<&ObjectName>,
        limit: usize,
    ) -> Result<Vec<ObjectName>, StoreError> {
        let mut connection = self.rows().connect().await?;
        let tables = connection.tables();
        tables.objects(&mut connection, kind, after, limit).await
    }

    /// Inserts a case of another store as it is there, or makes the one that is here so, and turns its pins into
    /// references; one that is not ready or failed is queued. `false`, and nothing has changed, where it is ready here
    /// and not there.
    pub(crate) async fn write_copied_case(
        &self,
        case: &Case,
        objects: &Pinned,
    ) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        if !cases::write_copied(&mut transaction, case).await? {
            return Ok(false);
        }
        if !cases::refer(&mut transaction, &case.id, objects, now).await? {
            return Err(StoreError::Rows("a pin was lost".into()));
        }
        jobs::cancel(&mut transaction, JobKind::PREPARE, &case.id.to_string()).await?;
        if !case.state.is_final() {
            jobs::enqueue(&mut transaction, &NewJob::prepare(&case.id), now).await?;
        }
        transaction.commit().await?;
        Ok(true)
    }

    /// Checks the integrity of the database itself. Takes as long as reading it.
    pub(crate) async fn check_file(&self) -> Result<(), StoreError> {
        self.rows().check_file().await
    }

    /// The images that something was made of.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn made_of(&self, made: &Made) -> Result<Vec<Image>, StoreError> {
        made::of(&mut self.rows().connect().await?, made).await
    }

    /// Notes of which images something was made, and how often each had come. Of those that are known, the last counts.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub async fn note_made_of(&self, made: &Made, of: &[Image]) -> Result<(), StoreError> {
        let (mut transaction, _) = self.rows().write().await?;
        made::make(&mut transaction, made, of).await?;
        transaction.commit().await
    }

    /// How many cases and jobs are in which state, and how long jobs have waited, for metrics.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn row_counts(&self) -> Result<RowCounts, StoreError> {
        let mut connection = self.rows().connect().await?;
        let now = self.rows().now(&mut connection).await?;
        let rows = connection
            .fetch_all(
                "SELECT 'cases' AS what, '' AS part, state, count(*) AS number FROM cases GROUP BY state
                 UNION ALL SELECT 'closed', CASE closed WHEN 1 THEN 'rejected' ELSE 'corrected' END, 'closed', count(*)
                     FROM cases WHERE closed > 0 GROUP BY closed
                 UNION ALL SELECT 'jobs', kind, state, count(*) FROM jobs GROUP BY kind, state",
                args![],
            )
            .await?;
        let read = |row: &Row| {
            let [what, part, state] = ["what", "part", "state"].map(|column| row.get(column));
            let number: i64 = row.get("number")?;
            Ok((what?, part?, state?, number.unsigned_abs()))
        };
        let by_state = rows.iter().map(read).collect::<Result<_, StoreError>>()?;
        Ok(RowCounts {
            by_state,
            oldest: jobs::oldest_of_each_kind(&mut connection, now).await?,
        })
    }

    /// Enters the series of a case into the index; nothing if there is no such case.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn index_series(&self, series: &CaseSeries) -> Result<(), StoreError> {
        let (mut transaction, _) = self.rows().write().await?;
        series::index(&mut transaction, series).await?;
        transaction.commit().await
    }

    /// The indexed series of a case.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn series_of(&self, case: &CaseId) -> Result<Option<CaseSeries>, StoreError> {
        series::series_of(&mut self.rows().connect().await?, case).await
    }

    /// The cases that a request names, newest first.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn cases_of(&self, query: &SeriesQuery) -> Result<Vec<CaseSeries>, StoreError> {
        series::cases_of(&mut self.rows().connect().await?, query).await
    }
}
