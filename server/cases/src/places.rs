//! Places that clients share: for connections, uploads, streams of events and associations.

use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

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

/// Who takes places and turns. The default is this program itself.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub struct Client {
    /// The address, if it is known.
    pub address: Option<IpAddr>,
    /// The person or the token, if it has a name and there are others.
    pub identity: Option<Identity>,
}

/// What stands for a person or a token, at whatever address.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Identity([u8; 8]);

impl Client {
    /// Somebody at an address.
    pub fn at(address: IpAddr) -> Self {
        Self {
            address: Some(address),
            identity: None,
        }
    }
}

impl Identity {
    /// That of a name, which is unique.
    pub fn of(name: &str) -> Self {
        let [a, b, c, d, e, f, g, h, ..] = *blake3::hash(name.as_bytes()).as_bytes();
        Self([a, b, c, d, e, f, g, h])
    }

    /// A digest of the name.
    pub fn digest(self) -> [u8; 8] {
        self.0
    }
}

/// A number of places, of which one client may take only some. One [`Identity`], at however many addresses, takes at most as many as it
/// leaves free: alone half, two a third each, and the second of two a quarter if the first came long before. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Places {
    most: usize,
    most_of_one: usize,
    /// Held only briefly.
    held: Arc<Mutex<Held>>,
}

/// How many places each client has that has any.
#[derive(Debug, Default)]
struct Held(HashMap<Client, usize>);

/// A place, until it is dropped.
#[derive(Debug)]
pub struct Place {
    client: Client,
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

    /// A place, if there is one for this client. Who has no address may take all of them.
    pub fn take(&self, client: Client) -> Option<Place> {
        let most_of_one = match client.address {
            Some(_) => self.most_of_one,
            None => self.most,
        };
        self.take_at_most(client, most_of_one)
    }

    /// A place, if there is any, however many this client has.
    pub fn take_any(&self, client: Client) -> Option<Place> {
        self.take_at_most(client, self.most)
    }

    /// How many times the least rate a client must keep now.
    pub fn hurry(&self) -> f64 {
        hurry(self.taken())
    }

    /// The share that is taken.
    fn taken(&self) -> f64 {
        self.held().all() as f64 / self.most.max(1) as f64
    }

    fn take_at_most(&self, client: Client, most_of_one: usize) -> Option<Place> {
        let client = Client {
            address: client.address.map(network_of),
            ..client
        };
        let mut held = self.held();
        let free = self.most - held.all();
        let of_identity = client.identity.map_or(0, |own| held.of_identity(own));
        let own = held.0.get(&client).copied().unwrap_or(0);
        if of_identity >= free || own >= most_of_one {
            return None;
        }
        held.0.insert(client, own + 1);
        drop(held);
        Some(Place {
            client,
            places: self.clone(),
        })
    }

    fn held(&self) -> MutexGuard<'_, Held> {
        // Each change is complete, even if a holder panicked.
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Held {
    fn all(&self) -> usize {
        self.0.values().sum()
    }

    fn of_identity(&self, identity: Identity) -> usize {
        let own = self.0.iter();
        let own = own.filter(|(client, _)| client.identity == Some(identity));
        own.map(|(_, count)| count).sum()
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut held = self.places.held();
        match held.0.get_mut(&self.client) {
            Some(count) if *count > 1 => *count -= 1,
            _ => drop(held.0.remove(&self.client)),
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

    fn ip(text: &str) -> Client {
        Client::at(text.parse().unwrap())
    }

    /// Somebody with a name.
    fn named(number: u8, name: &str) -> Client {
        Client {
            identity: Some(Identity::of(name)),
            ..Client::at(IpAddr::from([10, 0, 0, number]))
        }
    }

    #[test]
    fn one_identity_takes_half_of_the_places_at_however_many_addresses() {
        let places = Places::in_quarters(8);
        let take = |number, name| places.take(named(number, name));
        let held: Vec<_> = (0..4).map(|number| take(number, "greedy")).collect();
        assert!(held.iter().all(Option::is_some));
        assert!(take(9, "greedy").is_none());
        assert!(take(9, "other").is_some());
        assert!(places.take(ip("10.0.0.9")).is_some(), "without a name");
        drop(held);
        assert!(take(9, "greedy").is_some());
        assert!(places.held().0.is_empty());
    }

    #[test]
    fn several_identities_leave_room_for_one_more() {
        let places = Places::in_quarters(32);
        let mut held = Vec::new();
        let mut count = |name: &str| {
            let taken = (0..=255).filter_map(|number| places.take(named(number, name)));
            let before = held.len();
            held.extend(taken);
            held.len() - before
        };
        assert_eq!(["a", "b", "c", "a", "d"].map(&mut count), [16, 8, 4, 0, 2]);
        assert_eq!(count("e"), 1);
        drop(held);
        // Those that come at the same time have as many each.
        let mut held = Vec::new();
        for number in 0..=255 {
            held.extend(["a", "b", "c"].map(|name| places.take(named(number, name))));
        }
        held.retain(Option::is_some);
        assert_eq!(held.len(), 24);
    }

    #[test]
    fn two_identities_at_one_address_have_places_of_their_own() {
        let places = Places::in_quarters(8);
        let _held = [(); 2].map(|()| places.take(named(1, "greedy")).unwrap());
        assert!(places.take(named(1, "greedy")).is_none());
        assert!(places.take(named(1, "other")).is_some());
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
            held.push(places.take(Client::default()).unwrap());
            shortages.push(shortage_at(places.taken()));
        }
        assert_eq!(shortages, [0.0, 0.0, 0.0, 0.0, 0.0, 0.25, 0.5, 0.75, 1.0]);
    }

    #[test]
    fn one_place_serves_one_client_after_another() {
        let places = Places::in_quarters(1);
        drop(places.take(Client::default()).unwrap());
        let _held = places.take(ip("10.0.0.1")).unwrap();
        assert!(places.take(Client::default()).is_none());
    }

    #[test]
    fn addresses_of_one_ipv6_network_are_one() {
        let places = Places::new(9, 1);
        let _held = places.take(ip("2001:db8::1")).unwrap();
        assert!(places.take(ip("2001:db8::2:3")).is_none());
        assert!(places.take(ip("2001:db8:0:1::1")).is_some());
        assert_eq!(
            network_of("::ffff:10.0.0.1".parse().unwrap()),
            "10.0.0.1".parse::<IpAddr>().unwrap()
        );
    }
}
