//! Errors of the objects.

/// The name of a bucket in the errors of `object_store`.
pub(crate) const BUCKET: &str = "S3";

/// The reason why an operation on objects failed. The sentences may be shown to clients; the sources are for the log.
#[derive(Debug, thiserror::Error)]
pub enum ObjectError {
    /// The object store failed.
    #[error("the object store failed")]
    Store(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// The disk failed.
    #[error("the disk of the store cannot be read or written")]
    Disk(#[from] std::io::Error),
    /// A task was stopped: the process is shutting down, or there is an internal error.
    #[error("the store stopped during the operation")]
    Stopped(#[from] tokio::task::JoinError),
}

impl From<object_store::Error> for ObjectError {
    fn from(error: object_store::Error) -> Self {
        Self::Store(Box::new(error))
    }
}
