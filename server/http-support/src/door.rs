//! Who is connected: strangers, who have not shown the right token yet, and clients, who have.
//!
//! Strangers cannot shut clients out. They have places of their own, few enough to be cheap; if these are taken, a new
//! stranger takes the place of the one that has been there longest among those of the address with the most. A right
//! token makes a stranger a client within milliseconds, so that only idle and hostile strangers lose their places.

use std::collections::HashMap;
use std::net::{IpAddr, Ipv4Addr};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use axum::http::HeaderMap;
use cases::Error;
use ipnet::IpNet;
use tokio::sync::Notify;

use cases::places::{Client, Identity, Place, Places, network_of};

/// Connections of strangers at a time.
pub(crate) const STRANGERS: usize = 256;

/// Where a proxy is that comes by a socket in the file system.
const THIS_MACHINE: IpAddr = IpAddr::V4(Ipv4Addr::LOCALHOST);

/// The connections of a listener. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Door {
    clients: Places,
    proxies: Arc<[IpNet]>,
    strangers: Arc<Mutex<Strangers>>,
}

/// The connections of strangers, the longest there first.
#[derive(Debug, Default)]
struct Strangers(Vec<Arc<Connection>>);

/// A connection, which every request that comes by it carries as an extension.
#[derive(Debug)]
pub struct Connection {
    address: IpAddr,
    by_proxy: bool,
    door: Door,
    /// The place of a client, once it is one.
    place: OnceLock<Place>,
    evicted: Notify,
}

/// A connection that is open, until this is dropped.
#[derive(Debug)]
pub struct Open(pub Arc<Connection>);

impl Door {
    /// At most `clients` connections of clients, of which `of_one` from one address that is not a proxy.
    pub fn new(clients: usize, of_one: usize, proxies: Arc<[IpNet]>) -> Self {
        Self {
            clients: Places::new(clients, of_one),
            proxies,
            strangers: Arc::default(),
        }
    }

    /// Lets a stranger in, if need be in the place of another one. Who has no address comes by the socket of the proxy.
    pub fn enter(&self, address: Option<IpAddr>) -> Open {
        let connection = Arc::new(Connection {
            address: network_of(address.unwrap_or(THIS_MACHINE)),
            by_proxy: address.is_none_or(|address| self.is_proxy(address)),
            door: self.clone(),
            place: OnceLock::new(),
            evicted: Notify::new(),
        });
        let mut strangers = self.strangers();
        if strangers.0.len() >= STRANGERS {
            strangers.evict();
        }
        strangers.0.push(connection.clone());
        Open(connection)
    }

    /// Whether more than half of the places of strangers are taken.
    pub fn is_crowded(&self) -> bool {
        self.strangers().0.len() > STRANGERS / 2
    }

    /// The address of the client of a request: the last one in `X-Forwarded-For` that no listed proxy has, if the
    /// request comes from a listed proxy.
    pub(crate) fn client_of(&self, peer: Option<IpAddr>, headers: &HeaderMap) -> IpAddr {
        if let Some(peer) = peer
            && !self.is_proxy(peer)
        {
            return peer;
        }
        let lines = headers.get_all("x-forwarded-for").iter().rev();
        let named = lines.flat_map(|line| line.to_str().unwrap_or("").rsplit(','));
        let mut client = peer.unwrap_or(THIS_MACHINE);
        for named in named {
            let Some(address) = address_of(named.trim()) else {
                break;
            };
            client = address;
            if !self.is_proxy(address) {
                break;
            }
        }
        client
    }

    fn is_proxy(&self, address: IpAddr) -> bool {
        let address = address.to_canonical();
        self.proxies
            .iter()
            .any(|network| network.contains(&address))
    }

    fn strangers(&self) -> std::sync::MutexGuard<'_, Strangers> {
        // Each change is complete, even if a holder panicked.
        self.strangers
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }
}

/// `10.0.0.1`, `10.0.0.1:80`, `2001:db8::1` or `[2001:db8::1]:80`.
fn address_of(text: &str) -> Option<IpAddr> {
    let with_port = || {
        text.parse()
            .map(|address: std::net::SocketAddr| address.ip())
    };
    let bare = text.trim_start_matches('[').trim_end_matches(']');
    bare.parse().or_else(|_| with_port()).ok()
}

impl Strangers {
    fn evict(&mut self) {
        let mut count: HashMap<IpAddr, usize> = HashMap::new();
        for stranger in &self.0 {
            *count.entry(stranger.address).or_default() += 1;
        }
        let most = count.values().copied().max();
        let first = self
            .0
            .iter()
            .position(|stranger| count.get(&stranger.address).copied() == most);
        if let Some(first) = first {
            self.0.remove(first).evicted.notify_one();
        }
    }

    fn remove(&mut self, connection: &Connection) {
        self.0
            .retain(|stranger| !std::ptr::eq(Arc::as_ptr(stranger), connection));
    }
}

impl Connection {
    /// Makes a stranger a client, with an identity if there are others. The connections of a proxy are those of all its clients.
    ///
    /// # Errors
    /// [`Error::Busy`] if there are too many clients, or too many connections of this one.
    pub fn admit(&self, identity: Option<Identity>) -> Result<(), Error> {
        if self.place.get().is_some() {
            return Ok(());
        }
        let places = &self.door.clients;
        let client = Client::at(self.address);
        let place = match self.by_proxy {
            true => places.take_any(client),
            false => places.take(Client { identity, ..client }),
        };
        let place = place.ok_or(Error::Busy)?;
        // Requests of one connection come one after the other, so nobody else has set it.
        let _ = self.place.set(place);
        self.door.strangers().remove(self);
        Ok(())
    }

    /// Whether it is the connection of a proxy, which many clients share.
    pub(crate) fn is_of_proxy(&self) -> bool {
        self.by_proxy
    }

    /// Resolves when another stranger needs the place.
    pub async fn evicted(&self) {
        self.evicted.notified().await;
    }
}

impl Drop for Open {
    fn drop(&mut self) {
        self.0.door.strangers().remove(&self.0);
    }
}

#[cfg(test)]
mod tests {
    use futures_util::FutureExt as _;

    use super::*;

    fn ip(text: &str) -> IpAddr {
        text.parse().unwrap()
    }

    fn door(proxies: &[&str]) -> Door {
        let proxies = proxies.iter().map(|network| network.parse().unwrap());
        Door::new(4, 2, proxies.collect())
    }

    fn is_evicted(open: &Open) -> bool {
        open.0.evicted().now_or_never().is_some()
    }

    #[test]
    fn strangers_of_the_greediest_address_lose_their_places_first() {
        let door = door(&[]);
        let quiet = door.enter(Some(ip("10.0.0.1")));
        let greedy: Vec<_> = (1..STRANGERS)
            .map(|_| door.enter(Some(ip("10.0.0.2"))))
            .collect();
        assert!(door.is_crowded());
        let late = door.enter(Some(ip("10.0.0.3")));
        assert!(is_evicted(&greedy[0]));
        assert!(!greedy[1..].iter().any(is_evicted));
        assert!(!is_evicted(&quiet) && !is_evicted(&late));
        drop(greedy);
        assert!(!door.is_crowded());
    }

    #[test]
    fn strangers_take_no_place_of_a_client_and_clients_none_of_another() {
        let door = door(&[]);
        let _strangers: Vec<_> = (0..STRANGERS)
            .map(|_| door.enter(Some(ip("10.0.0.1"))))
            .collect();
        let clients = [(); 3].map(|()| door.enter(Some(ip("10.0.0.1"))));
        clients[0].0.admit(None).unwrap();
        clients[0].0.admit(None).expect("it is one already");
        clients[1].0.admit(None).unwrap();
        assert!(clients[2].0.admit(None).is_err(), "two of one address");
        let other = door.enter(Some(ip("10.0.0.2")));
        other.0.admit(None).unwrap();
        assert!(!is_evicted(&clients[0]));
        drop(clients);
        let again = door.enter(Some(ip("10.0.0.1")));
        again.0.admit(None).expect("the place is free again");
    }

    #[test]
    fn a_proxy_has_as_many_connections_as_all_clients() {
        let door = door(&["10.1.0.0/16"]);
        let all = [(); 4].map(|()| door.enter(Some(ip("10.1.2.3"))));
        assert!(all.iter().all(|open| open.0.admit(None).is_ok()));
        assert!(
            door.enter(Some(ip("10.1.2.3"))).0.admit(None).is_err(),
            "all are taken"
        );
    }

    #[test]
    fn only_a_listed_proxy_names_the_client() {
        let door = door(&["10.1.0.0/16", "fd00::/8"]);
        let client = |peer: &str, named: &[&str]| {
            let lines = named.iter().map(|line| {
                let name = axum::http::HeaderName::from_static("x-forwarded-for");
                (name, line.parse().unwrap())
            });
            door.client_of(Some(ip(peer)), &lines.collect()).to_string()
        };
        assert_eq!(client("192.0.2.1", &["203.0.113.5"]), "192.0.2.1");
        assert_eq!(client("10.1.0.1", &[]), "10.1.0.1");
        assert_eq!(client("10.1.0.1", &["203.0.113.5"]), "203.0.113.5");
        assert_eq!(client("::ffff:10.1.0.1", &["203.0.113.5:9"]), "203.0.113.5");
        assert_eq!(client("10.1.0.1", &["[2001:db8::1]:80"]), "2001:db8::1");
        // What a client writes itself stands before what the proxies add.
        assert_eq!(
            client("10.1.0.1", &["1.2.3.4, 203.0.113.5, 10.1.9.9"]),
            "203.0.113.5"
        );
        assert_eq!(
            client("10.1.0.1", &["1.2.3.4", "203.0.113.5"]),
            "203.0.113.5"
        );
        assert_eq!(client("10.1.0.1", &["1.2.3.4, unknown"]), "10.1.0.1");
        assert_eq!(
            client("fd00::1", &["203.0.113.5, nonsense, 10.1.0.2"]),
            "10.1.0.2"
        );
    }
}
