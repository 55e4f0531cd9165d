//! Bounds, so that a flood of refusals does not fill the disk.

use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Whom, from where and what for.
pub(crate) type Key = (Arc<str>, Option<IpAddr>, &'static str);

/// Keys that are remembered.
const KEYS: usize = 4096;

/// A refusal is forgotten after this time without another one like it.
const REFUSED_FOR: Duration = Duration::from_secs(600);

/// Somebody who shows a token again within this time has not signed in anew.
const SIGNED_IN_FOR: Duration = Duration::from_secs(12 * 3600);

/// Refusals that are recorded at once; then one a second.
const BURST: f64 = 60.0;

/// What was seen, and when last.
#[derive(Debug)]
struct Seen {
    by_key: HashMap<Key, (u64, Instant)>,
    remembered_for: Duration,
}

impl Seen {
    fn new(remembered_for: Duration) -> Self {
        Self {
            by_key: HashMap::new(),
            remembered_for,
        }
    }

    /// Counts one, and returns how many there were.
    fn count(&mut self, key: Key, now: Instant) -> u64 {
        let remembered_for = self.remembered_for;
        let is_old = move |last: Instant| now.duration_since(last) >= remembered_for;
        if self.by_key.len() >= KEYS && !self.by_key.contains_key(&key) {
            // The older half at once, so that a flood costs little.
            let mut times: Vec<_> = self.by_key.values().map(|(_, last)| *last).collect();
            let (_, &mut middle, _) = times.select_nth_unstable(KEYS / 2);
            let mut keep = KEYS / 2;
            self.by_key.retain(|_, (_, last)| {
                let is_kept = !is_old(*last) && *last >= middle && keep > 0;
                keep -= usize::from(is_kept);
                is_kept
            });
        }
        let (count, last) = self.by_key.entry(key).or_insert((0, now));
        if is_old(*last) {
            *count = 0;
        }
        *count += 1;
        *last = now;
        *count
    }
}

/// Which refusals and sign-ins are recorded.
#[derive(Debug)]
pub(crate) struct Bounded {
    refused: Seen,
    signed_in: Seen,
    room: f64,
    filled: Instant,
    /// Refusals since the last one that was recorded.
    skipped: u64,
}

impl Bounded {
    pub(crate) fn new() -> Self {
        Self {
            refused: Seen::new(REFUSED_FOR),
            signed_in: Seen::new(SIGNED_IN_FOR),
            room: BURST,
            filled: Instant::now(),
            skipped: 0,
        }
    }

    /// Counts a refusal. If it is to be recorded, returns how many there were since the last one that was: the first, second, fourth,
    /// eighth … of a key is, as long as these are no more than one a second for long.
    pub(crate) fn refusal(&mut self, key: Key, now: Instant) -> Option<u64> {
        self.skipped += 1;
        let is_due = self.refused.count(key, now).is_power_of_two();
        let passed = now.duration_since(self.filled).as_secs_f64();
        self.room = (self.room + passed).min(BURST);
        self.filled = now;
        if !is_due || self.room < 1.0 {
            return None;
        }
        self.room -= 1.0;
        Some(std::mem::take(&mut self.skipped))
    }

    /// Whether somebody signs in by showing a token: for the first time in half a day from this address.
    pub(crate) fn is_sign_in(&mut self, key: Key, now: Instant) -> bool {
        self.signed_in.count(key, now) == 1
    }

    /// Makes the next request of somebody a sign-in.
    pub(crate) fn sign_out(&mut self, key: &Key) {
        self.signed_in.by_key.remove(key);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(number: u32) -> Key {
        ("nobody".into(), Some(IpAddr::V4(number.into())), "refusal")
    }

    #[test]
    fn refusals_of_one_address_are_recorded_ever_more_rarely_and_none_is_uncounted() {
        let mut bounded = Bounded::new();
        let now = Instant::now();
        let recorded: Vec<_> = (0..1024).map(|_| bounded.refusal(key(1), now)).collect();
        let counts: Vec<_> = recorded.into_iter().flatten().collect();
        assert_eq!(counts.len(), 11);
        assert_eq!(counts.iter().sum::<u64>(), 1024);
        let later = now + REFUSED_FOR;
        assert_eq!(bounded.refusal(key(1), later), Some(1), "it was forgotten");
    }

    #[test]
    fn many_addresses_together_are_recorded_once_a_second() {
        let mut bounded = Bounded::new();
        let start = Instant::now();
        let flood = |bounded: &mut Bounded, seconds: u64, from: u32| {
            let now = start + Duration::from_secs(seconds);
            let some = (from..from + 10_000).filter_map(|number| bounded.refusal(key(number), now));
            some.count()
        };
        assert_eq!(flood(&mut bounded, 0, 0), 60);
        assert_eq!(flood(&mut bounded, 10, 10_000), 10);
        assert!(bounded.refused.by_key.len() <= KEYS);
        assert!(bounded.skipped > 9_000);
    }

    #[test]
    fn somebody_signs_in_once_in_half_a_day_unless_it_could_not_be_recorded() {
        let mut bounded = Bounded::new();
        let now = Instant::now();
        assert!(bounded.is_sign_in(key(1), now) && bounded.is_sign_in(key(2), now));
        assert!(!bounded.is_sign_in(key(1), now + SIGNED_IN_FOR / 2));
        assert!(
            !bounded.is_sign_in(key(1), now + SIGNED_IN_FOR),
            "used meanwhile"
        );
        assert!(bounded.is_sign_in(key(2), now + SIGNED_IN_FOR));
        bounded.sign_out(&key(1));
        assert!(bounded.is_sign_in(key(1), now + SIGNED_IN_FOR));
    }
}
