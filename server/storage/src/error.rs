//! Errors of the store.

use std::error::Error;
use std::io::ErrorKind;

use sqlx::error::DatabaseError;

/// The codes for a full disk: SQLite's (sqlite.org/rescode.html) and PostgreSQL's.
const FULL: [&str; 2] = ["13", "53100"];

/// PostgreSQL's codes for a server that is stopping or starting, has too many connections, has become a standby, or
/// made a transaction wait for too long.
const AWAY: [&str; 6] = ["57P01", "57P02", "57P03", "53300", "25006", "55P03"];

/// What `object_store` calls a bucket in its errors.
pub(super) const BUCKET: &str = "S3";

/// The reason why an operation of the store failed. The sentences may be shown to clients; the sources are for the log.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StoreError {
    /// The queue of cases is full; try again later.
    #[error("too many cases are waiting to be prepared")]
    QueueFull,
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
    /// The rows cannot be read or written.
    #[error("the database of the store failed")]
    Rows(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// The database's file is damaged.
    #[error("the database of the store is damaged ({0}); restore `rows.sqlite` from a backup")]
    DamagedFile(String),
    /// The facts of a case differ from what was written.
    #[error("the facts of a case are damaged")]
    DamagedFacts(case::CaseId),
    /// The objects cannot be read or written.
    #[error("the object store failed")]
    Objects(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// The disk failed.
    #[error("the disk of the store failed")]
    Disk(#[from] std::io::Error),
    /// A task of the store was stopped: the process is shutting down, or there is an internal error.
    #[error("the store stopped during the operation")]
    Stopped(#[from] tokio::task::JoinError),
}

impl StoreError {
    /// Whether the database or the object store is unreachable at the moment.
    pub fn is_away(&self) -> bool {
        let cause = match self {
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

    /// Whether the reason is a full disk or an exhausted quota.
    pub fn is_full(&self) -> bool {
        let reasons = std::iter::successors(Some(self as &dyn Error), |&error| error.source());
        reasons.into_iter().any(|error| {
            let is_full = |kind| matches!(kind, ErrorKind::StorageFull | ErrorKind::QuotaExceeded);
            let from_disk = error
                .downcast_ref::<std::io::Error>()
                .map(std::io::Error::kind);
            let from_rows = error
                .downcast_ref::<sqlx::Error>()
                .and_then(sqlx::Error::as_database_error);
            from_disk.is_some_and(is_full)
                || from_rows
                    .and_then(DatabaseError::code)
                    .is_some_and(|code| FULL.contains(&&*code))
        })
    }
}

impl From<sqlx::Error> for StoreError {
    fn from(error: sqlx::Error) -> Self {
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

impl From<object_store::Error> for StoreError {
    fn from(error: object_store::Error) -> Self {
        Self::Objects(Box::new(error))
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
        assert!(StoreError::from(object).is_full());
        assert!(!StoreError::QueueFull.is_full());
    }
}
