//! Who asks, and how much of what is limited one client may have.

use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

tokio::task_local! {
    static CLIENT: Client;
}

/// Whoever shares limits with others.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub enum Client {
    /// This program itself, or a proxy, which asks for many. It may take all.
    #[default]
    Program,
    /// Somebody without a name at an address: for IPv6, its first 64 bits, because a client has all of the others.
    Address(IpAddr),
    /// A person or a token at whatever address, by the first bytes of the BLAKE3 digest of its name.
    Named([u8; 8]),
}

impl Client {
    /// Somebody without a name at an address.
    pub fn at(address: IpAddr) -> Self {
        Self::Address(match address.to_canonical() {
            IpAddr::V6(address) => {
                let [a, b, c, d, ..] = address.segments();
                IpAddr::from([a, b, c, d, 0, 0, 0, 0])
            }
            v4 => v4,
        })
    }

    /// A person or a token with a name that nobody else has.
    pub fn named(name: &str) -> Self {
        let [a, b, c, d, e, f, g, h, ..] = *blake3::hash(name.as_bytes()).as_bytes();
        Self::Named([a, b, c, d, e, f, g, h])
    }

    /// What stands for the client in the store; empty for this program. It has neither an address nor a name.
    pub(crate) fn in_store(self) -> String {
        match self {
            Self::Program => String::new(),
            Self::Address(address) => {
                blake3::hash(address.to_string().as_bytes()).to_hex()[..16].to_owned()
            }
            Self::Named(name) => format!("{:016x}-named", u64::from_be_bytes(name)),
        }
    }
}

/// Runs a request of a client: what it does in a [`ConcurrencyLimit`](crate::ConcurrencyLimit) takes turns with the work of others.
pub async fn for_client<F: Future>(client: Client, request: F) -> F::Output {
    CLIENT.scope(client, request).await
}

/// The client of the request that this task runs.
pub(crate) fn this_client() -> Client {
    CLIENT.try_with(|client| *client).unwrap_or_default()
}

/// A number of permits, of which one client may have a quarter. Cheap to clone.
#[derive(Debug, Clone)]
pub struct ClientLimit {
    most: usize,
    /// How many each client has that has any. Held only briefly.
    held: Arc<Mutex<HashMap<Client, usize>>>,
}

/// A permit, until it is dropped.
#[derive(Debug)]
pub struct ClientPermit {
    client: Client,
    limit: ClientLimit,
}

impl ClientLimit {
    /// So many permits.
    pub fn new(most: usize) -> Self {
        Self {
            most,
            held: Arc::default(),
        }
    }

    /// A permit, if there is one for this client.
    pub fn try_acquire(&self, client: Client) -> Option<ClientPermit> {
        let most_of_one = match client {
            Client::Program => self.most,
            Client::Address(_) | Client::Named(_) => self.most.div_ceil(4),
        };
        let mut held = self.held();
        let all: usize = held.values().sum();
        let own = held.get(&client).copied().unwrap_or(0);
        if all >= self.most || own >= most_of_one {
            return None;
        }
        held.insert(client, own + 1);
        drop(held);
        Some(ClientPermit {
            client,
            limit: self.clone(),
        })
    }

    fn held(&self) -> MutexGuard<'_, HashMap<Client, usize>> {
        // Each change is complete, even if a holder panicked.
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for ClientPermit {
    fn drop(&mut self) {
        let mut held = self.limit.held();
        match held.get_mut(&self.client) {
            Some(count) if *count > 1 => *count -= 1,
            _ => drop(held.remove(&self.client)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(text: &str) -> Client {
        Client::at(text.parse().unwrap())
    }

    #[test]
    fn one_client_has_a_quarter_of_the_permits() {
        let limit = ClientLimit::new(8);
        let held = [(); 2].map(|()| limit.try_acquire(at("10.0.0.1")).unwrap());
        assert!(limit.try_acquire(at("10.0.0.1")).is_none());
        // Of the names at one address, each is a client.
        let named = ["ana", "ana", "bo", "bo"].map(|name| limit.try_acquire(Client::named(name)));
        assert!(named.iter().all(Option::is_some));
        assert!(limit.try_acquire(Client::named("ana")).is_none());
        let program = [(); 2].map(|()| limit.try_acquire(Client::Program).unwrap());
        assert!(limit.try_acquire(at("10.0.0.2")).is_none(), "all are taken");
        drop((held, named, program));
        assert!(limit.held().is_empty());
        let all: Vec<_> = (0..8).map(|_| limit.try_acquire(Client::Program)).collect();
        assert!(all.iter().all(Option::is_some));
    }

    #[test]
    fn one_permit_serves_one_client_after_another() {
        let limit = ClientLimit::new(1);
        drop(limit.try_acquire(at("10.0.0.1")).unwrap());
        let _held = limit.try_acquire(at("10.0.0.2")).unwrap();
        assert!(limit.try_acquire(at("10.0.0.1")).is_none());
    }

    #[test]
    fn addresses_of_one_ipv6_network_are_one_client() {
        assert_eq!(at("2001:db8::1"), at("2001:db8::2:3"));
        assert_ne!(at("2001:db8::1"), at("2001:db8:0:1::1"));
        assert_eq!(at("::ffff:10.0.0.1"), at("10.0.0.1"));
    }
}
