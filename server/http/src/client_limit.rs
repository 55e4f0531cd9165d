//! How much of what is limited one client may have.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use case::Client;

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
}
