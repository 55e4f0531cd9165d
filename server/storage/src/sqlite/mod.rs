//! Rows in an SQLite file.
//!
//! Write-ahead logging, and `synchronous=FULL`: with `NORMAL` a committed row may be lost with the power. Writing
//! transactions begin as `IMMEDIATE`, so that none fails half-way because another one wrote. The time of a transaction is read
//! from the database inside of it, in microseconds since 1970 (SQLite knows them to the millisecond).

mod cases;
mod jobs;
mod pins;
mod tombstones;
mod upkeep;

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::Duration;

use async_trait::async_trait;
use sqlx::migrate::MigrateError;
use sqlx::sqlite::{
    SqliteConnectOptions, SqliteConnection, SqliteJournalMode, SqlitePool, SqlitePoolOptions,
    SqliteSynchronous,
};
use sqlx::{Connection as _, Sqlite, Transaction};

use super::rows::{
    CaseRows, Claim, Inserted, LeaseTerms, NewCase, Pinned, Published, Release, Sweep,
};
use super::{Cursor, ObjectName, Page, StoreError};
use case::{Case, CaseFacts, CaseId, Failure, Progress};

/// How long a transaction waits for another process's.
const BUSY_TIMEOUT: Duration = Duration::from_secs(20);

/// Connections to a file: one writes, the others read meanwhile.
const CONNECTIONS: u32 = 4;

/// Rows in an SQLite file, or in memory.
#[derive(Debug, Clone)]
pub struct SqliteRows {
    pool: SqlitePool,
    /// By how much the clock is ahead, in microseconds: 0 but in tests of leases.
    ahead_us: Arc<AtomicI64>,
}

impl SqliteRows {
    /// Opens a database file; creates and migrates it where necessary.
    ///
    /// # Errors
    /// When the file cannot be used, or was written by a newer version.
    pub async fn open(file: &Path) -> Result<Self, StoreError> {
        let options = SqliteConnectOptions::new()
            .filename(file)
            .create_if_missing(true)
            .journal_mode(SqliteJournalMode::Wal)
            .synchronous(SqliteSynchronous::Full)
            .pragma("secure_delete", "ON");
        Self::connect(options, CONNECTIONS).await
    }

    /// A database that goes with its last user.
    ///
    /// # Errors
    /// When there is no memory for it.
    pub async fn in_memory() -> Result<Self, StoreError> {
        Self::connect(SqliteConnectOptions::new().in_memory(true), 1).await
    }

    async fn connect(options: SqliteConnectOptions, connections: u32) -> Result<Self, StoreError> {
        let options = options.foreign_keys(true).busy_timeout(BUSY_TIMEOUT);
        let pool = SqlitePoolOptions::new()
            .max_connections(connections)
            .idle_timeout(None)
            .max_lifetime(None)
            .after_release(|connection, _| Box::pin(async { is_reusable(connection).await }))
            .connect_with(options)
            .await?;
        migrate(&pool).await?;
        upkeep::add_missing_digests(&pool).await?;
        Ok(Self {
            pool,
            ahead_us: Arc::default(),
        })
    }

    /// Lets time pass on the clock of these rows and their clones.
    #[cfg(any(test, feature = "conformance"))]
    pub fn pass_time(&self, by: Duration) {
        self.ahead_us.fetch_add(microseconds(by), Ordering::Relaxed);
    }

    /// The time by the database's clock.
    async fn now(&self, connection: &mut SqliteConnection) -> Result<i64, StoreError> {
        let now: i64 =
            sqlx::query_scalar("SELECT CAST(unixepoch('subsec') * 1000 AS INTEGER) * 1000")
                .fetch_one(connection)
                .await?;
        Ok(now + self.ahead_us.load(Ordering::Relaxed))
    }

    /// Begins a writing transaction; with it the time.
    async fn write(&self) -> Result<(Transaction<'static, Sqlite>, i64), StoreError> {
        let mut transaction = self.pool.begin_with("BEGIN IMMEDIATE").await?;
        let now = self.now(&mut transaction).await?;
        Ok((transaction, now))
    }
}

/// A duration as the rows have it.
fn microseconds(duration: Duration) -> i64 {
    i64::try_from(duration.as_micros()).unwrap_or(i64::MAX / 2)
}

/// Whether a connection that was given back can be used again.
///
/// After `SQLITE_FULL` and most I/O errors SQLite itself has rolled the transaction back. The `ROLLBACK` that follows then fails, and
/// sqlx counts the connection as inside its transaction for ever: every later `BEGIN` on it fails. Such a connection is closed.
async fn is_reusable(connection: &mut SqliteConnection) -> Result<bool, sqlx::Error> {
    // A rollback that is under way is over once the connection answers.
    connection.ping().await?;
    Ok(!connection.is_in_transaction())
}

/// Brings the tables to the newest form. Those of a newer version are left as they are.
async fn migrate(pool: &SqlitePool) -> Result<(), StoreError> {
    let migrations = sqlx::migrate!();
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
impl CaseRows for SqliteRows {
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
        Ok(transaction.commit().await?)
    }

    async fn insert(&self, new: &NewCase) -> Result<Inserted, StoreError> {
        let (mut transaction, now) = self.write().await?;
        let inserted = cases::insert(&mut transaction, new, now).await?;
        if matches!(inserted, Inserted::Created | Inserted::Requeued) {
            transaction.commit().await?;
        }
        Ok(inserted)
    }

    async fn case(&self, id: &CaseId) -> Result<Option<Case>, StoreError> {
        match cases::one(&self.pool, id).await {
            Err(StoreError::DamagedFacts(id)) => {
                upkeep::prepare_again(&self.pool, &id).await?;
                cases::one(&self.pool, &id).await
            }
            read => read,
        }
    }

    async fn cases(&self, after: Option<&Cursor>, limit: usize) -> Result<Page, StoreError> {
        loop {
            match cases::page(&self.pool, after, limit).await {
                Err(StoreError::DamagedFacts(id)) => {
                    upkeep::prepare_again(&self.pool, &id).await?;
                }
                read => return read,
            }
        }
    }

    async fn objects(&self, id: &CaseId) -> Result<Vec<ObjectName>, StoreError> {
        cases::objects(&self.pool, id).await
    }

    async fn rename(&self, id: &CaseId, name: &str) -> Result<(), StoreError> {
        let (mut transaction, _) = self.write().await?;
        cases::rename(&mut transaction, id, name).await?;
        Ok(transaction.commit().await?)
    }

    async fn delete(&self, id: &CaseId) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.write().await?;
        let deleted = cases::delete(&mut transaction, id, now).await?;
        transaction.commit().await?;
        if deleted {
            upkeep::empty_log(&self.pool).await;
        }
        Ok(deleted)
    }

    async fn waiting(&self) -> Result<usize, StoreError> {
        let mut connection = self.pool.acquire().await?;
        jobs::waiting(&mut connection).await
    }

    async fn claim(&self, terms: &LeaseTerms) -> Result<Option<Claim>, StoreError> {
        // Most looks find nothing; they shall not wait for the writers.
        let mut reader = self.pool.acquire().await?;
        let now = self.now(&mut reader).await?;
        if jobs::oldest_available(&mut reader, now).await?.is_none() {
            return Ok(None);
        }
        drop(reader);
        let (mut transaction, now) = self.write().await?;
        let claim = jobs::claim(&mut transaction, terms, now).await?;
        transaction.commit().await?;
        Ok(claim)
    }

    async fn renew(
        &self,
        claim: &Claim,
        lease: Duration,
        progress: Option<Progress>,
    ) -> Result<bool, StoreError> {
        let mut connection = self.pool.acquire().await?;
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

    async fn abandoned(&self, limit: usize) -> Result<Vec<ObjectName>, StoreError> {
        let mut connection = self.pool.acquire().await?;
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
        Ok(transaction.commit().await?)
    }

    async fn forget_holders(&self) -> Result<(), StoreError> {
        upkeep::check_file(&self.pool).await?;
        let (mut transaction, now) = self.write().await?;
        jobs::end_leases(&mut transaction, now).await?;
        pins::expire_all(&mut transaction, now).await?;
        tombstones::end_leases(&mut transaction, now).await?;
        transaction.commit().await?;
        upkeep::empty_log(&self.pool).await;
        Ok(())
    }

    async fn check(&self) -> Result<(), StoreError> {
        let (mut transaction, _) = self.write().await?;
        sqlx::query("UPDATE fence SET value = value")
            .execute(&mut *transaction)
            .await?;
        Ok(transaction.rollback().await?)
    }

    async fn close(&self) {
        upkeep::empty_log(&self.pool).await;
        self.pool.close().await;
    }
}

#[cfg(test)]
mod tests {
    use case::{CaseState, ObjectKind};

    use super::*;
    use crate::testing;

    const HOUR: Duration = Duration::from_secs(3600);

    /// Rows in a file that may not grow any further, on one connection.
    async fn full_rows(directory: &Path) -> SqliteRows {
        let options = SqliteConnectOptions::new()
            .filename(directory.join("rows.sqlite"))
            .create_if_missing(true)
            .journal_mode(SqliteJournalMode::Wal);
        let rows = SqliteRows::connect(options, 1).await.unwrap();
        // Less than there is: SQLite takes the size of the file for it.
        sqlx::query("PRAGMA max_page_count = 1")
            .execute(&rows.pool)
            .await
            .unwrap();
        rows
    }

    fn many_pins() -> Pinned {
        let pin = |number: u32| ObjectName {
            kind: ObjectKind::Volume,
            digest: blake3::hash(&number.to_le_bytes()),
        };
        Pinned {
            holder: "somebody".to_owned(),
            names: (0..500).map(pin).collect(),
        }
    }

    #[tokio::test]
    async fn rows_go_on_after_the_disk_was_full() {
        let directory = tempfile::tempdir().unwrap();
        let rows = full_rows(directory.path()).await;
        let full = rows.pin(&many_pins(), HOUR).await.unwrap_err();
        assert!(full.is_full(), "{full:?}");
        // The connection was closed; another one does not have its limit.
        rows.check().await.unwrap();
        rows.pin(&many_pins(), HOUR).await.unwrap();
    }

    /// A file with a ready case, whose facts hold a word that is nowhere else.
    async fn with_a_ready_case(file: &Path) -> (SqliteRows, CaseId) {
        let rows = SqliteRows::open(file).await.unwrap();
        let new = testing::new_case(&rows, "volume").await;
        rows.insert(&new).await.unwrap();
        let claim = testing::claim(&rows).await.unwrap();
        let derived = testing::pinned(&rows, &[]).await;
        rows.publish(&claim, &derived, &testing::facts())
            .await
            .unwrap();
        (rows, new.id)
    }

    fn holds(file: &Path, word: &str) -> bool {
        let bytes = std::fs::read(file).unwrap_or_default();
        bytes
            .windows(word.len())
            .any(|part| part == word.as_bytes())
    }

    #[tokio::test]
    async fn nothing_of_a_deleted_case_stays_in_the_file_or_its_log() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("rows.sqlite");
        let log = directory.path().join("rows.sqlite-wal");
        let (rows, id) = with_a_ready_case(&file).await;
        rows.rename(&id, "CANARY-LABEL").await.unwrap();
        let words = ["CANARY-LABEL".to_owned(), id.to_string()];
        for word in &words {
            assert!(holds(&file, word) || holds(&log, word), "{word}");
        }
        rows.delete(&id).await.unwrap();
        for word in &words {
            assert!(!holds(&file, word) && !holds(&log, word), "{word}");
        }
        rows.close().await;
        assert!(!log.exists());
    }

    #[tokio::test]
    async fn a_digit_that_flips_in_the_facts_is_found_and_they_are_made_again() {
        let directory = tempfile::tempdir().unwrap();
        let (rows, id) = with_a_ready_case(&directory.path().join("rows.sqlite")).await;
        let other = serde_json::to_string(&testing::facts()).unwrap().replacen(
            "\"spacing_mm\":",
            "\"spacing_mm\":1",
            1,
        );
        for found_by_list in [false, true] {
            sqlx::query("UPDATE cases SET facts = ?, state = 'ready', facts_digest = 'another'")
                .bind(&other)
                .execute(&rows.pool)
                .await
                .unwrap();
            if found_by_list {
                rows.cases(None, 10).await.unwrap();
            }
            let case = rows.case(&id).await.unwrap().unwrap();
            assert_eq!((case.state, case.facts), (CaseState::Queued, None));
            assert_eq!(rows.waiting().await.unwrap(), 1);
        }
    }

    #[tokio::test]
    async fn rows_of_an_earlier_version_get_digests() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("rows.sqlite");
        let (rows, id) = with_a_ready_case(&file).await;
        sqlx::query("UPDATE cases SET facts_digest = NULL")
            .execute(&rows.pool)
            .await
            .unwrap();
        rows.close().await;
        let rows = SqliteRows::open(&file).await.unwrap();
        let digest: Option<String> = sqlx::query_scalar("SELECT facts_digest FROM cases")
            .fetch_one(&rows.pool)
            .await
            .unwrap();
        assert!(digest.is_some());
        let case = rows.case(&id).await.unwrap().unwrap();
        assert_eq!(case.state, CaseState::Ready);
    }

    #[tokio::test]
    async fn a_damaged_file_is_not_opened_for_work() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("rows.sqlite");
        let (rows, _) = with_a_ready_case(&file).await;
        // The pages of an index that nobody owns.
        let mut connection = rows.pool.acquire().await.unwrap();
        for statement in [
            "PRAGMA writable_schema = ON",
            "DELETE FROM sqlite_schema WHERE name = 'jobs_by_age'",
        ] {
            sqlx::query(statement)
                .execute(&mut *connection)
                .await
                .unwrap();
        }
        drop(connection);
        rows.close().await;
        let rows = SqliteRows::open(&file).await.unwrap();
        let error = rows.forget_holders().await.unwrap_err();
        assert!(matches!(error, StoreError::DamagedFile(_)), "{error:?}");
    }

    #[tokio::test]
    async fn a_check_writes_nothing() {
        let rows = SqliteRows::in_memory().await.unwrap();
        rows.check().await.unwrap();
        let value: i64 = sqlx::query_scalar("SELECT value FROM fence")
            .fetch_one(&rows.pool)
            .await
            .unwrap();
        assert_eq!(value, 0);
    }

    #[tokio::test]
    async fn rows_of_a_newer_version_are_refused_in_words_and_left_as_they_are() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("rows.sqlite");
        let rows = SqliteRows::open(&file).await.unwrap();
        sqlx::query(
            "INSERT INTO _sqlx_migrations (version, description, success, checksum, execution_time)
             VALUES (9999, 'later', TRUE, x'00', 0)",
        )
        .execute(&rows.pool)
        .await
        .unwrap();
        rows.pool.close().await;
        let before = std::fs::read(&file).unwrap();
        let error = SqliteRows::open(&file).await.unwrap_err();
        assert!(matches!(error, StoreError::NewerSchema { found: 9999, .. }));
        assert!(error.to_string().contains("newer version"), "{error}");
        assert_eq!(std::fs::read(&file).unwrap(), before);
    }
}
