//! A bound on work that is done elsewhere: so much at a time, so much waiting.

use tokio::sync::Semaphore;

use crate::error::Error;

/// Lets a bounded number of futures run at a time, and a bounded number wait.
#[derive(Debug)]
pub struct Turnstile {
    running: Semaphore,
    /// Those that run and those that wait.
    inside: Semaphore,
}

impl Turnstile {
    /// `running` at a time, and `waiting` more.
    pub fn new(running: usize, waiting: usize) -> Self {
        Self {
            running: Semaphore::new(running),
            inside: Semaphore::new(running.saturating_add(waiting)),
        }
    }

    /// Runs `work` when its turn comes. Dropping the future gives the turn to the next.
    ///
    /// # Errors
    /// [`Error::Busy`] when too many wait already.
    pub async fn pass<T>(&self, work: impl Future<Output = T>) -> Result<T, Error> {
        let _inside = self.inside.try_acquire().map_err(|_| Error::Busy)?;
        let _running = self.running.acquire().await.map_err(|_| Error::Busy)?;
        Ok(work.await)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn one_runs_one_waits_and_the_next_is_refused() {
        let turnstile = Turnstile::new(1, 1);
        let mut running = Box::pin(turnstile.pass(std::future::pending::<()>()));
        let mut waiting = Box::pin(turnstile.pass(std::future::ready(2)));
        assert!(futures_util::poll!(&mut running).is_pending());
        assert!(futures_util::poll!(&mut waiting).is_pending());
        assert!(matches!(turnstile.pass(async {}).await, Err(Error::Busy)));
        drop(running);
        assert_eq!(waiting.await.unwrap(), 2);
    }
}
