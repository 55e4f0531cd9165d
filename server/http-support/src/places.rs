//! The cap on connections, in all and per address.

use std::collections::HashMap;
use std::collections::VecDeque;
use std::net::IpAddr;
use std::sync::{Arc, Mutex, PoisonError};

use tokio::task::AbortHandle;

/// Connections beyond the cap, for health checks. The newest are kept, because a health check takes milliseconds; there are
/// so many that a burst of others does not end one meanwhile.
const SPARE: usize = 256;

/// Places for connections.
#[derive(Debug, Clone)]
pub(crate) struct Places {
    most: usize,
    most_of_one: usize,
    /// The number of connections of each address. Held only briefly.
    held: Arc<Mutex<HashMap<IpAddr, usize>>>,
}

/// The place of a connection, until it is dropped.
#[derive(Debug)]
pub(crate) struct Place {
    address: IpAddr,
    places: Places,
}

impl Places {
    pub(crate) fn new(most: usize, most_of_one: usize) -> Self {
        Self {
            most,
            most_of_one,
            held: Arc::default(),
        }
    }

    /// A place, if there is one for this address.
    pub(crate) fn take(&self, address: IpAddr) -> Option<Place> {
        let address = network_of(address);
        let mut held = self.held.lock().unwrap_or_else(PoisonError::into_inner);
        let all: usize = held.values().sum();
        let of_this = held.get(&address).copied().unwrap_or(0);
        if all >= self.most || of_this >= self.most_of_one {
            return None;
        }
        held.insert(address, of_this + 1);
        drop(held);
        let places = self.clone();
        Some(Place { address, places })
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let held = &self.places.held;
        let mut held = held.lock().unwrap_or_else(PoisonError::into_inner);
        match held.get_mut(&self.address) {
            Some(count) if *count > 1 => *count -= 1,
            _ => drop(held.remove(&self.address)),
        }
    }
}

/// The part of an address that identifies a client: for IPv6, the first 64 bits, because a client has all of the
/// others.
pub(crate) fn network_of(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(address) => {
            let [a, b, c, d, ..] = address.segments();
            IpAddr::from([a, b, c, d, 0, 0, 0, 0])
        }
        v4 => v4,
    }
}

/// The connections beyond the cap, oldest first. A new one ends the oldest.
#[derive(Debug, Default)]
pub(crate) struct Spares(VecDeque<AbortHandle>);

impl Spares {
    pub(crate) fn add(&mut self, connection: AbortHandle) {
        self.0.retain(|connection| !connection.is_finished());
        if self.0.len() >= SPARE
            && let Some(oldest) = self.0.pop_front()
        {
            oldest.abort();
        }
        self.0.push_back(connection);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ip(text: &str) -> IpAddr {
        text.parse().unwrap()
    }

    #[test]
    fn one_address_does_not_take_all_places() {
        let places = Places::new(4, 3);
        let mut held: Vec<_> = (0..3).map(|_| places.take(ip("10.0.0.1"))).collect();
        assert!(held.iter().all(Option::is_some));
        assert!(places.take(ip("10.0.0.1")).is_none());
        held.push(places.take(ip("10.0.0.2")));
        assert!(held[3].is_some());
        assert!(places.take(ip("10.0.0.3")).is_none(), "all are taken");
        held.remove(0);
        assert!(places.take(ip("10.0.0.1")).is_some());
    }

    #[test]
    fn addresses_of_one_ipv6_network_are_one() {
        let places = Places::new(9, 1);
        let _held = places.take(ip("2001:db8::1")).unwrap();
        assert!(places.take(ip("2001:db8::2:3")).is_none());
        assert!(places.take(ip("2001:db8:0:1::1")).is_some());
        assert_eq!(network_of(ip("::ffff:10.0.0.1")), ip("10.0.0.1"));
    }

    #[tokio::test]
    async fn the_newest_spare_connections_stay() {
        let mut spares = Spares::default();
        let tasks: Vec<_> = (0..=SPARE)
            .map(|_| tokio::spawn(std::future::pending::<()>()))
            .collect();
        for task in &tasks {
            spares.add(task.abort_handle());
        }
        tokio::task::yield_now().await;
        let ended = tasks.iter().filter(|task| task.is_finished()).count();
        assert_eq!((ended, tasks[0].is_finished()), (1, true));
    }
}
