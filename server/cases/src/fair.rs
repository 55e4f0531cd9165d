//! A limit on concurrent work that gives each client its turn.

use std::collections::{HashMap, VecDeque};
use std::net::IpAddr;
use std::sync::{Arc, Mutex, PoisonError};

use tokio::sync::oneshot;

use crate::error::Error;

/// The client of a request; `None` for this program itself and if the address is unknown.
pub type Client = Option<IpAddr>;

tokio::task_local! {
    static CLIENT: Client;
}

/// Runs a request of a client: what it does in a [`ConcurrencyLimit`](crate::ConcurrencyLimit) takes turns with the work of others.
pub async fn for_client<F: Future>(client: Client, request: F) -> F::Output {
    CLIENT.scope(client, request).await
}

/// The client of the request that this task runs.
pub(crate) fn this_client() -> Client {
    CLIENT.try_with(|client| *client).ok().flatten()
}

/// A limit on work at a time. A free turn goes to the waiting client with the fewest turns, among those to the one whose last
/// turn began first, and among its requests to the one that has waited longest, so that a client with many requests delays its
/// own.
#[derive(Debug, Clone)]
pub(crate) struct FairLimit {
    running: usize,
    waiting: usize,
    queue: Arc<Mutex<Queue>>,
}

#[derive(Debug, Default)]
struct Queue {
    /// The number of turns of each client that has any.
    turns: HashMap<Client, usize>,
    /// When the last turn of each client that is here began, in turns.
    last: HashMap<Client, u64>,
    begun: u64,
    waiting: VecDeque<(Client, oneshot::Sender<FairTurn>)>,
}

/// The right to run, until it is dropped.
#[derive(Debug)]
pub(crate) struct FairTurn {
    client: Client,
    /// `None` once it was given back.
    limit: Option<FairLimit>,
}

impl FairLimit {
    /// `running` at a time, and `waiting` more.
    pub(crate) fn new(running: usize, waiting: usize) -> Self {
        Self {
            running,
            waiting,
            queue: Arc::default(),
        }
    }

    /// Waits for a turn of a client.
    ///
    /// # Errors
    /// [`Error::Busy`] if too many wait.
    pub(crate) async fn turn(&self, client: Client) -> Result<FairTurn, Error> {
        let turn = {
            let mut queue = self.lock();
            queue.waiting.retain(|(_, waiting)| !waiting.is_closed());
            if queue.running() < self.running {
                return Ok(self.begin(&mut queue, client));
            }
            if queue.waiting.len() >= self.waiting {
                return Err(Error::Busy);
            }
            let (sender, turn) = oneshot::channel();
            queue.waiting.push_back((client, sender));
            turn
        };
        turn.await.map_err(|_| Error::Unavailable)
    }

    fn begin(&self, queue: &mut Queue, client: Client) -> FairTurn {
        queue.begin(client);
        FairTurn {
            client,
            limit: Some(self.clone()),
        }
    }

    fn give_back(&self, client: Client) {
        let mut queue = self.lock();
        queue.end(client);
        while queue.running() < self.running {
            let Some((next, waiting)) = queue.take_next() else {
                break;
            };
            let turn = self.begin(&mut queue, next);
            if let Err(mut unwanted) = waiting.send(turn) {
                unwanted.limit = None;
                queue.end(next);
            }
        }
    }

    /// The number of turns.
    pub(crate) fn taken(&self) -> usize {
        self.lock().running()
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Queue> {
        // Each change is complete, even if a holder panicked.
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Queue {
    fn running(&self) -> usize {
        self.turns.values().sum()
    }

    fn begin(&mut self, client: Client) {
        *self.turns.entry(client).or_default() += 1;
        self.begun += 1;
        self.last.insert(client, self.begun);
    }

    fn end(&mut self, client: Client) {
        match self.turns.get_mut(&client) {
            Some(turns) if *turns > 1 => *turns -= 1,
            _ => {
                self.turns.remove(&client);
                if self.waiting.iter().all(|(waiting, _)| *waiting != client) {
                    self.last.remove(&client);
                }
            }
        }
    }

    fn take_next(&mut self) -> Option<(Client, oneshot::Sender<FairTurn>)> {
        let had = |client: &Client| {
            let turns = self.turns.get(client).copied().unwrap_or(0);
            (turns, self.last.get(client).copied().unwrap_or(0))
        };
        let clients = self.waiting.iter().map(|(client, _)| had(client));
        let (place, _) = clients.enumerate().min_by_key(|(_, had)| *had)?;
        self.waiting.remove(place)
    }
}

impl Drop for FairTurn {
    fn drop(&mut self) {
        if let Some(limit) = self.limit.take() {
            limit.give_back(self.client);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::pin::pin;

    use futures_util::poll;

    use super::*;

    fn client(number: u8) -> Client {
        Some(IpAddr::from([10, 0, 0, number]))
    }

    #[tokio::test]
    async fn one_client_with_many_requests_delays_its_own() {
        let limit = FairLimit::new(2, 8);
        let [greedy, other] = [1, 2].map(client);
        let first = limit.turn(greedy).await.unwrap();
        let second = limit.turn(greedy).await.unwrap();
        let mut third = pin!(limit.turn(greedy));
        let mut fourth = pin!(limit.turn(greedy));
        let mut late = pin!(limit.turn(other));
        assert!(poll!(&mut third).is_pending());
        assert!(poll!(&mut fourth).is_pending());
        assert!(poll!(&mut late).is_pending());
        drop(first);
        assert!(
            poll!(&mut third).is_pending(),
            "the other client has no turn yet"
        );
        let late = late.await.unwrap();
        drop(second);
        let third = third.await.unwrap();
        assert!(poll!(&mut fourth).is_pending());
        drop((third, late));
        fourth.await.unwrap();
    }

    #[tokio::test]
    async fn those_with_as_many_turns_come_in_their_order() {
        let limit = FairLimit::new(1, 8);
        let held = limit.turn(client(1)).await.unwrap();
        let mut waiting: Vec<_> = (2..6)
            .map(|number| Box::pin(limit.turn(client(number))))
            .collect();
        for turn in &mut waiting {
            assert!(poll!(turn).is_pending());
        }
        drop(held);
        for mut turn in waiting {
            let std::task::Poll::Ready(turn) = poll!(&mut turn) else {
                panic!("another one came first");
            };
            drop(turn.unwrap());
        }
    }

    #[tokio::test]
    async fn with_one_turn_at_a_time_clients_alternate() {
        let limit = FairLimit::new(1, 8);
        let [greedy, other] = [1, 2].map(client);
        let held = limit.turn(greedy).await.unwrap();
        let mut second = pin!(limit.turn(greedy));
        let mut late = pin!(limit.turn(other));
        assert!(poll!(&mut second).is_pending());
        assert!(poll!(&mut late).is_pending());
        drop(held);
        assert!(poll!(&mut second).is_pending(), "the greedy one had a turn");
        drop(late.await.unwrap());
        drop(second.await.unwrap());
        assert!(limit.lock().last.is_empty());
    }

    #[tokio::test]
    async fn who_leaves_makes_room_and_gets_no_turn() {
        let limit = FairLimit::new(1, 1);
        let held = limit.turn(None).await.unwrap();
        let mut gone = Box::pin(limit.turn(client(1)));
        assert!(poll!(&mut gone).is_pending());
        assert!(matches!(limit.turn(None).await, Err(Error::Busy)));
        drop(gone);
        let mut kept = Box::pin(limit.turn(client(2)));
        assert!(poll!(&mut kept).is_pending());
        drop(held);
        drop(kept.await.unwrap());
        assert_eq!(limit.lock().running(), 0);
    }

    #[tokio::test]
    async fn a_turn_that_came_and_was_never_used_is_given_back() {
        let limit = FairLimit::new(1, 2);
        let held = limit.turn(client(1)).await.unwrap();
        let mut unused = Box::pin(limit.turn(client(2)));
        let mut next = Box::pin(limit.turn(client(3)));
        assert!(poll!(&mut unused).is_pending());
        assert!(poll!(&mut next).is_pending());
        drop(held);
        drop(unused);
        next.await.unwrap();
        assert_eq!(limit.lock().running(), 0);
    }
}
