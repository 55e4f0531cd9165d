//! Errors of the store.

use std::borrow::Cow;
use std::error::Error;
use std::io::{self, ErrorKind};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use crate::label::Mismatch;
use crate::objects::{BUCKET, ObjectError};
use case::{ErrorKind as PublicKind, INTERNAL, MAX_LAYERS, PublicError, SOURCE_MISSING};
use sqlx::error::DatabaseError;

/// The codes for a full disk: SQLite's (sqlite.org/rescode.html) and PostgreSQL's.
const FULL: [&str; 2] = ["13", "53100"];

/// The codes for a disk that cannot be written: SQLite's for a file system that has become read-only, and for writing, `fsync` (also of a
/// directory), cutting and removing a file; PostgreSQL's for an error of its disk.
const UNWRITABLE: [&str; 7] = ["8", "778", "1034", "1290", "1546", "2570", "58030"];

/// PostgreSQL's codes for a server that is stopping or starting, has too many connections, has become a standby, or
/// made a transaction wait for too long.
const AWAY: [&str; 6] = ["57P01", "57P02", "57P03", "53300", "25006", "55P03"];

/// S3's code for a request that was signed at another time than it came; its message has the code.
const CLOCKS_DIFFER: &str = "RequestTimeTooSkewed";

/// The reason why an operation of the store failed. The sentences may be shown to clients; the sources are for the log.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StoreError {
    /// The queue is full, or the share of the client in it; a place will be free after about this time.
    #[error("too much work is waiting; try again in {} s", .0.as_secs_f64().ceil().max(1.0))]
    QueueFull(Duration),
    /// There is no such case.
    #[error("there is no case with this id")]
    NoSuchCase,
    /// There is no such layer.
    #[error("the case has no layer with this name; `/v1/cases/{{id}}/layers` lists its layers")]
    NoSuchLayer,
    /// A stored upload, or another stored image, that the operation needs is missing.
    #[error("a stored upload is missing; tell the administrator of this server")]
    SourceMissing,
    /// The case has as many layers as it may have.
    #[error("the case has {} layers, the limit; delete one", MAX_LAYERS)]
    TooManyLayers,
    /// Another layer of the case has the name.
    #[error("another layer of the case has this name; choose another name")]
    LayerNameTaken,
    /// The rows were written by a newer version of this program.
    #[error(
        "the store was written by a newer version of Isocortex (its schema is {found}, this version knows up to {known}): \
         open it with that version, or use another directory"
    )]
    NewerSchema {
        /// The schema of the store.
        found: i64,
        /// The newest schema that this version knows.
        known: i64,
    },
    /// The rows were written before the first release.
    #[error(
        "the store was written by a development version of Isocortex: open it with that version, or use another directory"
    )]
    DevelopmentSchema,
    /// There is no store at a location.
    #[error(
        "there is no store here: {0}. Is the folder mounted, and is the address right? `isocortex init-store`, with the same options, makes a new store"
    )]
    NoStore(&'static str),
    /// The rows belong to one store, the objects to another or to none.
    #[error("{0}")]
    Mismatch(Mismatch),
    /// The store belongs to another user of this machine, by its number.
    #[error(
        "the store belongs to the user {0}, who could not read what this program writes as another user: run it as that user \
         (`setpriv --reuid={0} --clear-groups isocortex …`)"
    )]
    OtherUser(u32),
    /// The rows cannot be read or written.
    #[error("the database of the store failed")]
    Rows(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// The database's file is damaged.
    #[error("the database of the store is damaged ({0}); restore `rows.sqlite` from a backup")]
    DamagedFile(String),
    /// The facts of a case differ from what was written.
    #[error("the facts of a case are damaged")]
    DamagedFacts(case::CaseId),
    /// The facts of a layer differ from what was written.
    #[error("the facts of a layer are damaged")]
    DamagedLayer(case::CaseId, case::LayerId),
    /// The findings of a case differ from what was written.
    #[error("the findings of a case are damaged; restore them from a backup")]
    DamagedFindings(case::CaseId),
    /// A reading of a case differs from what was written.
    #[error("a reading of a case is damaged; restore it from a backup")]
    DamagedReading(case::CaseId),
    /// The object store refuses what this machine signs, because their clocks differ.
    #[error(
        "the object store refuses the requests of this machine because their clocks differ; set the clock of this machine"
    )]
    ClocksDiffer(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// The object store does not accept the credentials of this machine, or they do not permit what was asked.
    #[error(
        "the object store denies access to this machine; check the key and the secret in the file of its credentials, and that they may read \
         and write the bucket"
    )]
    AccessDenied(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// The objects cannot be read or written.
    #[error("the object store failed")]
    Objects(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// The disk failed.
    #[error("the disk of the store cannot be read or written")]
    Disk(#[from] std::io::Error),
    /// A task of the store was stopped: the process is shutting down, or there is an internal error.
    #[error("the store stopped during the operation")]
    Stopped(#[from] tokio::task::JoinError),
}

/// Names a path in an error of the disk.
pub(crate) fn at(path: &Path) -> impl Fn(io::Error) -> io::Error {
    move |error| io::Error::new(error.kind(), format!("{}: {error}", path.display()))
}

/// What was read of a source; `None` if it is missing too, where what it is compared with does not depend on it alone.
///
/// # Errors
/// Any other error of the reading.
pub fn unless_missing<T>(read: Result<Option<T>, StoreError>) -> Result<Option<T>, StoreError> {
    match read {
        Err(StoreError::SourceMissing) => Ok(None),
        read => read,
    }
}

impl StoreError {
    /// Whether the database or the object store is unreachable at the moment.
    pub fn is_away(&self) -> bool {
        let cause = match self {
            Self::ClocksDiffer(_) => return true,
            Self::Rows(cause) | Self::Objects(cause) => cause,
            _ => return false,
        };
        let object_store = cause.downcast_ref::<object_store::Error>();
        let in_bucket = |error: &object_store::Error| matches!(error, object_store::Error::Generic { store, .. } if *store == BUCKET);
        match cause.downcast_ref::<sqlx::Error>() {
            Some(sqlx::Error::Io(_) | sqlx::Error::PoolTimedOut) => true,
            Some(sqlx::Error::Database(error)) => {
                error.code().is_some_and(|code| AWAY.contains(&&*code))
            }
            _ => object_store.is_some_and(in_bucket),
        }
    }

    /// Whether somebody must set something right before the store can be used. The sentence names no path.
    pub fn is_unusable(&self) -> bool {
        matches!(
            self,
            Self::Mismatch(_) | Self::AccessDenied(_) | Self::ClocksDiffer(_)
        )
    }

    /// Whether the reason is a full disk or an exhausted quota.
    pub fn is_full(&self) -> bool {
        self.reasons().any(|error| {
            let is_full = |kind| matches!(kind, ErrorKind::StorageFull | ErrorKind::QuotaExceeded);
            let from_disk = error
                .downcast_ref::<std::io::Error>()
                .map(std::io::Error::kind);
            from_disk.is_some_and(is_full) || has_code(error, &FULL)
        })
    }

    /// Whether the reason is a disk that has room but cannot be written. What is stored may still be readable.
    pub fn is_unwritable(&self) -> bool {
        let is_unwritable = matches!(self, Self::Disk(_))
            || self.reasons().any(|error| has_code(error, &UNWRITABLE));
        is_unwritable && !self.is_full()
    }

    /// What is behind it, such as "Connection refused"; the error itself, if it has no source. Of an answer of S3, its code. For the log: it
    /// may name addresses and files.
    pub fn cause(&self) -> String {
        let last = self.reasons().last();
        let cause = last.map_or_else(String::new, ToString::to_string);
        let code = cause.split_once("<Code>");
        let code = code.and_then(|(_, rest)| rest.split_once("</Code>"));
        code.map_or(cause.clone(), |(code, _)| code.to_owned())
    }

    /// This error and its sources.
    fn reasons(&self) -> impl Iterator<Item = &(dyn Error + 'static)> {
        std::iter::successors(Some(self as &dyn Error), |&error| error.source())
    }
}

/// What clients are told of a full store.
const FULL_STORE: &str = "the store is full; free space on its disk, or enlarge it";

/// What clients are told of a disk that has room, but cannot be written.
const FAILED_DISK: &str =
    "the disk of the server failed: cases can be viewed, but nothing can be stored; check the disk";

/// What clients are told while the store is unreachable.
pub const STORE_AWAY: &str = "the server cannot answer now; try again in a moment";

impl PublicError for StoreError {
    fn kind(&self) -> PublicKind {
        match self {
            Self::NoSuchCase | Self::NoSuchLayer => PublicKind::NotFound,
            Self::TooManyLayers | Self::LayerNameTaken => PublicKind::Conflict,
            Self::QueueFull(_) | Self::SourceMissing => PublicKind::Unavailable,
            unusable if unusable.is_unusable() => PublicKind::Unavailable,
            full if full.is_full() || full.is_unwritable() => PublicKind::Full,
            away if away.is_away() => PublicKind::Unavailable,
            _ => PublicKind::Internal,
        }
    }

    fn name(&self) -> Cow<'static, str> {
        let name = match self {
            Self::NoSuchCase => "no-such-case",
            Self::NoSuchLayer => "no-such-layer",
            Self::TooManyLayers => "too-many-layers",
            Self::LayerNameTaken => "layer-name-taken",
            Self::QueueFull(_) => "busy",
            Self::SourceMissing => SOURCE_MISSING,
            unusable if unusable.is_unusable() => "unavailable",
            full if full.is_full() => "storage-full",
            failed if failed.is_unwritable() => "storage-failed",
            away if away.is_away() => "unavailable",
            _ => "store",
        };
        name.into()
    }

    fn sentence(&self) -> String {
        match self {
            Self::NoSuchCase
            | Self::NoSuchLayer
            | Self::TooManyLayers
            | Self::LayerNameTaken
            | Self::QueueFull(_)
            | Self::SourceMissing => self.to_string(),
            unusable if unusable.is_unusable() => self.to_string(),
            full if full.is_full() => FULL_STORE.to_owned(),
            failed if failed.is_unwritable() => FAILED_DISK.to_owned(),
            away if away.is_away() => STORE_AWAY.to_owned(),
            _ => INTERNAL.to_owned(),
        }
    }

    fn retry_after(&self) -> Option<Duration> {
        match self {
            Self::QueueFull(wait) => Some(*wait),
            _ => None,
        }
    }

    fn hidden_cause(&self) -> Option<&(dyn Error + 'static)> {
        match self.name().as_ref() {
            "store" | "storage-failed" => Some(self),
            "unavailable" if !self.is_unusable() => Some(self),
            _ => None,
        }
    }
}

/// Whether the message of an error or of one of its sources has a text.
fn has_text(error: &(dyn Error + 'static), text: &str) -> bool {
    std::iter::successors(Some(error), |&error| error.source())
        .any(|error| error.to_string().contains(text))
}

/// Whether a bucket has answered with the status 401 or 403.
fn is_denied(error: &(dyn Error + 'static)) -> bool {
    let error = error.downcast_ref::<object_store::Error>();
    error.is_some_and(|error| {
        matches!(
            error,
            object_store::Error::PermissionDenied { .. }
                | object_store::Error::Unauthenticated { .. }
        )
    })
}

/// Whether a database reported one of these codes.
fn has_code(error: &(dyn Error + 'static), codes: &[&str]) -> bool {
    let from_rows = error
        .downcast_ref::<sqlx::Error>()
        .and_then(sqlx::Error::as_database_error);
    from_rows
        .and_then(DatabaseError::code)
        .is_some_and(|code| codes.contains(&&*code))
}

/// Operations that failed since the process started.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FailureCounts {
    /// Of the database.
    pub database: u64,
    /// Of the object store, or of the disk.
    pub objects: u64,
}

static DATABASE_FAILURES: AtomicU64 = AtomicU64::new(0);
static OBJECT_FAILURES: AtomicU64 = AtomicU64::new(0);

/// Operations of any store that failed since the process started, for metrics.
pub fn failures() -> FailureCounts {
    FailureCounts {
        database: DATABASE_FAILURES.load(Ordering::Relaxed),
        objects: OBJECT_FAILURES.load(Ordering::Relaxed),
    }
}

impl From<sqlx::Error> for StoreError {
    fn from(error: sqlx::Error) -> Self {
        DATABASE_FAILURES.fetch_add(1, Ordering::Relaxed);
        Self::Rows(Box::new(error))
    }
}

impl From<sqlx::migrate::MigrateError> for StoreError {
    fn from(error: sqlx::migrate::MigrateError) -> Self {
        Self::Rows(Box::new(error))
    }
}

impl From<serde_json::Error> for StoreError {
    fn from(error: serde_json::Error) -> Self {
        Self::Rows(Box::new(error))
    }
}

impl From<ObjectError> for StoreError {
    fn from(error: ObjectError) -> Self {
        OBJECT_FAILURES.fetch_add(1, Ordering::Relaxed);
        match error {
            ObjectError::Store(source) if has_text(&*source, CLOCKS_DIFFER) => {
                Self::ClocksDiffer(source)
            }
            ObjectError::Store(source) if is_denied(&*source) => Self::AccessDenied(source),
            ObjectError::Store(source) => Self::Objects(source),
            ObjectError::Disk(source) => Self::Disk(source),
            ObjectError::Stopped(source) => Self::Stopped(source),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_is_told_from_a_broken_one() {
        assert!(StoreError::from(std::io::Error::from(ErrorKind::StorageFull)).is_full());
        assert!(!StoreError::from(std::io::Error::from(ErrorKind::PermissionDenied)).is_full());
        let object = object_store::Error::Generic {
            store: "directory",
            source: Box::new(std::io::Error::from(ErrorKind::QuotaExceeded)),
        };
        assert!(StoreError::from(ObjectError::from(object)).is_full());
        assert!(!StoreError::QueueFull(Duration::ZERO).is_full());
    }

    /// An error of a database with this code.
    #[derive(Debug, thiserror::Error)]
    #[error("a message with the CANARY")]
    struct Coded(&'static str);

    impl DatabaseError for Coded {
        fn message(&self) -> &str {
            "a message with the CANARY"
        }

        fn code(&self) -> Option<std::borrow::Cow<'_, str>> {
            Some(self.0.into())
        }

        fn as_error(&self) -> &(dyn Error + Send + Sync + 'static) {
            self
        }

        fn as_error_mut(&mut self) -> &mut (dyn Error + Send + Sync + 'static) {
            self
        }

        fn into_error(self: Box<Self>) -> Box<dyn Error + Send + Sync + 'static> {
            self
        }

        fn kind(&self) -> sqlx::error::ErrorKind {
            sqlx::error::ErrorKind::Other
        }
    }

    fn of_objects(store: &'static str) -> StoreError {
        let source = "the CANARY does not answer".into();
        ObjectError::from(object_store::Error::Generic { store, source }).into()
    }

    #[test]
    fn what_passes_by_itself_is_told_from_what_does_not() {
        let coded = |code| StoreError::from(sqlx::Error::Database(Box::new(Coded(code))));
        let io = || std::io::Error::from(ErrorKind::ConnectionRefused);
        let away = [true, false, false];
        let full = [false, true, false];
        let unwritable = [false, false, true];
        let none = [false, false, false];
        for (error, expected) in [
            (sqlx::Error::PoolTimedOut.into(), away),
            (sqlx::Error::Io(io()).into(), away),
            (coded("57P01"), away),
            (coded("53300"), away),
            (of_objects(BUCKET), away),
            (coded("13"), full),
            (coded("53100"), full),
            (std::io::Error::from(ErrorKind::StorageFull).into(), full),
            (coded("778"), unwritable),
            (coded("1034"), unwritable),
            (coded("8"), unwritable),
            (coded("58030"), unwritable),
            (io().into(), unwritable),
            // SQLite could not read.
            (coded("266"), none),
            (coded("23505"), none),
            (sqlx::Error::RowNotFound.into(), none),
            (of_objects("LocalFileSystem"), none),
            (StoreError::QueueFull(Duration::ZERO), none),
        ] {
            let found = [error.is_away(), error.is_full(), error.is_unwritable()];
            assert_eq!(found, expected, "{error:?}");
        }
    }

    #[test]
    fn the_sentences_name_no_cause_and_what_can_be_done() {
        let canary = || std::io::Error::other("/home/CANARY");
        for (error, words) in [
            (
                StoreError::from(canary()),
                "the disk of the store cannot be read or written",
            ),
            (
                sqlx::Error::Io(canary()).into(),
                "the database of the store failed",
            ),
            (of_objects(BUCKET), "the object store failed"),
            (
                StoreError::QueueFull(Duration::ZERO),
                "too much work is waiting; try again in 1 s",
            ),
            (
                StoreError::NewerSchema { found: 9, known: 7 },
                "its schema is 9, this version knows up to 7",
            ),
            (
                StoreError::DamagedFile("a page is out of order".to_owned()),
                "(a page is out of order); restore `rows.sqlite` from a backup",
            ),
        ] {
            let sentence = error.to_string();
            assert!(sentence.contains(words), "{sentence}");
            assert!(!sentence.contains("CANARY"), "{sentence}");
        }
    }
}
