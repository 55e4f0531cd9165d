//! Why the store could not do what was asked.

/// Why the store could not do what was asked. The sentences are fit for clients; the sources are for the log.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StoreError {
    /// As many cases wait as may wait; try again later.
    #[error("too many cases are waiting to be prepared")]
    QueueFull,
    /// The rows cannot be read or written.
    #[error("the database of the store failed")]
    Rows(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// The objects cannot be read or written.
    #[error("the object store failed")]
    Objects(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// The disk failed.
    #[error("the disk of the store failed")]
    Disk(#[from] std::io::Error),
    /// A task of the store was stopped: the process is shutting down, or it has a fault.
    #[error("the store stopped in the middle of its work")]
    Stopped(#[from] tokio::task::JoinError),
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
