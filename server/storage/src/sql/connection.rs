//! One interface to both databases: the statements are written once, in the SQL that SQLite and PostgreSQL share.
//!
//! What waits for a database is a boxed future: sqlx's are large, and would weigh on the stack of every caller.
//!
//! Parameters are `$1`, `$2` … in both. Texts, `i64`, `f32`, `f64` and `bool` are the types of all columns and answers.

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use async_trait::async_trait;
use case::images::Fingerprint;
use case::series::Uid;
use case::{CaseId, Failure, JobKind, ObjectKind};
use futures_util::FutureExt as _;
use futures_util::future::BoxFuture;
use futures_util::stream::BoxStream;
use jiff::Timestamp;
use sqlx::pool::PoolConnection;
use sqlx::postgres::{PgConnection, PgRow};
use sqlx::sqlite::{SqliteConnection, SqliteRow};
use sqlx::{Decode, Encode, Postgres, Row as _, Sqlite, Transaction, Type};

use super::{postgres, sqlite};
use crate::args;
use crate::rows::{Change, Made};
use crate::{ObjectName, StoreError};

/// A new id for a row: 32 hexadecimal digits without a meaning.
pub fn new_id() -> String {
    uuid::Uuid::now_v7().simple().to_string()
}

/// What a row has that nothing here has written.
pub fn unreadable(what: &str) -> StoreError {
    StoreError::Rows(format!("a row has {what} that is unknown").into())
}

/// A duration in the unit of the rows.
pub fn microseconds(duration: Duration) -> i64 {
    i64::try_from(duration.as_micros()).unwrap_or(i64::MAX / 2)
}

/// A pattern of LIKE that finds a text anywhere.
pub fn containing(text: &str) -> String {
    let mut pattern = String::from("%");
    for letter in text.chars() {
        if matches!(letter, '%' | '_' | '!') {
            pattern.push('!');
        }
        pattern.push(letter);
    }
    pattern + "%"
}

/// A column with a time.
pub fn read_time(row: &Row, column: &str) -> Result<Timestamp, StoreError> {
    Timestamp::from_microsecond(row.get(column)?).map_err(|_| unreadable("a time"))
}

/// The name in a row with the columns `kind` and `digest`.
pub(super) fn read_name(row: &Row) -> Result<ObjectName, StoreError> {
    let [kind, digest]: [String; 2] = [row.get("kind")?, row.get("digest")?];
    ObjectName::parse(&kind, &digest)
        .ok_or_else(|| StoreError::Rows("a row names an object of an unknown kind".into()))
}

/// The migrations of a database, oldest first: a number, a name and the statements of each. A database remembers the digests of those that
/// it has had, so what stands here never changes.
pub type Migrations = [(i64, &'static str, &'static str)];

/// Tables of another crate, whose rows refer to cases, objects and jobs of the store. A database that has them is opened with them only:
/// whoever does not ask them removes their objects.
#[async_trait]
pub trait Tables: fmt::Debug + Send + Sync {
    /// Those of SQLite and those of PostgreSQL. Their numbers follow those of the store.
    fn migrations(&self) -> [&'static Migrations; 2] {
        [&[], &[]]
    }

    /// Whether a row refers to an object, which then stays.
    async fn needs(&self, _: &mut Connection, _object: &ObjectName) -> Result<bool, StoreError> {
        Ok(false)
    }

    /// The next objects of a kind to which rows refer, by digest.
    async fn objects(
        &self,
        _: &mut Connection,
        _kind: ObjectKind,
        _after: Option<&ObjectName>,
        _limit: usize,
    ) -> Result<Vec<ObjectName>, StoreError> {
        Ok(Vec::new())
    }

    /// Prepares for the deletion of a case: abandons the objects of the rows that go with it.
    async fn leave_case(
        &self,
        _: &mut Connection,
        _: &CaseId,
        _now: i64,
    ) -> Result<(), StoreError> {
        Ok(())
    }

    /// The image that was sent last under a UID.
    async fn last_sent(
        &self,
        _: &mut Connection,
        _: &Uid,
    ) -> Result<Option<Fingerprint>, StoreError> {
        Ok(None)
    }

    /// Writes whether something is closed, by the images that it was made of.
    async fn judge(&self, _: &mut Connection, _: &Made) -> Result<(), StoreError> {
        Ok(())
    }

    /// Why a job with this key must not be done any more, which is asked when it is claimed.
    async fn refusal(
        &self,
        _: &mut Connection,
        _: JobKind,
        _key: &str,
    ) -> Result<Option<Failure>, StoreError> {
        Ok(None)
    }

    /// Notes that a job with this key has failed for good.
    async fn job_failed(
        &self,
        _: &mut Connection,
        _: JobKind,
        _key: &str,
        _: &Failure,
    ) -> Result<(), StoreError> {
        Ok(())
    }

    /// The kind of the jobs that stay after their end until their row here goes.
    fn kept_jobs(&self) -> Option<JobKind> {
        None
    }
}

/// No tables.
impl Tables for () {}

/// Connections to a database.
#[derive(Debug, Clone)]
pub(crate) enum Database {
    Sqlite(sqlite::Connections),
    Postgres(postgres::Connections),
}

/// A connection, in a transaction or in none. Dropping it rolls back.
pub struct Connection {
    way: Way,
    tables: Arc<dyn Tables>,
    /// How far the clock of tests is ahead, in microseconds.
    ahead: i64,
}

/// How a connection goes.
pub(super) enum Way {
    Sqlite(PoolConnection<Sqlite>),
    SqliteTransaction(Transaction<'static, Sqlite>, Arc<sqlite::Log>),
    Postgres(PoolConnection<Postgres>),
    PostgresTransaction(Transaction<'static, Postgres>),
}

impl Database {
    /// A connection on which each statement is a transaction.
    pub(super) fn connect(&self) -> BoxFuture<'_, Result<Way, StoreError>> {
        async move {
            Ok(match self {
                Self::Sqlite(connections) => Way::Sqlite(connections.pool().acquire().await?),
                Self::Postgres(connections) => Way::Postgres(connections.acquire().await?),
            })
        }
        .boxed()
    }

    /// Finishes all work before the process ends, and ends all connections.
    pub(crate) async fn close(&self) {
        match self {
            Self::Sqlite(connections) => connections.close().await,
            Self::Postgres(connections) => connections.close().await,
        }
    }

    /// A writing transaction. There is one at a time in all processes, so what it reads stays true until it ends.
    pub(super) fn begin(&self) -> BoxFuture<'_, Result<Way, StoreError>> {
        async move {
            Ok(match self {
                Self::Sqlite(connections) => {
                    let (transaction, log) = connections.begin().await?;
                    Way::SqliteTransaction(transaction, log)
                }
                Self::Postgres(connections) => Way::PostgresTransaction(connections.begin().await?),
            })
        }
        .boxed()
    }

    /// Whether it can be written. Changes nothing.
    pub(crate) async fn check(&self) -> Result<(), StoreError> {
        match self {
            Self::Sqlite(connections) => connections.check().await,
            Self::Postgres(connections) => connections.check().await,
        }
    }

    /// Checks that the structure of SQLite's file is whole, which takes as long as reading it; PostgreSQL answers for itself.
    pub(crate) async fn check_file(&self) -> Result<(), StoreError> {
        match self {
            Self::Sqlite(connections) => sqlite::check_file(connections.pool()).await,
            Self::Postgres(_) => Ok(()),
        }
    }

    /// Removes what was deleted from SQLite's log.
    pub(super) async fn empty_log(&self) {
        if let Self::Sqlite(connections) = self {
            sqlite::empty_log(connections.pool()).await;
        }
    }

    /// The changes of all processes from now on, as they are committed; `None` if the database cannot report them. Some
    /// may be missed, so a process that waits for one must also poll.
    pub(crate) async fn changes(&self) -> Result<Option<BoxStream<'static, Change>>, StoreError> {
        match self {
            Self::Sqlite(_) => Ok(None),
            Self::Postgres(connections) => connections.changes().await.map(Some),
        }
    }
}

impl Connection {
    pub(super) fn new(way: Way, tables: Arc<dyn Tables>, ahead: i64) -> Self {
        Self { way, tables, ahead }
    }

    /// The tables of another crate.
    pub(super) fn tables(&self) -> Arc<dyn Tables> {
        Arc::clone(&self.tables)
    }

    fn channel(&mut self) -> Channel<'_> {
        match &mut self.way {
            Way::Sqlite(connection) => Channel::Sqlite(connection),
            Way::SqliteTransaction(transaction, _) => Channel::Sqlite(transaction),
            Way::Postgres(connection) => Channel::Postgres(connection),
            Way::PostgresTransaction(transaction) => Channel::Postgres(transaction),
        }
    }

    /// Runs a statement with the values of its parameters, such as `("… WHERE id = $1", args![id])`, and returns the number of changed rows.
    pub fn execute(
        &mut self,
        sql: &'static str,
        args: Vec<Value>,
    ) -> BoxFuture<'_, Result<u64, StoreError>> {
        async move {
            Ok(match self.channel() {
                Channel::Sqlite(to) => bound(sql, args).execute(to).await?.rows_affected(),
                Channel::Postgres(to) => bound(sql, args).execute(to).await?.rows_affected(),
            })
        }
        .boxed()
    }

    /// The rows of a statement.
    pub fn fetch_all(
        &mut self,
        sql: &'static str,
        args: Vec<Value>,
    ) -> BoxFuture<'_, Result<Vec<Row>, StoreError>> {
        async move {
            Ok(match self.channel() {
                Channel::Sqlite(to) => {
                    let rows = bound(sql, args).fetch_all(to).await?;
                    rows.into_iter().map(Row::Sqlite).collect()
                }
                Channel::Postgres(to) => {
                    let rows = bound(sql, args).fetch_all(to).await?;
                    rows.into_iter().map(Row::Postgres).collect()
                }
            })
        }
        .boxed()
    }

    /// The first row of a statement, if there is any.
    pub fn fetch_optional(
        &mut self,
        sql: &'static str,
        args: Vec<Value>,
    ) -> BoxFuture<'_, Result<Option<Row>, StoreError>> {
        async move {
            Ok(match self.channel() {
                Channel::Sqlite(to) => bound(sql, args).fetch_optional(to).await?.map(Row::Sqlite),
                Channel::Postgres(to) => bound(sql, args)
                    .fetch_optional(to)
                    .await?
                    .map(Row::Postgres),
            })
        }
        .boxed()
    }

    /// The first row of a statement.
    pub async fn fetch_one(
        &mut self,
        sql: &'static str,
        args: Vec<Value>,
    ) -> Result<Row, StoreError> {
        let row = self.fetch_optional(sql, args).await?;
        row.ok_or_else(|| sqlx::Error::RowNotFound.into())
    }

    /// Whether there is a case with this id.
    pub async fn has_case(&mut self, id: &str) -> Result<bool, StoreError> {
        let sql = "SELECT EXISTS (SELECT 1 FROM cases WHERE id = $1) AS found";
        self.fetch_one(sql, args![id]).await?.get("found")
    }

    /// Microseconds since 1970 by the database's clock.
    pub async fn now(&mut self) -> Result<i64, StoreError> {
        let sql = match &self.way {
            Way::Sqlite(_) | Way::SqliteTransaction(..) => sqlite::NOW,
            Way::Postgres(_) | Way::PostgresTransaction(_) => postgres::NOW,
        };
        let now: i64 = self.fetch_one(sql, args![]).await?.get("now")?;
        Ok(now + self.ahead)
    }

    /// Commits a transaction whose loss in a power cut costs only work that is done again, without waiting for PostgreSQL's disk while other writers
    /// wait. It is durable within a second, and before anything that is committed after it.
    pub(super) async fn commit_soon(mut self) -> Result<(), StoreError> {
        if let Way::PostgresTransaction(_) = self.way {
            let sql = "SET LOCAL synchronous_commit = off";
            self.execute(sql, args![]).await?;
        }
        self.commit().await
    }

    /// Commits the transaction. If that fails, nothing of it happens later either, as far as the database knows.
    pub fn commit(self) -> BoxFuture<'static, Result<(), StoreError>> {
        async move {
            match self.way {
                Way::SqliteTransaction(transaction, log) => log.commit(transaction).await?,
                Way::PostgresTransaction(transaction) => transaction.commit().await?,
                Way::Sqlite(_) | Way::Postgres(_) => {}
            }
            Ok(())
        }
        .boxed()
    }
}

/// The value of a parameter.
#[derive(Debug)]
pub enum Value {
    Text(Option<String>),
    Integer(Option<i64>),
    Real(f64),
    Truth(Option<bool>),
}

/// Values of parameters, in their order.
#[macro_export]
macro_rules! args {
    ($($value:expr),* $(,)?) => { vec![$($value.into()),*] };
}

/// Writes how values of these types become parameters.
macro_rules! values {
    ($($type:ty: $value:ident => $made:expr),+ $(,)?) => {$(
        impl From<$type> for Value {
            fn from($value: $type) -> Self {
                $made
            }
        }
    )+};
}

values! {
    String: text => Self::Text(Some(text)),
    &String: text => Self::Text(Some(text.clone())),
    &str: text => Self::Text(Some(text.to_owned())),
    Option<String>: text => Self::Text(text),
    &Option<String>: text => Self::Text(text.clone()),
    Option<&str>: text => Self::Text(text.map(str::to_owned)),
    i64: number => Self::Integer(Some(number)),
    Option<i64>: number => Self::Integer(number),
    f64: number => Self::Real(number),
    bool: is => Self::Truth(Some(is)),
    Option<bool>: is => Self::Truth(is),
}

/// A statement with its values.
fn bound<D: sqlx::Database>(
    sql: &'static str,
    args: Vec<Value>,
) -> sqlx::query::Query<'static, D, D::Arguments>
where
    Option<String>: Encode<'static, D> + Type<D>,
    Option<i64>: Encode<'static, D> + Type<D>,
    f64: Encode<'static, D> + Type<D>,
    Option<bool>: Encode<'static, D> + Type<D>,
{
    let query = sqlx::query(sql);
    args.into_iter().fold(query, |query, value| match value {
        Value::Text(text) => query.bind(text),
        Value::Integer(number) => query.bind(number),
        Value::Real(number) => query.bind(number),
        Value::Truth(is) => query.bind(is),
    })
}

/// What runs a statement.
enum Channel<'c> {
    Sqlite(&'c mut SqliteConnection),
    Postgres(&'c mut PgConnection),
}

/// A row of either database.
pub enum Row {
    Sqlite(SqliteRow),
    Postgres(PgRow),
}

impl Row {
    /// The value of a column.
    pub fn get<T: Column>(&self, column: &str) -> Result<T, StoreError> {
        Ok(match self {
            Self::Sqlite(row) => row.try_get(column)?,
            Self::Postgres(row) => row.try_get(column)?,
        })
    }
}

/// What can be read from a column in both databases.
pub trait Column:
    for<'r> Decode<'r, Sqlite> + Type<Sqlite> + for<'r> Decode<'r, Postgres> + Type<Postgres>
{
}

impl<T> Column for T where
    T: for<'r> Decode<'r, Sqlite> + Type<Sqlite> + for<'r> Decode<'r, Postgres> + Type<Postgres>
{
}
