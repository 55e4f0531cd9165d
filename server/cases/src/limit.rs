//! The limit on work for clients: how much runs at a time and how much waits.

use std::collections::{HashMap, VecDeque};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use render::Wanted;
use tokio::sync::oneshot;
use tokio::task;
use worker::yield_to_answers;

use case::Client;

use crate::client::this_client;
use crate::error::Error;

/// Admits a bounded number of pieces of work at a time and lets a bounded number wait. Of both, one client
/// ([`for_client`](crate::for_client)) has at most half, but at least one. Clients take turns: a free turn goes to the client with the
/// fewest, then to the one whose last turn began first, and of its requests to the one that has waited longest. Cheap to clone.
///
/// Dropping a future leaves the queue at once.
#[derive(Debug, Clone)]
pub struct ConcurrencyLimit(Arc<Shared>);

#[derive(Debug)]
struct Shared {
    at_a_time: usize,
    /// Those that run and those that wait.
    places: usize,
    /// Held only briefly.
    queue: Mutex<Queue>,
    recent: Recent,
}

#[derive(Debug, Default)]
struct Queue {
    /// What each client has that has anything.
    clients: HashMap<Client, Share>,
    /// The number of turns that ever began.
    begun: u64,
    waiting: VecDeque<Waiting>,
}

#[derive(Debug, Default)]
struct Share {
    places: usize,
    turns: usize,
    /// When the last turn began, in turns.
    last: u64,
}

#[derive(Debug)]
struct Waiting {
    client: Client,
    turn: oneshot::Sender<Running>,
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
pub struct Queued(Arc<Place>);

#[derive(Debug)]
struct Place {
    client: Client,
    limit: Arc<Shared>,
}

/// A turn: the right to keep one CPU busy. It lasts as long as any of its clones, and as its work.
#[derive(Debug, Clone)]
pub struct Turn {
    _running: Arc<Running>,
    _place: Arc<Place>,
}

#[derive(Debug)]
struct Running {
    client: Client,
    limit: Arc<Shared>,
    since: Instant,
}

/// What one client may have of what there is.
fn most_of_one(client: Client, all: usize) -> usize {
    match client {
        Client::Program => all,
        Client::Address(_) | Client::Named(_) => (all / 2).max(1),
    }
}

impl ConcurrencyLimit {
    /// `running` at a time, and `waiting` more.
    pub fn new(running: usize, waiting: usize) -> Self {
        Self(Arc::new(Shared {
            at_a_time: running,
            places: running.saturating_add(waiting),
            queue: Mutex::default(),
            recent: Recent::default(),
        }))
    }

    /// Joins the queue.
    ///
    /// # Errors
    /// [`Error::BusyFor`] about as long as all who are inside will take, if it is full, or has as many of this client as it may.
    pub fn enter(&self) -> Result<Queued, Error> {
        let client = this_client();
        let mut queue = self.0.lock();
        let own = queue.clients.get(&client).map_or(0, |share| share.places);
        let all = queue.places();
        if all >= self.0.places || own >= most_of_one(client, self.0.places) {
            let rounds = all.div_ceil(self.0.at_a_time.max(1));
            let rounds = u32::try_from(rounds).unwrap_or(u32::MAX);
            let wait = self.0.recent.mean().saturating_mul(rounds);
            return Err(Error::BusyFor(wait));
        }
        queue.clients.entry(client).or_default().places += 1;
        let limit = Arc::clone(&self.0);
        Ok(Queued(Arc::new(Place { client, limit })))
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
        let queue = self.0.lock();
        queue.places().saturating_sub(queue.turns())
    }
}

impl Queued {
    /// Waits for the next turn.
    ///
    /// # Errors
    /// [`Error::Internal`] if the queue is gone, which the place keeps.
    pub async fn turn(&self) -> Result<Turn, Error> {
        let Place { client, limit } = &*self.0;
        let (sender, turn) = oneshot::channel();
        let waiting = Waiting {
            client: *client,
            turn: sender,
        };
        limit.lock().waiting.push_back(waiting);
        limit.start_next();
        Ok(Turn {
            _running: Arc::new(turn.await.map_err(|_gone| Error::Internal)?),
            _place: Arc::clone(&self.0),
        })
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Queue> {
        // Each change is complete, even if a holder panicked.
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Begins turns as long as some are free for somebody who waits.
    fn start_next(self: &Arc<Self>) {
        loop {
            // Not in the condition: whoever does not wait any more gives the turn back, for which the queue must be free.
            let next = self.lock().take_next(self.at_a_time);
            let Some(Waiting { client, turn }) = next else {
                return;
            };
            drop(turn.send(Running {
                client,
                limit: Arc::clone(self),
                since: Instant::now(),
            }));
        }
    }
}

impl Queue {
    fn places(&self) -> usize {
        self.clients.values().map(|share| share.places).sum()
    }

    fn turns(&self) -> usize {
        self.clients.values().map(|share| share.turns).sum()
    }

    /// Counts the turn of the next who waits and may have one.
    fn take_next(&mut self, at_a_time: usize) -> Option<Waiting> {
        self.waiting.retain(|waiting| !waiting.turn.is_closed());
        if self.turns() >= at_a_time {
            return None;
        }
        let had = |waiting: &Waiting| {
            let share = self.clients.get(&waiting.client);
            share.map_or((0, 0), |share| (share.turns, share.last))
        };
        let waiting = self.waiting.iter().enumerate();
        let may_run =
            waiting.filter(|(_, waiting)| had(waiting).0 < most_of_one(waiting.client, at_a_time));
        let (number, _) = may_run.min_by_key(|(_, waiting)| had(waiting))?;
        let next = self.waiting.remove(number)?;
        self.begun += 1;
        let share = self.clients.entry(next.client).or_default();
        share.turns += 1;
        share.last = self.begun;
        Some(next)
    }

    /// Changes what a client has, and forgets it if that is nothing.
    fn change(&mut self, client: Client, change: impl FnOnce(&mut Share)) {
        if let Some(share) = self.clients.get_mut(&client) {
            change(share);
            if share.places + share.turns == 0 {
                self.clients.remove(&client);
            }
        }
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut queue = self.limit.lock();
        queue.change(self.client, |share| share.places -= 1);
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.limit.recent.count(self.since.elapsed());
        let mut queue = self.limit.lock();
        queue.change(self.client, |share| share.turns -= 1);
        drop(queue);
        self.limit.start_next();
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
    use crate::client::for_client;

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

    fn client(number: u8) -> Client {
        Client::at([10, 0, 0, number].into())
    }

    /// A turn of a client, which may wait.
    fn turn_of(limit: &ConcurrencyLimit, client: Client) -> impl Future<Output = Turn> {
        let turn = for_client(client, limit.turn());
        Box::pin(async { turn.await.expect("there is a place") })
    }

    #[tokio::test]
    async fn one_client_has_half_of_the_turns_and_another_begins_at_once() {
        let limit = ConcurrencyLimit::new(4, 16);
        let [greedy, other] = [Client::named("greedy"), client(2)];
        let first = turn_of(&limit, greedy).await;
        let _second = turn_of(&limit, greedy).await;
        let mut third = turn_of(&limit, greedy);
        assert!(poll!(&mut third).is_pending(), "two of four are free");
        let _late = turn_of(&limit, other).await;
        let _later = turn_of(&limit, other).await;
        drop(first);
        third.await;
    }

    #[tokio::test]
    async fn one_client_has_half_of_the_places() {
        let limit = ConcurrencyLimit::new(2, 6);
        let enter = |client| for_client(client, async { limit.enter() });
        let mut held = Vec::new();
        for _ in 0..4 {
            held.push(enter(client(1)).await.unwrap());
        }
        assert!(matches!(enter(client(1)).await, Err(Error::BusyFor(_))));
        for _ in 0..4 {
            held.push(enter(client(2)).await.unwrap());
        }
        assert!(matches!(enter(client(3)).await, Err(Error::BusyFor(_))));
        drop(held);
        assert!(limit.0.lock().clients.is_empty());
    }

    #[tokio::test]
    async fn with_one_turn_at_a_time_clients_alternate() {
        let limit = ConcurrencyLimit::new(1, 8);
        let [greedy, other] = [1, 2].map(client);
        let held = turn_of(&limit, greedy).await;
        let mut second = turn_of(&limit, greedy);
        let mut late = turn_of(&limit, other);
        assert!(poll!(&mut second).is_pending());
        assert!(poll!(&mut late).is_pending());
        drop(held);
        assert!(poll!(&mut second).is_pending(), "the greedy one had a turn");
        drop(late.await);
        drop(second.await);
        assert!(limit.0.lock().clients.is_empty());
    }

    #[tokio::test]
    async fn those_with_as_many_turns_come_in_their_order() {
        let limit = ConcurrencyLimit::new(1, 8);
        let held = turn_of(&limit, client(1)).await;
        let mut waiting: Vec<_> = (2..6)
            .map(|number| turn_of(&limit, client(number)))
            .collect();
        for turn in &mut waiting {
            assert!(poll!(turn).is_pending());
        }
        drop(held);
        for mut turn in waiting {
            let std::task::Poll::Ready(turn) = poll!(&mut turn) else {
                panic!("another one came first");
            };
            drop(turn);
        }
    }

    #[tokio::test]
    async fn who_is_refused_learns_how_long_the_others_will_take() {
        let limit = ConcurrencyLimit::new(2, 4);
        limit.0.recent.count(Duration::from_secs(3));
        let _inside: Vec<_> = (0..6).map(|_| limit.enter().unwrap()).collect();
        match limit.enter() {
            Err(Error::BusyFor(wait)) => assert_eq!(wait, Duration::from_secs(9)),
            other => panic!("{other:?}"),
        }
        limit.0.recent.count(Duration::from_secs(11));
        assert_eq!(limit.0.recent.mean(), Duration::from_secs(4));
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
