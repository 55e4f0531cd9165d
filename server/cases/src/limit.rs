//! The limit on work for clients: how much runs at a time and how much waits.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use render::Wanted;
use tokio::task;

use crate::error::Error;
use crate::fair::{FairLimit, FairPlace, FairTurn, this_client};
use crate::priority::yield_to_answers;

/// Admits a bounded number of pieces of work at a time and lets a bounded number wait. Clients ([`for_client`](crate::for_client))
/// take turns; the requests of one have theirs in the order in which they came. If nothing more may wait, the client with the most
/// requests loses its last to one with fewer. Cheap to clone.
///
/// Dropping a future leaves the queue at once.
#[derive(Debug, Clone)]
pub struct ConcurrencyLimit {
    fair: FairLimit,
    at_a_time: usize,
    recent: Arc<Recent>,
}

/// How long recent turns took, on average.
#[derive(Debug, Default)]
struct Recent {
    microseconds: AtomicU64,
}

impl Recent {
    /// Weighs the latest turn with an eighth. Two at once may count as one.
    fn count(&self, took: Duration) {
        let now = u64::try_from(took.as_micros()).unwrap_or(u64::MAX);
        let before = self.microseconds.load(Ordering::Relaxed);
        let mean = match before {
            0 => now,
            before => before - before / 8 + now / 8,
        };
        self.microseconds.store(mean, Ordering::Relaxed);
    }

    fn mean(&self) -> Duration {
        Duration::from_micros(self.microseconds.load(Ordering::Relaxed))
    }
}

/// A place in the queue, for work with one or several turns. Between them, others get their turns.
#[derive(Debug)]
pub struct Queued {
    limit: ConcurrencyLimit,
    place: Arc<FairPlace>,
}

/// A turn: the right to keep one CPU busy. It lasts as long as any of its clones, and as its work.
#[derive(Debug, Clone)]
pub struct Turn {
    _running: Arc<Running>,
    _place: Arc<FairPlace>,
}

#[derive(Debug)]
struct Running {
    _turn: FairTurn,
    since: Instant,
    recent: Arc<Recent>,
}

impl Drop for Running {
    fn drop(&mut self) {
        self.recent.count(self.since.elapsed());
    }
}

impl ConcurrencyLimit {
    /// `running` at a time, and `waiting` more.
    pub fn new(running: usize, waiting: usize) -> Self {
        Self {
            fair: FairLimit::new(running, running.saturating_add(waiting)),
            at_a_time: running,
            recent: Arc::default(),
        }
    }

    /// Joins the queue.
    ///
    /// # Errors
    /// [`Error::BusyFor`] about as long as all who are inside will take, if it is full.
    pub fn enter(&self) -> Result<Queued, Error> {
        let place = self.fair.enter(this_client());
        Ok(Queued {
            place: Arc::new(place.ok_or_else(|| Error::BusyFor(self.wait()))?),
            limit: self.clone(),
        })
    }

    /// How long those who are inside will take.
    fn wait(&self) -> Duration {
        let (places, _) = self.fair.taken();
        let rounds = places.div_ceil(self.at_a_time.max(1));
        let rounds = u32::try_from(rounds).unwrap_or(u32::MAX);
        self.recent.mean().saturating_mul(rounds)
    }

    /// Joins the queue and waits for a turn.
    ///
    /// # Errors
    /// [`Error::BusyFor`] if the queue is full.
    pub async fn turn(&self) -> Result<Turn, Error> {
        self.enter()?.turn().await
    }

    /// Waits for a turn and runs `work` on a thread of its own.
    ///
    /// # Errors
    /// [`Error::BusyFor`] if the queue is full; otherwise as [`Turn::run`].
    pub async fn run<T: Send + 'static>(
        &self,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, Error> {
        self.turn().await?.run(work).await
    }

    /// The number of waiting turns.
    pub fn waiting(&self) -> usize {
        let (places, turns) = self.fair.taken();
        places.saturating_sub(turns)
    }
}

impl Queued {
    /// Waits for the next turn.
    ///
    /// # Errors
    /// [`Error::BusyFor`] if the place was lost to a client with fewer; never after the first turn.
    pub async fn turn(&self) -> Result<Turn, Error> {
        let turn = self.place.turn().await;
        let turn = turn.ok_or_else(|| Error::BusyFor(self.limit.wait()))?;
        Ok(Turn {
            _running: Arc::new(Running {
                _turn: turn,
                since: Instant::now(),
                recent: Arc::clone(&self.limit.recent),
            }),
            _place: Arc::clone(&self.place),
        })
    }
}

impl Turn {
    /// Runs `work` on a thread that it may keep busy.
    ///
    /// # Errors
    /// [`Error::Internal`] if it panics, [`Error::Unavailable`] if the process is stopping.
    pub async fn run<T: Send + 'static>(
        &self,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, Error> {
        self.run_while(|_| work()).await
    }

    /// Runs `work`, which checks regularly whether it is still wanted; it is not after the future is dropped. The turn
    /// lasts until `work` ends.
    ///
    /// # Errors
    /// As [`Turn::run`].
    pub async fn run_while<T: Send + 'static>(
        &self,
        work: impl FnOnce(&Wanted<'_>) -> T + Send + 'static,
    ) -> Result<T, Error> {
        let client = Arc::new(());
        let (left, turn) = (Arc::downgrade(&client), self.clone());
        let done = task::spawn_blocking(move || {
            let _until_done = turn;
            yield_to_answers();
            work(&|| left.strong_count() > 0)
        })
        .await;
        drop(client);
        done.map_err(|error| match error.is_panic() {
            true => Error::Internal,
            false => Error::Unavailable,
        })
    }
}

#[cfg(test)]
mod tests {
    use std::future::{pending, ready};
    use std::sync::atomic::AtomicUsize;
    use std::sync::mpsc;
    use std::thread;

    use futures_util::poll;
    use tokio::sync::oneshot;

    use super::*;
    use crate::fair::for_client;
    use crate::places::Client;

    /// Work in a turn of a limit.
    async fn pass<T>(limit: &ConcurrencyLimit, work: impl Future<Output = T>) -> Result<T, Error> {
        let _turn = limit.turn().await?;
        Ok(work.await)
    }

    #[tokio::test]
    async fn one_runs_one_waits_and_the_next_is_refused() {
        let limit = ConcurrencyLimit::new(1, 1);
        let mut running = Box::pin(pass(&limit, pending::<()>()));
        let mut waiting = Box::pin(pass(&limit, ready(2)));
        assert!(poll!(&mut running).is_pending());
        assert!(poll!(&mut waiting).is_pending());
        assert_eq!(limit.waiting(), 1);
        assert!(matches!(limit.run(|| 3).await, Err(Error::BusyFor(_))));
        drop(running);
        assert_eq!(waiting.await.unwrap(), 2);
        assert_eq!(limit.waiting(), 0);
    }

    #[tokio::test]
    async fn one_client_with_many_pictures_delays_its_own() {
        let limit = ConcurrencyLimit::new(1, 8);
        let [greedy, other] = [1, 2].map(|number| Client::at([10, 0, 0, number].into()));
        let first = for_client(greedy, limit.turn()).await.unwrap();
        let mut second = Box::pin(for_client(greedy, limit.turn()));
        let mut late = Box::pin(for_client(other, limit.turn()));
        assert!(poll!(&mut second).is_pending());
        assert!(poll!(&mut late).is_pending());
        drop(first);
        assert!(poll!(&mut second).is_pending());
        drop(late.await.unwrap());
        second.await.unwrap();
    }

    #[tokio::test]
    async fn who_is_refused_learns_how_long_the_others_will_take() {
        let limit = ConcurrencyLimit::new(2, 4);
        limit.recent.count(Duration::from_secs(3));
        let _inside: Vec<_> = (0..6).map(|_| limit.enter().unwrap()).collect();
        match limit.enter() {
            Err(Error::BusyFor(wait)) => assert_eq!(wait, Duration::from_secs(9)),
            other => panic!("{other:?}"),
        }
        limit.recent.count(Duration::from_secs(11));
        assert_eq!(limit.recent.mean(), Duration::from_secs(4));
    }

    #[tokio::test]
    async fn who_leaves_makes_room_and_is_never_run() {
        let limit = ConcurrencyLimit::new(1, 1);
        let turn = limit.turn().await.unwrap();
        let runs = Arc::new(AtomicUsize::new(0));
        let count = || {
            let runs = Arc::clone(&runs);
            move || runs.fetch_add(1, Ordering::SeqCst)
        };
        let mut gone = Box::pin(limit.run(count()));
        assert!(poll!(&mut gone).is_pending());
        drop(gone);
        let mut kept = Box::pin(limit.run(count()));
        assert!(poll!(&mut kept).is_pending());
        drop(turn);
        kept.await.unwrap();
        assert_eq!(runs.load(Ordering::SeqCst), 1);
    }

    #[tokio::test]
    async fn a_place_outlasts_its_turns_and_lets_others_between_them() {
        let limit = ConcurrencyLimit::new(1, 1);
        let many = limit.enter().unwrap();
        let first = many.turn().await.unwrap();
        let mut other = Box::pin(limit.turn());
        assert!(poll!(&mut other).is_pending());
        drop(first);
        let mut second = Box::pin(many.turn());
        assert!(poll!(&mut second).is_pending(), "the other came first");
        drop(other.await.unwrap());
        second.await.unwrap();
        assert_eq!(limit.waiting(), 1, "the place is still held");
    }

    #[tokio::test]
    async fn a_turn_lasts_as_long_as_work_whose_client_went_away() {
        let limit = ConcurrencyLimit::new(1, 1);
        let (release, held) = mpsc::channel::<()>();
        let (begun, has_begun) = oneshot::channel();
        let gone = tokio::spawn({
            let limit = limit.clone();
            async move {
                let work = move || {
                    begun.send(()).unwrap();
                    held.recv().unwrap_err();
                };
                limit.run(work).await
            }
        });
        has_begun.await.unwrap();
        gone.abort();
        assert!(gone.await.unwrap_err().is_cancelled());
        let mut next = Box::pin(limit.run(|| 1));
        assert!(poll!(&mut next).is_pending(), "a thread is still busy");
        drop(release);
        assert_eq!(next.await.unwrap(), 1);
    }

    #[tokio::test]
    async fn work_learns_that_its_client_went_away() {
        let limit = ConcurrencyLimit::new(1, 8);
        let (begun, has_begun) = oneshot::channel();
        let (left, learned) = oneshot::channel();
        let gone = tokio::spawn({
            let limit = limit.clone();
            async move {
                let work = move |is_wanted: &Wanted<'_>| {
                    begun.send(is_wanted()).unwrap();
                    while is_wanted() {
                        thread::yield_now();
                    }
                    left.send(()).unwrap();
                };
                limit.turn().await?.run_while(work).await
            }
        });
        assert!(has_begun.await.unwrap());
        gone.abort();
        learned.await.unwrap();
    }

    #[tokio::test]
    async fn a_panic_is_an_error_and_gives_its_turn_back() {
        let limit = ConcurrencyLimit::new(1, 8);
        let panicked = limit.run(|| panic!("on purpose")).await;
        assert!(matches!(panicked, Err(Error::Internal)));
        assert_eq!(limit.run(|| 6 * 7).await.unwrap(), 42);
    }
}
