//! SQLite: opening and protecting its file.
//!
//! Write-ahead logging, and `synchronous=FULL`: with `NORMAL`, a power failure may lose a committed row. Writing
//! transactions begin as `IMMEDIATE`, so that none fails half-way because another one wrote. SQLite knows the time to
//! the millisecond.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use sqlx::sqlite::{
    SqliteConnectOptions, SqliteConnection, SqliteJournalMode, SqlitePool, SqlitePoolOptions,
    SqliteSynchronous,
};
use sqlx::{ConnectOptions as _, Connection as _, Row as _, Sqlite, Transaction};
use tokio::sync::Mutex;

use crate::StoreError;

/// How long a transaction waits for one of another process.
const BUSY_TIMEOUT: Duration = Duration::from_secs(20);

/// Connections to a file: one writes, the others read meanwhile.
pub(super) const CONNECTIONS: u32 = 4;

/// The time by the database's clock.
pub(super) const NOW: &str = "SELECT CAST(unixepoch('subsec') * 1000 AS INTEGER) * 1000 AS now";

/// The options for a file, which is created if necessary.
pub(super) fn in_file(file: &Path) -> SqliteConnectOptions {
    SqliteConnectOptions::new()
        .filename(file)
        .create_if_missing(true)
        .journal_mode(SqliteJournalMode::Wal)
        .synchronous(SqliteSynchronous::Full)
        .pragma("secure_delete", "ON")
}

/// Connections to a database.
#[derive(Debug, Clone)]
pub(crate) struct Connections {
    pool: SqlitePool,
    log: Arc<Log>,
}

/// The write-ahead log of a file, from which a commit that failed is taken back.
///
/// If `fsync` fails, a commit fails although all of it is in the log. Nobody sees it, but whoever opens the file after
/// the process was killed would take it from there: a change that was refused would happen later. So something else is
/// written over its beginning, which needs no `fsync`: what follows does not match its checksum any more.
#[derive(Debug)]
pub(super) struct Log {
    /// It waits for no disk (`synchronous=OFF`). It is open as long as the pool, so no connection of the pool is the last
    /// one, which would read the log when it opens the file again. `None` in memory, and once closed.
    writer: Mutex<Option<SqliteConnection>>,
    has_failed_commit: AtomicBool,
}

impl Connections {
    /// Opens a file.
    pub(super) async fn open(
        options: SqliteConnectOptions,
        connections: u32,
    ) -> Result<Self, StoreError> {
        let pool = pool(options.clone(), connections).await?;
        let writer = options
            .busy_timeout(BUSY_TIMEOUT)
            .synchronous(SqliteSynchronous::Off)
            // A checkpoint that does not wait for the disk could lose what is in the log.
            .pragma("wal_autocheckpoint", "0")
            .connect()
            .await?;
        Ok(Self {
            pool,
            log: Arc::new(Log::of(Some(writer))),
        })
    }

    /// Opens a database in memory, which ends with its last user.
    pub(super) async fn in_memory() -> Result<Self, StoreError> {
        Ok(Self {
            pool: pool(SqliteConnectOptions::new().in_memory(true), 1).await?,
            log: Arc::new(Log::of(None)),
        })
    }

    pub(super) fn pool(&self) -> &SqlitePool {
        &self.pool
    }

    /// A writing transaction, and where it is committed. None begins before a commit that failed is taken back.
    pub(super) async fn begin(
        &self,
    ) -> Result<(Transaction<'static, Sqlite>, Arc<Log>), sqlx::Error> {
        self.log.take_back().await?;
        let transaction = self.pool.begin_with("BEGIN IMMEDIATE").await?;
        Ok((transaction, Arc::clone(&self.log)))
    }

    /// Whether the file can be written. Changes nothing.
    pub(super) async fn check(&self) -> Result<(), StoreError> {
        let (mut transaction, _) = self.begin().await?;
        sqlx::query("UPDATE fence SET value = value")
            .execute(&mut *transaction)
            .await?;
        Ok(transaction.rollback().await?)
    }

    /// Ends all connections and empties the log.
    pub(super) async fn close(&self) {
        if let Some(writer) = self.log.writer.lock().await.take()
            && let Err(error) = writer.close().await
        {
            tracing::warn!(%error, "a connection to the database did not end in order");
        }
        empty_log(&self.pool).await;
        self.pool.close().await;
    }
}

impl Log {
    fn of(writer: Option<SqliteConnection>) -> Self {
        Self {
            writer: Mutex::new(writer),
            has_failed_commit: AtomicBool::new(false),
        }
    }

    /// Commits a transaction. If that fails, it is taken back before the caller learns of it.
    pub(super) async fn commit(
        &self,
        transaction: Transaction<'static, Sqlite>,
    ) -> Result<(), sqlx::Error> {
        let Err(failed) = transaction.commit().await else {
            return Ok(());
        };
        self.has_failed_commit.store(true, Ordering::Release);
        if let Err(error) = self.take_back().await {
            tracing::error!(%error, "a change that was refused may happen if the process ends before the disk is well");
        }
        Err(failed)
    }

    /// Writes over a commit that failed, if there is one.
    async fn take_back(&self) -> Result<(), sqlx::Error> {
        if !self.has_failed_commit.load(Ordering::Acquire) {
            return Ok(());
        }
        let mut writer = self.writer.lock().await;
        if let Some(writer) = &mut *writer {
            // This writes the first page whatever is in it; an `UPDATE` that changes nothing writes nothing.
            let write = "BEGIN IMMEDIATE; PRAGMA user_version = 0; COMMIT";
            if let Err(error) = sqlx::raw_sql(write).execute(&mut *writer).await {
                // It has rolled itself back after most errors.
                let _no_transaction = sqlx::raw_sql("ROLLBACK").execute(&mut *writer).await;
                return Err(error);
            }
        }
        self.has_failed_commit.store(false, Ordering::Release);
        Ok(())
    }
}

async fn pool(options: SqliteConnectOptions, connections: u32) -> Result<SqlitePool, StoreError> {
    let options = options.foreign_keys(true).busy_timeout(BUSY_TIMEOUT);
    let pool = SqlitePoolOptions::new()
        .max_connections(connections)
        .idle_timeout(None)
        .max_lifetime(None)
        .after_release(|connection, _| Box::pin(async { is_reusable(connection).await }))
        .connect_with(options)
        .await?;
    Ok(pool)
}

/// Whether a connection that was given back can be used again.
///
/// After `SQLITE_FULL` and most I/O errors SQLite itself has rolled the transaction back. The `ROLLBACK` that follows
/// then fails, and sqlx counts the connection as inside its transaction for ever: every later `BEGIN` on it fails. Such
/// a connection is closed.
async fn is_reusable(connection: &mut SqliteConnection) -> Result<bool, sqlx::Error> {
    // A rollback that is under way is over once the connection answers.
    connection.ping().await?;
    Ok(!connection.is_in_transaction())
}

/// Whether the structure of the file is whole.
///
/// # Errors
/// If it is not, with the message of SQLite.
pub(super) async fn check_file(pool: &SqlitePool) -> Result<(), StoreError> {
    let found: String = sqlx::query_scalar("PRAGMA quick_check(1)")
        .fetch_one(pool)
        .await?;
    match found.as_str() {
        "ok" => Ok(()),
        fault => Err(StoreError::DamagedFile(fault.to_owned())),
    }
}

/// Writes the log into the file and empties it. What was deleted is in neither from then on (`secure_delete` has
/// overwritten it).
///
/// What fails is done at the next deletion, or when the file is opened or closed.
pub(super) async fn empty_log(pool: &SqlitePool) {
    let emptied = sqlx::query("PRAGMA wal_checkpoint(TRUNCATE)")
        .fetch_one(pool)
        .await;
    match emptied.and_then(|row| row.try_get::<i64, _>(0)) {
        Ok(0) => {}
        Ok(_) => tracing::warn!("the log of the database is in use and will be emptied later"),
        Err(error) => {
            tracing::warn!(%error, "the log of the database could not be emptied and will be emptied later");
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::CaseQuery;
    use crate::testing::{rename, waiting};
    use case::{CaseId, CaseState, ObjectKind};

    use super::*;
    use crate::args;
    use crate::conformance::Subject;
    use crate::rows::Referred;
    use crate::sql::Rows;
    use crate::sql::connection::Database;
    use crate::{ObjectName, Pinned, Published, Store, testing};

    async fn on(rows: Rows) -> Store {
        Subject::new(rows, ()).await.store
    }

    async fn at(file: &Path) -> Result<Store, StoreError> {
        Ok(on(Rows::sqlite(file, Arc::new(())).await?).await)
    }

    const HOUR: Duration = Duration::from_secs(3600);

    fn pool(store: &Store) -> &SqlitePool {
        match &store.rows().database {
            Database::Sqlite(connections) => connections.pool(),
            Database::Postgres(_) => unreachable!("these rows are in SQLite"),
        }
    }

    /// Rows in a file that may not grow any further, on one connection.
    async fn full_store(directory: &Path) -> Store {
        let options = SqliteConnectOptions::new()
            .filename(directory.join("rows.sqlite"))
            .create_if_missing(true)
            .journal_mode(SqliteJournalMode::Wal);
        let store = on(Rows::on_sqlite(options, 1, Arc::new(())).await.unwrap()).await;
        // Less than there is: SQLite takes the size of the file for it.
        sqlx::query("PRAGMA max_page_count = 1")
            .execute(pool(&store))
            .await
            .unwrap();
        store
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
        let store = full_store(directory.path()).await;
        let full = store.try_pin(&many_pins(), HOUR).await.unwrap_err();
        assert!(full.is_full(), "{full:?}");
        // The connection was closed; another one does not have its limit.
        store.rows().database.check().await.unwrap();
        store.try_pin(&many_pins(), HOUR).await.unwrap();
    }

    /// The label of the only case in a copy of a file and its log, as after a kill.
    async fn label_after_a_kill(file: &Path) -> Option<String> {
        let copies = tempfile::tempdir().unwrap();
        let copy = copies.path().join("rows.sqlite");
        std::fs::copy(file, &copy).unwrap();
        std::fs::copy(log_of(file), log_of(&copy)).unwrap();
        let store = at(&copy).await.unwrap();
        let page = store.cases(&CaseQuery::default(), None, 1).await.unwrap();
        page.cases[0].case.parameters.name.clone()
    }

    fn log_of(file: &Path) -> std::path::PathBuf {
        file.with_file_name("rows.sqlite-wal")
    }

    /// Leaves a change of the label in the log as if the `fsync` of its commit had failed.
    async fn leave_a_failed_commit(file: &Path, id: &CaseId, label: &str) {
        let copies = tempfile::tempdir().unwrap();
        let copy = copies.path().join("rows.sqlite");
        let before = std::fs::read(log_of(file)).unwrap();
        std::fs::copy(file, &copy).unwrap();
        std::fs::write(log_of(&copy), &before).unwrap();
        let store = at(&copy).await.unwrap();
        rename(&store, id, label).await;
        let after = std::fs::read(log_of(&copy)).unwrap();
        assert!(after.starts_with(&before) && after.len() > before.len());
        let mut log = std::fs::OpenOptions::new()
            .append(true)
            .open(log_of(file))
            .unwrap();
        std::io::Write::write_all(&mut log, &after[before.len()..]).unwrap();
    }

    #[tokio::test]
    async fn a_commit_that_failed_is_taken_back_before_anything_else() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("rows.sqlite");
        let (store, id) = with_a_ready_case(&file).await;
        rename(&store, &id, "before").await;
        leave_a_failed_commit(&file, &id, "refused").await;
        let seen = store.case(&id).await.unwrap().unwrap();
        assert_eq!(seen.parameters.name.as_deref(), Some("before"));
        assert_eq!(label_after_a_kill(&file).await.as_deref(), Some("refused"));

        let Database::Sqlite(connections) = &store.rows().database else {
            unreachable!("these rows are in SQLite")
        };
        let has_failed = &connections.log.has_failed_commit;
        has_failed.store(true, Ordering::Release);
        store.rows().database.check().await.unwrap();
        assert!(!has_failed.load(Ordering::Acquire));
        assert_eq!(label_after_a_kill(&file).await.as_deref(), Some("before"));
        rename(&store, &id, "after").await;
        assert_eq!(label_after_a_kill(&file).await.as_deref(), Some("after"));
    }

    #[tokio::test]
    async fn a_claim_that_a_power_cut_lost_gives_its_number_to_nobody_else() {
        let directory = tempfile::tempdir().unwrap();
        let store = at(&directory.path().join("rows.sqlite")).await.unwrap();
        let new = testing::new_case(&store, "volume").await;
        store.insert_case(&new).await.unwrap();
        let lost = testing::claim(&store).await.unwrap();
        // As if its commit had not reached the disk, while its holder goes on.
        sqlx::raw_sql(
            "UPDATE fence SET value = 0;
             UPDATE jobs SET state = 'queued', attempts = 0, fence = 0, lease_until = NULL",
        )
        .execute(pool(&store))
        .await
        .unwrap();
        let again = testing::claim(&store).await.unwrap();
        assert_eq!(again.id, lost.id);
        assert!(again.fence > lost.fence, "{} {}", again.fence, lost.fence);
        let derived = testing::pinned(&store, &[]).await;
        let late = store
            .make_case_ready(&lost, &derived, &testing::facts(), &[])
            .await;
        assert_eq!(late.unwrap(), Referred::Unneeded(Published::Fenced));
        let derived = testing::pinned(&store, &[]).await;
        let done = store
            .make_case_ready(&again, &derived, &testing::facts(), &[])
            .await;
        assert_eq!(done.unwrap(), Referred::Done(Published::Done));
    }

    /// A file with a ready case, whose facts hold a word that is nowhere else.
    async fn with_a_ready_case(file: &Path) -> (Store, CaseId) {
        let store = at(file).await.unwrap();
        let new = testing::new_case(&store, "volume").await;
        store.insert_case(&new).await.unwrap();
        let claim = testing::claim(&store).await.unwrap();
        let derived = testing::pinned(&store, &[]).await;
        store
            .make_case_ready(&claim, &derived, &testing::facts(), &[])
            .await
            .unwrap();
        (store, new.id)
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
        let (store, id) = with_a_ready_case(&file).await;
        rename(&store, &id, "CANARY-LABEL").await;
        let words = ["CANARY-LABEL".to_owned(), id.to_string()];
        for word in &words {
            assert!(holds(&file, word) || holds(&log, word), "{word}");
        }
        store.delete_rows(&id).await.unwrap();
        for word in &words {
            assert!(!holds(&file, word) && !holds(&log, word), "{word}");
        }
        store.rows().database.close().await;
        assert!(!log.exists());
    }

    #[tokio::test]
    async fn a_digit_that_flips_in_the_facts_is_found_and_they_are_made_again() {
        let directory = tempfile::tempdir().unwrap();
        let (store, id) = with_a_ready_case(&directory.path().join("rows.sqlite")).await;
        let other = serde_json::to_string(&testing::facts()).unwrap().replacen(
            "\"spacing_mm\":",
            "\"spacing_mm\":1",
            1,
        );
        for found_by_list in [false, true] {
            sqlx::query("UPDATE cases SET facts = ?, state = 'ready', facts_digest = 'another'")
                .bind(&other)
                .execute(pool(&store))
                .await
                .unwrap();
            if found_by_list {
                store.cases(&CaseQuery::default(), None, 10).await.unwrap();
            }
            let case = store.case(&id).await.unwrap().unwrap();
            assert_eq!((case.state, case.facts), (CaseState::Queued, None));
            assert_eq!(waiting(&store, case::JobKind::PREPARE).await, 1);
        }
    }

    #[tokio::test]
    async fn cases_of_a_program_without_their_keys_get_them() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("rows.sqlite");
        let (store, ready) = with_a_ready_case(&file).await;
        rename(&store, &ready, "case 10").await;
        let new = testing::new_case(&store, "another").await;
        store.insert_case(&new).await.unwrap();
        rename(&store, &new.id, "Case 9").await;
        // As that program leaves them; one of the two has damaged facts.
        sqlx::query("UPDATE cases SET label_key = NULL, mask = NULL, facts = CASE name WHEN 'Case 9' THEN '{' ELSE facts END")
            .execute(pool(&store))
            .await
            .unwrap();
        store.rows().database.close().await;
        let store = at(&file).await.unwrap();
        let keys: Vec<(String, Option<String>)> =
            sqlx::query_as("SELECT label_key, mask FROM cases ORDER BY label_key")
                .fetch_all(pool(&store))
                .await
                .unwrap();
        let expected = [("case 0019", None), ("case 00210", Some(""))];
        let expected = expected.map(|(key, mask)| (key.to_owned(), mask.map(str::to_owned)));
        assert_eq!(keys, expected);
    }

    #[tokio::test]
    async fn a_damaged_file_is_not_opened_for_work() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("rows.sqlite");
        let (store, _) = with_a_ready_case(&file).await;
        // The pages of an index that nobody owns.
        let mut connection = pool(&store).acquire().await.unwrap();
        for statement in [
            "PRAGMA writable_schema = ON",
            "DELETE FROM sqlite_schema WHERE name = 'jobs_by_case'",
        ] {
            sqlx::query(statement)
                .execute(&mut *connection)
                .await
                .unwrap();
        }
        drop(connection);
        store.rows().database.close().await;
        let store = at(&file).await.unwrap();
        let error = store.rows().database.check_file().await.unwrap_err();
        assert!(matches!(error, StoreError::DamagedFile(_)), "{error:?}");
    }

    #[tokio::test]
    async fn a_transaction_that_is_not_committed_changes_nothing() {
        let directory = tempfile::tempdir().unwrap();
        let store = at(&directory.path().join("rows.sqlite")).await;
        let store = store.unwrap();
        let fence = async || {
            let mut connection = store.rows().connect().await.unwrap();
            let query = connection.fetch_one("SELECT value FROM fence", args![]);
            query.await.unwrap().get::<i64>("value").unwrap()
        };
        for (is_committed, expected) in [(false, 0), (true, 7)] {
            let (mut transaction, _) = store.rows().write().await.unwrap();
            let changed = transaction.execute("UPDATE fence SET value = $1", args![7_i64]);
            assert_eq!(changed.await.unwrap(), 1);
            assert_eq!(fence().await, 0, "others do not see it yet");
            match is_committed {
                true => transaction.commit().await.unwrap(),
                false => drop(transaction),
            }
            assert_eq!(fence().await, expected);
        }
    }

    #[tokio::test]
    async fn rows_that_cannot_be_understood_are_errors_and_not_guesses() {
        for (change, words) in [
            ("UPDATE cases SET state = 'paused'", "unknown state"),
            (
                "UPDATE cases SET created_at = 9223372036854775806",
                "unknown time",
            ),
            (
                "UPDATE cases SET parameters = '{\"colour\": 1}'",
                "unknown field",
            ),
            ("UPDATE cases SET failure = 'nonsense'", "expected"),
            ("UPDATE cases SET id = 'nonsense'", "unknown id"),
            ("UPDATE case_objects SET kind = 'hologram'", "unknown kind"),
        ] {
            let directory = tempfile::tempdir().unwrap();
            let (store, id) = with_a_ready_case(&directory.path().join("rows.sqlite")).await;
            let mut connection = pool(&store).acquire().await.unwrap();
            for statement in [
                "PRAGMA foreign_keys = OFF",
                "PRAGMA ignore_check_constraints = ON",
                change,
            ] {
                sqlx::query(statement)
                    .execute(&mut *connection)
                    .await
                    .unwrap();
            }
            drop(connection);
            let listed = store.cases(&CaseQuery::default(), None, 10).await.map(drop);
            let error = listed
                .and(store.objects_of(&id).await.map(drop))
                .unwrap_err();
            let source = std::error::Error::source(&error).unwrap().to_string();
            assert!(source.contains(words), "{change}: {source}");
        }
    }

    #[tokio::test]
    async fn a_check_writes_nothing() {
        let store = on(Rows::in_memory(Arc::new(())).await.unwrap()).await;
        store.rows().database.check().await.unwrap();
        let value: i64 = sqlx::query_scalar("SELECT value FROM fence")
            .fetch_one(pool(&store))
            .await
            .unwrap();
        assert_eq!(value, 0);
    }

    #[tokio::test]
    async fn rows_of_another_version_are_refused_in_words_and_left_as_they_are() {
        let cases = [
            (
                "INSERT INTO _sqlx_migrations (version, description, success, checksum, execution_time)
                 VALUES (9999, 'later', TRUE, x'00', 0)",
                "newer version",
            ),
            (
                "INSERT INTO _sqlx_migrations (version, description, success, checksum, execution_time)
                 VALUES (99, 'earlier', TRUE, x'00', 0)",
                "development version",
            ),
            (
                "UPDATE _sqlx_migrations SET checksum = x'00' WHERE version = 200",
                "development version",
            ),
            (
                // A development version had several steps.
                "UPDATE _sqlx_migrations SET version = 100 + version / 10 WHERE version >= 200",
                "development version",
            ),
        ];
        for (change, words) in cases {
            let directory = tempfile::tempdir().unwrap();
            let file = directory.path().join("rows.sqlite");
            let store = at(&file).await.unwrap();
            sqlx::query(change).execute(pool(&store)).await.unwrap();
            pool(&store).close().await;
            let before = std::fs::read(&file).unwrap();
            let error = at(&file).await.unwrap_err();
            assert!(error.to_string().contains(words), "{change}: {error}");
            assert_eq!(std::fs::read(&file).unwrap(), before);
        }
    }
}
