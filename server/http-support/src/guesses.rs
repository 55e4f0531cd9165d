//! Wrong tokens: a log line, and a time in which the address is answered 429.

use std::collections::HashMap;
use std::net::{IpAddr, Ipv4Addr};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use cases::places::network_of;

/// Wrong tokens from an address without a consequence: a page sends several requests at a time.
const FREE: u32 = 8;

/// The time that the first further wrong token costs; it doubles with each one.
const FIRST_DELAY: Duration = Duration::from_millis(100);

/// The longest time that a wrong token costs.
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
    /// Records a wrong token. Returns how long its address should wait before the next one, if it should have waited
    /// before this one. The first, second, fourth, eighth … from an address is logged.
    pub(crate) fn record(&self, address: Option<IpAddr>) -> Option<Duration> {
        let address = address.map_or(IpAddr::V4(Ipv4Addr::UNSPECIFIED), network_of);
        let now = Instant::now();
        let (count, since) = self.count(address, now);
        if count.is_power_of_two() {
            tracing::warn!(%address, count, "wrong tokens from this address");
        }
        (since < delay(count - 1)).then(|| delay(count))
    }

    /// Adds one, and returns the new number and the time since the one before.
    fn count(&self, address: IpAddr, now: Instant) -> (u32, Duration) {
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
        let since = now.duration_since(guess.last);
        guess.last = now;
        (guess.count, since)
    }
}

/// The time that the `count`th wrong token costs.
fn delay(count: u32) -> Duration {
    match count.checked_sub(FREE + 1) {
        None => Duration::ZERO,
        Some(doublings) => LONGEST_DELAY.min(FIRST_DELAY.saturating_mul(1 << doublings.min(16))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ADDRESS: IpAddr = IpAddr::V4(Ipv4Addr::LOCALHOST);

    #[test]
    fn delays_grow_to_five_seconds() {
        let ms = [0, 1, 8, 9, 10, 14, 15, u32::MAX].map(|count| delay(count).as_millis());
        assert_eq!(ms, [0, 0, 0, 100, 200, 3200, 5000, 5000]);
    }

    #[test]
    fn only_an_address_that_goes_on_guessing_must_wait() {
        let guesses = Guesses::default();
        let first = [(); 9].map(|()| guesses.record(Some(ADDRESS)));
        assert_eq!(first, [None; 9]);
        let next = [(); 7].map(|()| guesses.record(Some(ADDRESS)).map(|wait| wait.as_millis()));
        assert_eq!(next, [200, 400, 800, 1600, 3200, 5000, 5000].map(Some));
        assert_eq!(guesses.record(Some(IpAddr::from([10, 0, 0, 1]))), None);
    }

    #[test]
    fn an_address_is_forgotten_after_ten_quiet_minutes() {
        let guesses = Guesses::default();
        let start = Instant::now();
        let count = |secs| guesses.count(ADDRESS, start + Duration::from_secs(secs)).0;
        assert_eq!([0, 599, 1199].map(count), [1, 2, 1]);
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
