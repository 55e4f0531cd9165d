//! A limit on concurrent work that gives each client its place and its turn.

use std::collections::{HashMap, VecDeque};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use tokio::sync::oneshot;

use crate::places::{Client, Identity};

tokio::task_local! {
    static CLIENT: Client;
}

/// Runs a request of a client: what it does in a [`ConcurrencyLimit`](crate::ConcurrencyLimit) takes turns with the work of others.
pub async fn for_client<F: Future>(client: Client, request: F) -> F::Output {
    CLIENT.scope(client, request).await
}

/// The client of the request that this task runs.
pub(crate) fn this_client() -> Client {
    CLIENT.try_with(|client| *client).unwrap_or_default()
}

/// A limit on places, and on the work at a time of those who have one.
///
/// A free turn goes to the identity with the fewest turns, at however many addresses, among its clients to the one with the fewest, then to the
/// one whose last turn began first, and among its requests to the one that has waited longest, so that a client with many requests delays
/// its own. If all places are taken, the
/// client with the most of them loses the last of those that have not had a turn to a client with fewer. One identity, at
/// however many addresses, has at most as many places as it leaves free, or as many as may run.
#[derive(Debug, Clone)]
pub(crate) struct FairLimit {
    running: usize,
    places: usize,
    queue: Arc<Mutex<Queue>>,
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
    /// Places that were taken away, whose holders have not left yet.
    lost: usize,
    turns: usize,
    /// When the last turn began, in turns.
    last: u64,
}

#[derive(Debug)]
struct Waiting {
    client: Client,
    is_first: bool,
    turn: oneshot::Sender<FairTurn>,
}

/// A place, for work with one or several turns, until it is dropped.
#[derive(Debug)]
pub(crate) struct FairPlace {
    client: Client,
    limit: FairLimit,
    had_turn: AtomicBool,
}

/// The right to run, until it is dropped.
#[derive(Debug)]
pub(crate) struct FairTurn {
    client: Client,
    /// `None` once it was given back.
    limit: Option<FairLimit>,
}

impl FairLimit {
    /// `running` at a time, of those who have one of `places`.
    pub(crate) fn new(running: usize, places: usize) -> Self {
        Self {
            running,
            places,
            queue: Arc::default(),
        }
    }

    /// A place for a client; `None` if all are taken and no other client has many more.
    pub(crate) fn enter(&self, client: Client) -> Option<FairPlace> {
        let mut queue = self.lock();
        let free = self.places - queue.places();
        let most_of_one = free.max(self.running);
        // Then only one of its own may lose a place.
        let within =
            (client.identity).filter(|&own| queue.of(own, |share| share.places) >= most_of_one);
        let is_full = free == 0 || within.is_some();
        if is_full && !queue.make_room(client, within) {
            return None;
        }
        queue.clients.entry(client).or_default().places += 1;
        Some(FairPlace {
            client,
            limit: self.clone(),
            had_turn: AtomicBool::new(false),
        })
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
        while queue.turns() < self.running {
            let Some(next) = queue.take_next() else {
                break;
            };
            let turn = self.begin(&mut queue, next.client);
            if let Err(mut unwanted) = next.turn.send(turn) {
                unwanted.limit = None;
                queue.end(next.client);
            }
        }
    }

    /// The number of taken places, and of turns.
    pub(crate) fn taken(&self) -> (usize, usize) {
        let queue = self.lock();
        (queue.places(), queue.turns())
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Queue> {
        // Each change is complete, even if a holder panicked.
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl FairPlace {
    /// Waits for a turn; `None` if the place was lost to another client.
    pub(crate) async fn turn(&self) -> Option<FairTurn> {
        let turn = {
            let mut queue = self.limit.lock();
            queue.waiting.retain(|waiting| !waiting.turn.is_closed());
            if queue.turns() < self.limit.running {
                self.had_turn.store(true, Ordering::Relaxed);
                return Some(self.limit.begin(&mut queue, self.client));
            }
            let (sender, turn) = oneshot::channel();
            queue.waiting.push_back(Waiting {
                client: self.client,
                is_first: !self.had_turn.load(Ordering::Relaxed),
                turn: sender,
            });
            turn
        };
        let turn = turn.await.ok()?;
        self.had_turn.store(true, Ordering::Relaxed);
        Some(turn)
    }
}

impl Queue {
    fn places(&self) -> usize {
        self.clients.values().map(|share| share.places).sum()
    }

    fn turns(&self) -> usize {
        self.clients.values().map(|share| share.turns).sum()
    }

    /// What an identity has at all its addresses.
    fn of(&self, identity: Identity, has: impl Fn(&Share) -> usize) -> usize {
        let own = self.clients.iter();
        let own = own.filter(|(client, _)| client.identity == Some(identity));
        own.map(|(_, share)| has(share)).sum()
    }

    /// Takes a place away from the client with the most, if that has at least two more than this one; within an identity, if one is
    /// given.
    fn make_room(&mut self, client: Client, within: Option<Identity>) -> bool {
        let own = self.clients.get(&client).map_or(0, |share| share.places);
        let waits = |other: &Client| {
            let mut waiting = self.waiting.iter();
            waiting.any(|waiting| waiting.is_first && waiting.client == *other)
        };
        let others = self.clients.iter().filter(|(other, share)| {
            let is_within = within.is_none() || other.identity == within;
            let is_client = **other != Client::default();
            is_client && is_within && share.places >= own + 2 && waits(other)
        });
        let Some((&greedy, _)) = others.max_by_key(|(_, share)| share.places) else {
            return false;
        };
        let mut waiting = self.waiting.iter();
        let last = waiting.rposition(|waiting| waiting.is_first && waiting.client == greedy);
        // Whoever waits for this turn learns that it will not come.
        last.and_then(|last| self.waiting.remove(last));
        if let Some(share) = self.clients.get_mut(&greedy) {
            share.places -= 1;
            share.lost += 1;
        }
        true
    }

    fn leave(&mut self, client: Client) {
        let Some(share) = self.clients.get_mut(&client) else {
            return;
        };
        match share.lost {
            0 => share.places -= 1,
            _ => share.lost -= 1,
        }
        self.forget_if_gone(client);
    }

    fn begin(&mut self, client: Client) {
        self.begun += 1;
        let share = self.clients.entry(client).or_default();
        share.turns += 1;
        share.last = self.begun;
    }

    fn end(&mut self, client: Client) {
        if let Some(share) = self.clients.get_mut(&client) {
            share.turns -= 1;
            self.forget_if_gone(client);
        }
    }

    fn forget_if_gone(&mut self, client: Client) {
        let share = self.clients.get(&client);
        if share.is_some_and(|share| share.places + share.lost + share.turns == 0) {
            self.clients.remove(&client);
        }
    }

    fn take_next(&mut self) -> Option<Waiting> {
        let had = |waiting: &Waiting| {
            let share = self.clients.get(&waiting.client);
            let (turns, last) = share.map_or((0, 0), |share| (share.turns, share.last));
            let identity = waiting.client.identity;
            let of_all = identity.map_or(turns, |own| self.of(own, |share| share.turns));
            (of_all, turns, last)
        };
        let clients = self.waiting.iter().map(had).enumerate();
        let (place, _) = clients.min_by_key(|(_, had)| *had)?;
        self.waiting.remove(place)
    }
}

impl Drop for FairPlace {
    fn drop(&mut self) {
        self.limit.lock().leave(self.client);
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
        Client::at([10, 0, 0, number].into())
    }

    #[tokio::test]
    async fn one_identity_takes_half_of_the_places_at_however_many_addresses() {
        let limit = FairLimit::new(1, 8);
        let named = |number, name| Client {
            identity: Some(Identity::of(name)),
            ..client(number)
        };
        let _held: Vec<_> = (0..4)
            .map(|number| limit.enter(named(number, "greedy")).unwrap())
            .collect();
        assert!(limit.enter(named(9, "greedy")).is_none());
        let _others: Vec<_> = (0..2)
            .map(|number| limit.enter(named(number, "other")).unwrap())
            .collect();
        assert!(limit.enter(named(9, "other")).is_none(), "half of the rest");
        assert!(limit.enter(named(9, "third")).is_some());
    }

    #[tokio::test]
    async fn addresses_of_one_identity_share_its_places() {
        let limit = FairLimit::new(1, 8);
        let named = |number| Client {
            identity: Some(Identity::of("site")),
            ..client(number)
        };
        let places: Vec<_> = (0..4).map(|_| limit.enter(named(1)).unwrap()).collect();
        let mut turns: Vec<_> = places.iter().map(|place| Box::pin(place.turn())).collect();
        let _running = poll!(&mut turns[0]);
        for turn in &mut turns[1..] {
            assert!(poll!(turn).is_pending());
        }
        assert!(limit.enter(named(2)).is_some());
        assert!(turns.pop().unwrap().await.is_none(), "the last one is lost");
    }

    /// A place and its turn.
    async fn turn(limit: &FairLimit, client: Client) -> (FairTurn, FairPlace) {
        let place = limit.enter(client).expect("there is a place");
        (place.turn().await.expect("the place is kept"), place)
    }

    #[tokio::test]
    async fn one_identity_at_many_addresses_delays_its_own() {
        let limit = FairLimit::new(2, 16);
        let named = |number, name| Client {
            identity: Some(Identity::of(name)),
            ..client(number)
        };
        let first = turn(&limit, named(1, "greedy")).await;
        let _second = turn(&limit, named(2, "greedy")).await;
        let mut third = pin!(turn(&limit, named(3, "greedy")));
        let mut late = pin!(turn(&limit, named(9, "other")));
        assert!(poll!(&mut third).is_pending());
        assert!(poll!(&mut late).is_pending());
        drop(first);
        assert!(poll!(&mut third).is_pending(), "the other has no turn yet");
        let _late = late.await;
    }

    #[tokio::test]
    async fn one_client_with_many_requests_delays_its_own() {
        let limit = FairLimit::new(2, 8);
        let [greedy, other] = [1, 2].map(client);
        let first = turn(&limit, greedy).await;
        let second = turn(&limit, greedy).await;
        let mut third = pin!(turn(&limit, greedy));
        let mut fourth = pin!(turn(&limit, greedy));
        let mut late = pin!(turn(&limit, other));
        assert!(poll!(&mut third).is_pending());
        assert!(poll!(&mut fourth).is_pending());
        assert!(poll!(&mut late).is_pending());
        drop(first);
        assert!(
            poll!(&mut third).is_pending(),
            "the other client has no turn yet"
        );
        let late = late.await;
        drop(second);
        let third = third.await;
        assert!(poll!(&mut fourth).is_pending());
        drop((third, late));
        fourth.await;
    }

    #[tokio::test]
    async fn those_with_as_many_turns_come_in_their_order() {
        let limit = FairLimit::new(1, 8);
        let held = turn(&limit, client(1)).await;
        let mut waiting: Vec<_> = (2..6)
            .map(|number| Box::pin(turn(&limit, client(number))))
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
    async fn with_one_turn_at_a_time_clients_alternate() {
        let limit = FairLimit::new(1, 8);
        let [greedy, other] = [1, 2].map(client);
        let held = turn(&limit, greedy).await;
        let mut second = pin!(turn(&limit, greedy));
        let mut late = pin!(turn(&limit, other));
        assert!(poll!(&mut second).is_pending());
        assert!(poll!(&mut late).is_pending());
        drop(held);
        assert!(poll!(&mut second).is_pending(), "the greedy one had a turn");
        drop(late.await);
        drop(second.await);
        assert!(limit.lock().clients.is_empty());
    }

    #[tokio::test]
    async fn the_client_with_the_most_places_loses_its_last_to_another() {
        let limit = FairLimit::new(1, 4);
        let [greedy, other, third] = [1, 2, 3].map(client);
        let held = turn(&limit, greedy).await;
        let places: Vec<_> = (0..3).map(|_| limit.enter(greedy).unwrap()).collect();
        let mut turns: Vec<_> = places.iter().map(|place| Box::pin(place.turn())).collect();
        for turn in &mut turns {
            assert!(poll!(turn).is_pending());
        }
        assert!(limit.enter(greedy).is_none(), "nobody has more than it");
        let mut late = Box::pin(turn(&limit, other));
        assert!(poll!(&mut late).is_pending());
        assert!(turns.pop().unwrap().await.is_none(), "the last one is lost");
        // Its holder has not left yet; the place is counted once.
        assert_eq!(limit.taken(), (4, 1));
        let mut latest = Box::pin(turn(&limit, third));
        assert!(poll!(&mut latest).is_pending());
        assert!(turns.pop().unwrap().await.is_none());
        assert!(limit.enter(other).is_none(), "the other two have one more");
        drop(held);
        drop(late.await);
        drop(latest.await);
        drop(turns.pop().unwrap().await.unwrap());
        drop(turns);
        drop(places);
        assert!(limit.lock().clients.is_empty());
    }

    #[tokio::test]
    async fn work_that_has_begun_keeps_its_place() {
        let limit = FairLimit::new(1, 2);
        let [greedy, other] = [1, 2].map(client);
        let [one, two] = [0, 1].map(|_| limit.enter(greedy).unwrap());
        drop(two.turn().await.unwrap());
        let _held = one.turn().await.unwrap();
        let mut again = Box::pin(two.turn());
        assert!(poll!(&mut again).is_pending());
        assert!(limit.enter(other).is_none());
        assert!(poll!(&mut again).is_pending());
    }

    #[tokio::test]
    async fn who_leaves_makes_room_and_gets_no_turn() {
        let limit = FairLimit::new(1, 2);
        let held = turn(&limit, Client::default()).await;
        let mut gone = Box::pin(turn(&limit, client(1)));
        assert!(poll!(&mut gone).is_pending());
        assert!(limit.enter(Client::default()).is_none());
        drop(gone);
        let mut kept = Box::pin(turn(&limit, client(2)));
        assert!(poll!(&mut kept).is_pending());
        drop(held);
        drop(kept.await);
        assert_eq!(limit.taken(), (0, 0));
    }

    #[tokio::test]
    async fn a_turn_that_came_and_was_never_used_is_given_back() {
        let limit = FairLimit::new(1, 3);
        let held = turn(&limit, client(1)).await;
        let mut unused = Box::pin(turn(&limit, client(2)));
        let mut next = Box::pin(turn(&limit, client(3)));
        assert!(poll!(&mut unused).is_pending());
        assert!(poll!(&mut next).is_pending());
        drop(held);
        drop(unused);
        drop(next.await);
        assert_eq!(limit.taken(), (0, 0));
    }
}
