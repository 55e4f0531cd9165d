//! Whether the store answers, within a time that those who ask can wait.

use std::time::Duration;

use storage::{Store, StoreError};

use crate::error::Error;

/// How long the store may take to answer: probes usually wait for a second or two.
const READY_WITHIN: Duration = Duration::from_secs(3);

/// Checks that the store can be used and has room.
///
/// # Errors
/// [`Error::Unavailable`] if it does not answer in time, [`Error::Mismatch`], [`Error::StorageFull`] or [`Error::StorageFailed`].
pub async fn check_ready(store: &Store) -> Result<(), Error> {
    within(READY_WITHIN, store.check()).await
}

/// Checks that the objects answer and are those of the rows, before a body is received that could not be stored.
///
/// # Errors
/// [`Error::Unavailable`] if they do not, [`Error::Mismatch`].
pub async fn check_before_upload(store: &Store) -> Result<(), Error> {
    within(READY_WITHIN, store.id()).await.map(drop)
}

async fn within<T>(
    limit: Duration,
    check: impl Future<Output = Result<T, StoreError>>,
) -> Result<T, Error> {
    let checked = tokio::time::timeout(limit, check).await;
    let checked = checked.map_err(|_elapsed| {
        tracing::warn!("the store does not answer in time");
        Error::Unavailable
    })?;
    checked.map_err(|error| {
        tracing::warn!(%error, cause = error.cause(), "the store is not ready");
        match Error::from(error) {
            known @ (Error::StorageFull | Error::StorageFailed(_) | Error::Mismatch(_)) => known,
            _ => Error::Unavailable,
        }
    })
}

#[cfg(test)]
mod tests {
    use std::future::{pending, ready};
    use std::io::ErrorKind;

    use super::*;

    #[tokio::test]
    async fn a_store_that_does_not_answer_is_unavailable_and_a_full_one_is_full() {
        let hung = within::<()>(Duration::ZERO, pending()).await;
        assert!(matches!(hung, Err(Error::Unavailable)), "{hung:?}");
        assert!(within(READY_WITHIN, ready(Ok(()))).await.is_ok());
        let full = StoreError::Disk(ErrorKind::StorageFull.into());
        let full = within::<()>(READY_WITHIN, ready(Err(full))).await;
        assert!(matches!(full, Err(Error::StorageFull)), "{full:?}");
    }
}
