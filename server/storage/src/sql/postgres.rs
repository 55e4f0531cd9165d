//! PostgreSQL: opening a database, and differences from SQLite.
//!
//! Writing transactions take one advisory lock and so run one after another, as in SQLite, so that both back ends
//! behave alike. Each case needs about five, of a few milliseconds each.

use std::io;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use case::CaseId;
use futures_util::StreamExt as _;
use futures_util::stream::{self, BoxStream};
use sqlx::pool::PoolConnection;
use sqlx::postgres::{PgConnectOptions, PgConnection, PgListener, PgPool, PgPoolOptions};
use sqlx::{ConnectOptions as _, Connection as _, Postgres, Transaction};

use crate::rows::Change;
use crate::{LISTEN_AGAIN_AFTER, StoreError, lock};

/// Connections of a process; one of them listens.
const CONNECTIONS: u32 = 8;

/// How long to wait for a connection: short, so that callers learn soon that the database is unreachable.
const ACQUIRE_TIMEOUT: Duration = Duration::from_secs(5);

/// How long an open connection may be silent while nobody else is answered.
const SILENT_FOR: Duration = Duration::from_secs(2);

/// How long to wait after a failed connection before the next attempt.
const AWAY_FOR: Duration = Duration::from_secs(1);
/// Failures of the notifications that are no further apart are one.
const SAME_FAILURE_FOR: Duration = Duration::from_secs(60);

/// The channel for changes (`migrations/postgres`).
const CHANNEL: &str = "isocortex";

/// Settings of a session: the server stops waiting for a lock, and ends a transaction of a silent process, which would
/// block all others.
const SESSION: [(&str, &str); 3] = [
    ("lock_timeout", "20s"),
    ("idle_in_transaction_session_timeout", "20s"),
    ("tcp_user_timeout", "20s"),
];

/// The statement must see what others committed before it got the lock: each has a snapshot of its own at `READ
/// COMMITTED`. The number spells "isocortx".
const BEGIN: &str =
    "BEGIN ISOLATION LEVEL READ COMMITTED; SELECT pg_advisory_xact_lock(7598539469166376056)";

/// The time by the database's clock, which goes on within a transaction.
pub(super) const NOW: &str =
    "SELECT CAST(extract(epoch FROM clock_timestamp()) * 1000000 AS BIGINT) AS now";

/// Opens a database that exists.
pub(super) async fn open(options: PgConnectOptions) -> Result<Connections, StoreError> {
    let options = options.options(SESSION).application_name("isocortex");
    // The pool would only say that it waited too long.
    reach(&options).await?.close().await?;
    let pool = PgPoolOptions::new()
        .max_connections(CONNECTIONS)
        .acquire_timeout(ACQUIRE_TIMEOUT)
        .after_connect(|connection, _| Box::pin(keep_commits(connection)))
        .connect_with(options)
        .await?;
    Ok(Connections {
        pool,
        away: Arc::default(),
        reached_at: Arc::new(Mutex::new(Instant::now())),
    })
}

/// Whether a database has the table of cases.
pub(super) async fn has_cases(options: PgConnectOptions) -> Result<bool, StoreError> {
    let mut connection = reach(&options.application_name("isocortex")).await?;
    let has = sqlx::query_scalar("SELECT to_regclass('cases') IS NOT NULL")
        .fetch_one(&mut connection)
        .await?;
    connection.close().await?;
    Ok(has)
}

/// Connects within [`ACQUIRE_TIMEOUT`].
async fn reach(options: &PgConnectOptions) -> Result<PgConnection, sqlx::Error> {
    let silent = |_elapsed| {
        let words = "the database does not answer";
        sqlx::Error::Io(io::Error::new(io::ErrorKind::TimedOut, words))
    };
    let reached = tokio::time::timeout(ACQUIRE_TIMEOUT, options.connect());
    reached.await.map_err(silent)?
}

/// A committed row must survive a loss of power, whatever the database is configured to.
async fn keep_commits(connection: &mut PgConnection) -> Result<(), sqlx::Error> {
    sqlx::query(
        "SELECT set_config('synchronous_commit', 'on', FALSE)
         WHERE current_setting('synchronous_commit') = 'off'",
    )
    .execute(connection)
    .await?;
    Ok(())
}

/// Connections to a database that may be away for a while.
///
/// While it is, one caller at a time tries to reach it and all others are told at once.
#[derive(Debug, Clone)]
pub(crate) struct Connections {
    pool: PgPool,
    /// Held for moments.
    away: Arc<Mutex<Option<Away>>>,
    /// When it was reached last. Held for moments.
    reached_at: Arc<Mutex<Instant>>,
}

/// A database that cannot be reached.
#[derive(Debug)]
struct Away {
    /// Until when nobody else tries.
    until: Instant,
    /// Why, as far as the latest attempt knows.
    cause: Option<(io::ErrorKind, String)>,
}

impl Away {
    fn error(&self) -> sqlx::Error {
        match &self.cause {
            Some((kind, words)) => sqlx::Error::Io(io::Error::new(*kind, words.clone())),
            None => sqlx::Error::PoolTimedOut,
        }
    }
}

impl Connections {
    /// The connections themselves, for the migrations.
    pub(super) fn pool(&self) -> &PgPool {
        &self.pool
    }

    pub(super) async fn acquire(&self) -> Result<PoolConnection<Postgres>, sqlx::Error> {
        self.reached_by(self.answered(self.pool.acquire())).await
    }

    /// Gives up early if the database hangs: there are open connections, and none is answered.
    async fn answered<T>(
        &self,
        attempt: impl Future<Output = Result<T, sqlx::Error>>,
    ) -> Result<T, sqlx::Error> {
        if self.pool.num_idle() == 0 {
            return attempt.await;
        }
        let mut attempt = std::pin::pin!(attempt);
        loop {
            let begun = Instant::now();
            match tokio::time::timeout(SILENT_FOR, &mut attempt).await {
                Ok(ended) => return ended,
                // Others are answered: it waits for its turn.
                Err(_) if *lock(&self.reached_at) >= begun => {}
                Err(_) => return Err(sqlx::Error::PoolTimedOut),
            }
        }
    }

    /// A writing transaction, once all others have ended.
    pub(super) async fn begin(&self) -> Result<Transaction<'static, Postgres>, sqlx::Error> {
        self.reached_by(self.pool.begin_with(BEGIN)).await
    }

    async fn reached_by<T>(
        &self,
        attempt: impl Future<Output = Result<T, sqlx::Error>>,
    ) -> Result<T, sqlx::Error> {
        {
            let mut away = lock(&self.away);
            match &mut *away {
                Some(away) if Instant::now() < away.until => return Err(away.error()),
                Some(away) => away.until = Instant::now() + ACQUIRE_TIMEOUT,
                None => {}
            }
        }
        let mut reached = attempt.await;
        if reached.is_ok() {
            *lock(&self.reached_at) = Instant::now();
        }
        if let Err(error) = reached {
            reached = Err(cause(&self.pool, error).await);
        }
        let away_for = match &reached {
            Err(sqlx::Error::Io(error)) => Some((error.kind(), error.to_string())),
            _ => None,
        };
        let is_away = away_for.is_some() || matches!(reached, Err(sqlx::Error::PoolTimedOut));
        *lock(&self.away) = is_away.then(|| Away {
            until: Instant::now() + AWAY_FOR,
            cause: away_for,
        });
        reached
    }

    /// Whether the database can be written: a standby cannot.
    pub(super) async fn check(&self) -> Result<(), StoreError> {
        let mut connection = self.acquire().await?;
        let read_only: String = sqlx::query_scalar("SHOW transaction_read_only")
            .fetch_one(&mut *connection)
            .await?;
        match read_only.as_str() {
            "off" => Ok(()),
            _ => Err(StoreError::Rows("the database is read-only".into())),
        }
    }

    /// The changes that all processes make from now on.
    pub(super) async fn changes(&self) -> Result<BoxStream<'static, Change>, StoreError> {
        let mut listener = PgListener::connect_with(&self.pool).await?;
        listener.listen(CHANNEL).await?;
        let first = (listener, None, self.pool.clone());
        let announced = stream::unfold(first, |(mut listener, mut failed_at, pool)| async move {
            loop {
                match listener.recv().await {
                    Ok(announced) => return Some((announced, (listener, None, pool))),
                    Err(sqlx::Error::PoolClosed) => return None,
                    Err(error) => {
                        // Once, not at each attempt.
                        let is_new =
                            failed_at.is_none_or(|at: Instant| at.elapsed() > SAME_FAILURE_FOR);
                        if is_new {
                            let error = cause(&pool, error).await;
                            tracing::warn!(%error, "notifications from the database are interrupted; changes by other processes are noticed with a delay");
                        }
                        failed_at = Some(Instant::now());
                        tokio::time::sleep(LISTEN_AGAIN_AFTER).await;
                    }
                }
            }
        });
        let read =
            announced.filter_map(|announced| async move { read_change(announced.payload()) });
        Ok(read.boxed())
    }

    /// Ends all connections.
    pub(super) async fn close(&self) {
        self.pool.close().await;
    }
}

/// Why no connection was had in time, if one more attempt tells.
async fn cause(pool: &PgPool, error: sqlx::Error) -> sqlx::Error {
    if !matches!(error, sqlx::Error::PoolTimedOut) {
        return error;
    }
    let options = pool.connect_options();
    match tokio::time::timeout(AWAY_FOR, options.connect()).await {
        Ok(Err(cause)) => cause,
        _ => error,
    }
}

fn read_change(payload: &str) -> Option<Change> {
    match payload.split_once(' ') {
        Some(("changed", id)) => CaseId::parse(id).map(Change::Changed),
        Some(("deleted", id)) => CaseId::parse(id).map(Change::Deleted),
        _ => (payload == "queued").then_some(Change::Queued),
    }
}

#[cfg(test)]
mod tests {
    use crate::CaseQuery;
    use std::collections::HashSet;

    use futures_util::future::join_all;

    use super::*;
    use case::JobKind;

    use crate::conformance::Subject;
    use crate::rows::{Published, Referred};
    use crate::sql::Rows;
    use crate::sql::connection::Database;
    use crate::testing::postgres::PostgresServer;
    use crate::testing::{claim, facts, new_case, pinned};
    use crate::{NewJob, Store};

    async fn store_at(address: &str) -> Store {
        let rows = Rows::postgres(address.parse().unwrap(), Arc::new(())).await;
        Subject::new(rows.unwrap(), ()).await.store
    }

    fn pool(store: &Store) -> &PgPool {
        match &store.rows().database {
            Database::Postgres(connections) => &connections.pool,
            Database::Sqlite(_) => unreachable!("these rows are in PostgreSQL"),
        }
    }

    #[tokio::test]
    async fn a_store_in_postgresql_does_what_it_must() {
        let Some(server) = PostgresServer::start().await else {
            return;
        };
        let subject = async || {
            let address = server.database().await;
            let rows = Rows::postgres(address.parse().unwrap(), Arc::new(())).await;
            Subject::new(rows.unwrap(), ()).await
        };
        crate::conformance::conformance! { in_turn subject }
    }

    /// KEDA starts workers by what this query counts.
    #[tokio::test]
    async fn the_scaler_counts_the_jobs_that_a_worker_could_do() {
        let Some(server) = PostgresServer::start().await else {
            return;
        };
        let manifest = include_str!("../../../../docker/kubernetes/scaler.yaml");
        let (_, query) = manifest.split_once("query: >-").unwrap();
        let (query, _) = query.split_once("targetQueryValue").unwrap();
        let store = store_at(&server.database().await).await;
        let count = async || -> i64 {
            let counted = sqlx::query_scalar(sqlx::AssertSqlSafe(query.trim()));
            counted.fetch_one(pool(&store)).await.unwrap()
        };
        assert_eq!(count().await, 0);
        let new = new_case(&store, "a").await;
        store.insert_case(&new).await.unwrap();
        // It waits for the case.
        let maps = NewJob::about(JobKind::MAPS, &new.id);
        store.enqueue(&maps).await.unwrap();
        // A worker sends nothing.
        let send = NewJob {
            kind: JobKind::new("send", "delivery"),
            needs_ready: false,
            ..maps
        };
        store.enqueue(&send).await.unwrap();
        assert_eq!(count().await, 1);
        let leased = claim(&store).await.unwrap();
        assert_eq!(count().await, 1, "a job at work counts");
        let derived = pinned(&store, &[]).await;
        store
            .make_case_ready(&leased, &derived, &facts(), &[JobKind::REBUILD])
            .await
            .unwrap();
        assert_eq!(count().await, 2, "the maps and the rebuild");
    }

    #[tokio::test]
    async fn copies_that_start_at_once_migrate_once_and_share_the_jobs() {
        const CASES: usize = 24;
        let Some(server) = PostgresServer::start().await else {
            return;
        };
        let address = server.database().await;
        let copies = join_all((0..4).map(|_| store_at(&address))).await;
        let inserting = (0..CASES).map(|number| {
            let store = &copies[number % copies.len()];
            async move {
                let new = new_case(store, &number.to_string()).await;
                assert!(matches!(
                    store.insert_case(&new).await.unwrap(),
                    Referred::Done(_)
                ));
            }
        });
        join_all(inserting).await;
        let claiming = (0..2 * CASES).map(|number| claim(&copies[number % copies.len()]));
        let claims: Vec<_> = join_all(claiming).await.into_iter().flatten().collect();
        let cases: HashSet<_> = claims.iter().map(|claim| claim.case).collect();
        let fences: HashSet<_> = claims.iter().map(|claim| claim.fence).collect();
        assert_eq!(
            (claims.len(), cases.len(), fences.len()),
            (CASES, CASES, CASES)
        );
    }

    #[tokio::test]
    async fn rows_of_a_newer_version_are_refused_in_words() {
        let Some(server) = PostgresServer::start().await else {
            return;
        };
        let address = server.database().await;
        let store = store_at(&address).await;
        sqlx::query(
            "INSERT INTO _sqlx_migrations (version, description, success, checksum, execution_time)
             VALUES (9999, 'later', TRUE, '', 0)",
        )
        .execute(pool(&store))
        .await
        .unwrap();
        let error = Rows::postgres(address.parse().unwrap(), Arc::new(()))
            .await
            .unwrap_err();
        assert!(matches!(error, StoreError::NewerSchema { found: 9999, .. }));
        assert!(error.to_string().contains("newer version"), "{error}");
    }

    #[tokio::test]
    async fn one_copy_hears_what_another_does_also_after_the_database_was_away() {
        let Some(mut server) = PostgresServer::start().await else {
            return;
        };
        let address = server.database().await;
        let (here, there) = (store_at(&address).await, store_at(&address).await);
        let mut changes = here.rows().database.changes().await.unwrap().unwrap();
        let mut heard = async |awaited: Change| {
            let hear = async { while changes.next().await.unwrap() != awaited {} };
            let patience = Duration::from_secs(10);
            tokio::time::timeout(patience, hear).await.unwrap();
        };
        let new = new_case(&there, "a").await;
        there.insert_case(&new).await.unwrap();
        heard(Change::Queued).await;
        claim(&there).await.unwrap();
        heard(Change::Changed(new.id)).await;

        server.stop();
        assert!(there.rows().database.check().await.is_err());
        server.start_again().await;
        let begun = Instant::now();
        while there.rows().database.check().await.is_err() {
            assert!(begun.elapsed() < Duration::from_secs(10));
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
        let mut hears = std::pin::pin!(heard(Change::Deleted(new.id)));
        // It listens again at some moment within the next seconds.
        loop {
            there.delete_rows(&new.id).await.unwrap();
            tokio::select! {
                () = &mut hears => break,
                () = tokio::time::sleep(Duration::from_millis(200)) => {}
            }
            there
                .insert_case(&new_case(&there, "a").await)
                .await
                .unwrap();
        }
    }

    async fn until(raised: &mut tokio::sync::watch::Receiver<bool>) {
        drop(raised.wait_for(|is_raised| *is_raised).await);
    }

    /// A way to a database that can be made to hang: what is sent is swallowed from then on.
    async fn hanging_way(to: std::path::PathBuf) -> (u16, tokio::sync::watch::Sender<bool>) {
        let here = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let port = here.local_addr().unwrap().port();
        let (hangs, seen) = tokio::sync::watch::channel(false);
        tokio::spawn(async move {
            while let Ok((mut client, _)) = here.accept().await {
                let (mut seen, to) = (seen.clone(), to.clone());
                tokio::spawn(async move {
                    let mut server = tokio::net::UnixStream::connect(to).await.unwrap();
                    tokio::select! {
                        _ = tokio::io::copy_bidirectional(&mut client, &mut server) => {}
                        () = until(&mut seen) => std::future::pending().await,
                    }
                });
            }
        });
        (port, hangs)
    }

    #[tokio::test]
    async fn a_database_that_hangs_is_away_after_two_seconds_and_then_at_once() {
        let Some(server) = PostgresServer::start().await else {
            return;
        };
        let address = server.database().await;
        let options: PgConnectOptions = address.parse().unwrap();
        let socket = format!(".s.PGSQL.{}", options.get_port());
        let (port, hangs) = hanging_way(options.get_socket().unwrap().join(socket)).await;
        let name = options.get_database().unwrap();
        let store = store_at(&format!("postgres://postgres@127.0.0.1:{port}/{name}")).await;
        store.rows().database.check().await.unwrap();
        hangs.send_replace(true);
        for longest in [ACQUIRE_TIMEOUT - Duration::from_secs(1), AWAY_FOR] {
            let begun = Instant::now();
            let error = store
                .cases(&CaseQuery::default(), None, 1)
                .await
                .unwrap_err();
            assert!(error.is_away(), "{error:?}");
            assert!(begun.elapsed() < longest, "{:?}", begun.elapsed());
        }
    }

    /// How fast jobs go through a table with a million cases and their ended jobs behind them, with 8 clients of two processes.
    #[tokio::test]
    #[ignore = "a measurement: run it alone, with --no-capture"]
    async fn the_rate_of_jobs() {
        const JOBS: usize = 400;
        let Some(server) = PostgresServer::start_durable().await else {
            return;
        };
        let address = server.database().await;
        let copies = [store_at(&address).await, store_at(&address).await];
        sqlx::raw_sql(
            "INSERT INTO cases (id, closing_radius_mm, state, facts, facts_digest, created_at)
             SELECT md5(n::TEXT), 10, 'ready', repeat('facts ', 150), repeat('0', 64), n FROM generate_series(1, 1000000) AS n;
             INSERT INTO jobs (id, kind, key, case_id, needs_ready, payload, state, attempts, created_at, available_at, ended_at)
             SELECT md5(n::TEXT), 'prepare', md5(n::TEXT), md5(n::TEXT), FALSE, '{}', 'done', 1, n, n, n
             FROM generate_series(1, 1000000) AS n;
             ANALYZE",
        )
        .execute(pool(&copies[0]))
        .await
        .unwrap();
        let of_client = |client: usize| (0..JOBS / 8).map(move |job| format!("{client} {job}"));
        let (begun, store) = (Instant::now(), |client: usize| {
            &copies[client % copies.len()]
        });
        join_all((0..8).map(|client| async move {
            for name in of_client(client) {
                let mut new = new_case(store(client), &name).await;
                new.queue_limit = JOBS;
                store(client).insert_case(&new).await.unwrap();
            }
        }))
        .await;
        let queued = begun.elapsed();
        join_all((0..8).map(|client| async move {
            while let Some(claim) = claim(store(client)).await {
                let derived = pinned(store(client), &[]).await;
                let published = store(client)
                    .make_case_ready(&claim, &derived, &facts(), &[])
                    .await;
                assert_eq!(published.unwrap(), Referred::Done(Published::Done));
            }
        }))
        .await;
        let done = begun.elapsed() - queued;
        let rate = |time: Duration| JOBS as f64 / time.as_secs_f64();
        println!("{:.0} uploads/s, {:.0} jobs/s", rate(queued), rate(done));
    }
}
