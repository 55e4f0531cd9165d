//! Places that clients share: for connections, uploads, streams of events and associations.

use std::collections::HashMap;
use std::net::{IpAddr, Ipv4Addr};
use std::sync::{Arc, Mutex, PoisonError};

/// How many times the least rate a client must keep if all places are taken.
const HURRY: f64 = 10.0;

/// How short places are if this share of them is taken: 0 up to half, 1 for all.
fn shortage_at(taken: f64) -> f64 {
    (2.0 * taken - 1.0).clamp(0.0, 1.0)
}

/// How many times the least rate a client must keep if this share of the places is taken.
pub fn hurry(taken: f64) -> f64 {
    1.0 + (HURRY - 1.0) * shortage_at(taken)
}

/// A number of places, of which one client may take only some. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Places {
    most: usize,
    most_of_one: usize,
    /// The number of places of each client. Held only briefly.
    held: Arc<Mutex<HashMap<IpAddr, usize>>>,
}

/// A place, until it is dropped.
#[derive(Debug)]
pub struct Place {
    client: IpAddr,
    places: Places,
}

impl Places {
    /// `most` places, of which one client takes at most `most_of_one`.
    pub fn new(most: usize, most_of_one: usize) -> Self {
        Self {
            most,
            most_of_one,
            held: Arc::default(),
        }
    }

    /// `most` places, of which one client takes at most a quarter.
    pub fn in_quarters(most: usize) -> Self {
        Self::new(most, most.div_ceil(4))
    }

    /// A place, if there is one for this client. `None` is this program itself, which may take all.
    pub fn take(&self, client: Option<IpAddr>) -> Option<Place> {
        match client {
            Some(client) => self.take_at_most(client, self.most_of_one),
            None => self.take_at_most(IpAddr::V4(Ipv4Addr::UNSPECIFIED), self.most),
        }
    }

    /// A place, if there is any, however many this client has.
    pub fn take_any(&self, client: IpAddr) -> Option<Place> {
        self.take_at_most(client, self.most)
    }

    /// How many times the least rate a client must keep now.
    pub fn hurry(&self) -> f64 {
        hurry(self.taken())
    }

    /// The share that is taken.
    fn taken(&self) -> f64 {
        let held = self.held.lock().unwrap_or_else(PoisonError::into_inner);
        let all: usize = held.values().sum();
        all as f64 / self.most.max(1) as f64
    }

    fn take_at_most(&self, client: IpAddr, most_of_one: usize) -> Option<Place> {
        let client = network_of(client);
        let mut held = self.held.lock().unwrap_or_else(PoisonError::into_inner);
        let all: usize = held.values().sum();
        let of_this = held.get(&client).copied().unwrap_or(0);
        if all >= self.most || of_this >= most_of_one {
            return None;
        }
        held.insert(client, of_this + 1);
        drop(held);
        let places = self.clone();
        Some(Place { client, places })
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let held = &self.places.held;
        let mut held = held.lock().unwrap_or_else(PoisonError::into_inner);
        match held.get_mut(&self.client) {
            Some(count) if *count > 1 => *count -= 1,
            _ => drop(held.remove(&self.client)),
        }
    }
}

/// The part of an address that identifies a client: for IPv6, the first 64 bits, because a client has all of the
/// others.
pub fn network_of(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(address) => {
            let [a, b, c, d, ..] = address.segments();
            IpAddr::from([a, b, c, d, 0, 0, 0, 0])
        }
        v4 => v4,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ip(text: &str) -> Option<IpAddr> {
        Some(text.parse().unwrap())
    }

    #[test]
    fn one_client_does_not_take_all_places() {
        let places = Places::in_quarters(4);
        let held = places.take(ip("10.0.0.1"));
        assert!(held.is_some());
        assert!(places.take(ip("10.0.0.1")).is_none());
        let others: Vec<_> = (2..5)
            .map(|n| places.take(ip(&format!("10.0.0.{n}"))))
            .collect();
        assert!(others.iter().all(Option::is_some));
        assert!(places.take(ip("10.0.0.9")).is_none(), "all are taken");
        drop(held);
        assert!(places.take(ip("10.0.0.9")).is_some());
    }

    #[test]
    fn places_are_short_once_half_of_them_are_taken() {
        let places = Places::in_quarters(8);
        let mut held = Vec::new();
        let mut shortages = vec![shortage_at(places.taken())];
        for _ in 0..8 {
            held.push(places.take(None).unwrap());
            shortages.push(shortage_at(places.taken()));
        }
        assert_eq!(shortages, [0.0, 0.0, 0.0, 0.0, 0.0, 0.25, 0.5, 0.75, 1.0]);
    }

    #[test]
    fn one_place_serves_one_client_after_another() {
        let places = Places::in_quarters(1);
        drop(places.take(None).unwrap());
        let _held = places.take(ip("10.0.0.1")).unwrap();
        assert!(places.take(None).is_none());
    }

    #[test]
    fn addresses_of_one_ipv6_network_are_one() {
        let places = Places::new(9, 1);
        let _held = places.take(ip("2001:db8::1")).unwrap();
        assert!(places.take(ip("2001:db8::2:3")).is_none());
        assert!(places.take(ip("2001:db8:0:1::1")).is_some());
        assert_eq!(
            network_of("::ffff:10.0.0.1".parse().unwrap()),
            ip("10.0.0.1").unwrap()
        );
    }
}
