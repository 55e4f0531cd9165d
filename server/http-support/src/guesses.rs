//! Wrong tokens: a log line, and an answer that is delayed longer each time.

use std::collections::HashMap;
use std::net::{IpAddr, Ipv4Addr};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use crate::places::network_of;

/// The delay of the answer to the first wrong token from an address; it doubles with each further one.
const FIRST_DELAY: Duration = Duration::from_millis(100);

/// The greatest delay of an answer.
const LONGEST_DELAY: Duration = Duration::from_secs(5);

/// An address is forgotten after this time without a wrong token.
const REMEMBERED_FOR: Duration = Duration::from_secs(600);

/// Addresses that are remembered.
const ADDRESSES: usize = 4096;

/// The number of recent wrong tokens from each address.
#[derive(Debug, Default)]
pub(crate) struct Guesses {
    /// Held only briefly.
    by_address: Mutex<HashMap<IpAddr, Guess>>,
}

#[derive(Debug, Clone, Copy)]
struct Guess {
    count: u32,
    last: Instant,
}

impl Guesses {
    /// Records a wrong token, and waits. The first, second, fourth, eighth … from an address is logged.
    pub(crate) async fn punish(&self, address: Option<IpAddr>) {
        let address = address.map_or(IpAddr::V4(Ipv4Addr::UNSPECIFIED), network_of);
        let count = self.count(address, Instant::now());
        if count.is_power_of_two() {
            tracing::warn!(%address, count, "wrong tokens from this address");
        }
        tokio::time::sleep(delay(count)).await;
    }

    /// Adds one, and returns the new number.
    fn count(&self, address: IpAddr, now: Instant) -> u32 {
        let mut all = self
            .by_address
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        if all.len() >= ADDRESSES && !all.contains_key(&address) {
            all.retain(|_, guess| now.duration_since(guess.last) < REMEMBERED_FOR);
            let oldest = all.iter().min_by_key(|(_, guess)| guess.last);
            if let Some(oldest) = oldest.map(|(&address, _)| address)
                && all.len() >= ADDRESSES
            {
                all.remove(&oldest);
            }
        }
        let guess = all.entry(address).or_insert(Guess {
            count: 0,
            last: now,
        });
        if now.duration_since(guess.last) >= REMEMBERED_FOR {
            guess.count = 0;
        }
        guess.count = guess.count.saturating_add(1);
        guess.last = now;
        guess.count
    }
}

/// The delay of the answer to the `count`th wrong token.
fn delay(count: u32) -> Duration {
    let doublings = count.saturating_sub(1).min(16);
    LONGEST_DELAY.min(FIRST_DELAY.saturating_mul(1 << doublings))
}

#[cfg(test)]
mod tests {
    use super::*;

    const ADDRESS: IpAddr = IpAddr::V4(Ipv4Addr::LOCALHOST);

    #[test]
    fn delays_grow_to_five_seconds() {
        let ms = [1, 2, 3, 6, 7, u32::MAX].map(|count| delay(count).as_millis());
        assert_eq!(ms, [100, 200, 400, 3200, 5000, 5000]);
    }

    #[test]
    fn an_address_is_forgotten_after_ten_quiet_minutes() {
        let guesses = Guesses::default();
        let start = Instant::now();
        assert_eq!(guesses.count(ADDRESS, start), 1);
        assert_eq!(guesses.count(ADDRESS, start + Duration::from_secs(599)), 2);
        assert_eq!(guesses.count(ADDRESS, start + Duration::from_secs(1199)), 1);
    }

    #[test]
    fn the_memory_of_addresses_is_bounded() {
        let guesses = Guesses::default();
        let start = Instant::now();
        for number in 0..ADDRESSES as u32 + 10 {
            let at = start + Duration::from_millis(number.into());
            guesses.count(IpAddr::V4(number.into()), at);
        }
        assert_eq!(guesses.by_address.lock().unwrap().len(), ADDRESSES);
    }
}
