//! Whether the store answers, within a time that those who ask can wait.

use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use storage::{Store, StoreError};

use crate::error::Error;

/// How long the store may take to answer: probes usually wait for a second or two.
const READY_WITHIN: Duration = Duration::from_secs(3);

/// Checks that the store can be used and has room.
///
/// # Errors
/// [`Error::Unavailable`] if it does not answer in time, or [`Error::Store`] if it is unusable, full or cannot be written.
pub async fn check_ready(store: &Store) -> Result<(), Error> {
    within(READY_WITHIN, store.check()).await
}

/// Checks that the objects answer and are those of the rows, before a body is received that could not be stored.
///
/// # Errors
/// [`Error::Unavailable`] if they do not, or [`Error::Store`] if the store is unusable.
pub async fn check_before_upload(store: &Store) -> Result<(), Error> {
    within(READY_WITHIN, store.id()).await.map(drop)
}

async fn within<T>(
    limit: Duration,
    check: impl Future<Output = Result<T, StoreError>>,
) -> Result<T, Error> {
    let error = match tokio::time::timeout(limit, check).await {
        Ok(Ok(found)) => {
            is_news("");
            return Ok(found);
        }
        Ok(Err(error)) => error,
        Err(_elapsed) => {
            if is_news("no answer") {
                tracing::warn!("the store does not answer in time");
            }
            return Err(Error::Unavailable);
        }
    };
    let cause = error.cause();
    if is_news(&cause) {
        tracing::warn!(%error, cause, "the store is not ready");
    }
    Err(
        match error.is_unusable() || error.is_full() || error.is_unwritable() {
            true => Error::Store(error),
            false => Error::Unavailable,
        },
    )
}

/// Whether this is another cause than that of the check before, so that probes do not repeat it. An empty one is none.
fn is_news(cause: &str) -> bool {
    static SAID: Mutex<String> = Mutex::new(String::new());
    changes(
        &mut SAID.lock().unwrap_or_else(PoisonError::into_inner),
        cause,
    )
}

fn changes(said: &mut String, cause: &str) -> bool {
    let is_another = said != cause;
    cause.clone_into(said);
    is_another
}

#[cfg(test)]
mod tests {
    use std::future::{pending, ready};
    use std::io::ErrorKind;

    use super::*;

    #[test]
    fn a_cause_is_said_once_until_another_comes_or_the_store_answers() {
        let mut said = String::new();
        let logged = [
            "",
            "refused",
            "refused",
            "no answer",
            "refused",
            "",
            "refused",
        ]
        .map(|cause| changes(&mut said, cause));
        assert_eq!(logged, [false, true, false, true, true, true, true]);
    }

    #[tokio::test]
    async fn a_store_that_does_not_answer_is_unavailable_and_a_full_one_is_full() {
        let hung = within::<()>(Duration::ZERO, pending()).await;
        assert!(matches!(hung, Err(Error::Unavailable)), "{hung:?}");
        assert!(within(READY_WITHIN, ready(Ok(()))).await.is_ok());
        let full = StoreError::Disk(ErrorKind::StorageFull.into());
        let full = within::<()>(READY_WITHIN, ready(Err(full))).await;
        assert!(
            matches!(&full, Err(Error::Store(error)) if error.is_full()),
            "{full:?}"
        );
    }
}
