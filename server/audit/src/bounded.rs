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

/// Somebody who shows a token again within this time has not signed in again.
const SIGNED_IN_FOR: Duration = Duration::from_secs(12 * 3600);

/// Failures are counted together after so many, until something succeeds …
const FAILURES: u64 = 8;

/// … or for this time without another one.
const FAILED_FOR: Duration = Duration::from_secs(300);

/// Refusals that are recorded at once; then one a second.
const BURST: f64 = 60.0;

/// What was seen, and when last.
#[derive(Debug)]
struct Seen {
    by_key: HashMap<Key, Count>,
    remembered_for: Duration,
    /// What was not recorded of keys that are not remembered any more.
    forgotten: u64,
}

/// How often a key was seen.
#[derive(Debug)]
struct Count {
    all: u64,
    /// Of these, since one was last recorded.
    unrecorded: u64,
    last: Instant,
}

impl Seen {
    fn new(remembered_for: Duration) -> Self {
        Self {
            by_key: HashMap::new(),
            remembered_for,
            forgotten: 0,
        }
    }

    fn count(&mut self, key: Key, now: Instant) -> &mut Count {
        if self.by_key.len() >= KEYS && !self.by_key.contains_key(&key) {
            // The older half at once, so that a flood costs little.
            let mut times: Vec<_> = self.by_key.values().map(|count| count.last).collect();
            let (_, &mut middle, _) = times.select_nth_unstable(KEYS / 2);
            let mut keep = KEYS / 2;
            self.forget(now, |count| {
                let is_kept = count.last >= middle && keep > 0;
                keep -= usize::from(is_kept);
                !is_kept
            });
        }
        let count = self.by_key.entry(key).or_insert(Count {
            all: 0,
            unrecorded: 0,
            last: now,
        });
        if now.duration_since(count.last) >= self.remembered_for {
            count.all = 0;
        }
        count.all += 1;
        count.unrecorded += 1;
        count.last = now;
        count
    }

    /// Forgets the keys that were not seen for a while, and some others.
    fn forget(&mut self, now: Instant, mut others: impl FnMut(&Count) -> bool) {
        let (remembered_for, forgotten) = (self.remembered_for, &mut self.forgotten);
        self.by_key.retain(|_, count| {
            let goes = now.duration_since(count.last) >= remembered_for || others(count);
            if goes {
                *forgotten += count.unrecorded;
            }
            !goes
        });
    }
}

/// Refusals that are to be recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Due {
    /// Those of the key since one of it was last recorded.
    pub(crate) own: u64,
    /// Those of keys that are not remembered any more.
    pub(crate) others: u64,
}

/// Which refusals and sign-ins are recorded.
#[derive(Debug)]
pub(crate) struct Bounded {
    refused: Seen,
    signed_in: Seen,
    failed: Seen,
    room: f64,
    filled: Instant,
}

impl Bounded {
    pub(crate) fn new() -> Self {
        Self {
            refused: Seen::new(REFUSED_FOR),
            signed_in: Seen::new(SIGNED_IN_FOR),
            failed: Seen::new(FAILED_FOR),
            room: BURST,
            filled: Instant::now(),
        }
    }

    /// Counts a refusal. If it is to be recorded, returns how many there were since the last one of its key that was: the first, second,
    /// fourth, eighth … of a key is, as long as these are no more than one a second for long.
    pub(crate) fn refusal(&mut self, key: Key, now: Instant) -> Option<Due> {
        let passed = now.duration_since(self.filled).as_secs_f64();
        self.room = (self.room + passed).min(BURST);
        self.filled = now;
        let count = self.refused.count(key, now);
        if !count.all.is_power_of_two() || self.room < 1.0 {
            return None;
        }
        self.room -= 1.0;
        let own = std::mem::take(&mut count.unrecorded);
        self.refused.forget(now, |_| false);
        let others = std::mem::take(&mut self.refused.forgotten);
        Some(Due { own, others })
    }

    /// All refusals that were not recorded.
    pub(crate) fn rest(&mut self) -> u64 {
        self.refused.forget(Instant::now(), |_| true);
        std::mem::take(&mut self.refused.forgotten)
    }

    /// Whether somebody signs in by showing a token: for the first time in half a day from this address.
    pub(crate) fn is_sign_in(&mut self, key: Key, now: Instant) -> bool {
        self.signed_in.count(key, now).all == 1
    }

    /// Notes how something ended.
    pub(crate) fn ended(&mut self, key: Key, is_success: bool, now: Instant) {
        match is_success {
            true => drop(self.failed.by_key.remove(&key)),
            false => drop(self.failed.count(key, now)),
        }
    }

    /// Whether something has failed so often in a row that failures of it are counted together.
    pub(crate) fn fails(&self, key: &Key, now: Instant) -> bool {
        let failed = self.failed.by_key.get(key);
        failed.is_some_and(|count| {
            count.all >= FAILURES && now.duration_since(count.last) < FAILED_FOR
        })
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
        assert_eq!(counts.iter().map(|due| due.own).sum::<u64>(), 1024);
        let later = now + REFUSED_FOR;
        let again = bounded.refusal(key(1), later).unwrap();
        assert_eq!(again.own, 1, "it was forgotten");
    }

    #[test]
    fn refusals_are_counted_for_their_own_address() {
        let mut bounded = Bounded::new();
        let now = Instant::now();
        for _ in 0..7 {
            bounded.refusal(key(1), now);
        }
        let other = bounded.refusal(key(2), now);
        assert_eq!(other, Some(Due { own: 1, others: 0 }));
        assert_eq!(bounded.refusal(key(1), now).unwrap().own, 4);
        for _ in 0..3 {
            bounded.refusal(key(1), now);
        }
        // What nobody comes back for is said with the next one.
        let later = now + REFUSED_FOR;
        let due = bounded.refusal(key(2), later);
        assert_eq!(due, Some(Due { own: 1, others: 3 }));
        bounded.refusal(key(3), later);
        bounded.refusal(key(3), later);
        bounded.refusal(key(3), later);
        assert_eq!((bounded.rest(), bounded.rest()), (1, 0));
    }

    #[test]
    fn many_addresses_together_are_recorded_once_a_second_and_none_is_uncounted() {
        let mut bounded = Bounded::new();
        let start = Instant::now();
        let mut counted = 0;
        let mut flood = |bounded: &mut Bounded, seconds: u64, from: u32| {
            let now = start + Duration::from_secs(seconds);
            let some = (from..from + 10_000).filter_map(|number| bounded.refusal(key(number), now));
            let due: Vec<_> = some.collect();
            counted += due.iter().map(|due| due.own + due.others).sum::<u64>();
            due.len()
        };
        assert_eq!(flood(&mut bounded, 0, 0), 60);
        assert_eq!(flood(&mut bounded, 10, 10_000), 10);
        assert!(bounded.refused.by_key.len() <= KEYS);
        assert_eq!(counted + bounded.rest(), 20_000);
    }

    #[test]
    fn failures_in_a_row_are_counted_until_something_succeeds_or_for_a_while() {
        let mut bounded = Bounded::new();
        let now = Instant::now();
        for _ in 0..FAILURES {
            assert!(!bounded.fails(&key(1), now));
            bounded.ended(key(1), false, now);
        }
        assert!(bounded.fails(&key(1), now) && !bounded.fails(&key(2), now));
        assert!(!bounded.fails(&key(1), now + FAILED_FOR));
        bounded.ended(key(1), true, now);
        assert!(!bounded.fails(&key(1), now));
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
