//! The least rate at which a peer must send a message.

use std::time::Duration;

use cases::places::hurry;

use crate::dimse::wire::MAX_PDU_LENGTH;

/// How long a peer may be slower at the beginning of a message.
const SLOW_START: Duration = Duration::from_secs(10);

/// The time that a peer has for the rest of a message: each byte earns some.
#[derive(Debug)]
pub(crate) struct Pace {
    bytes_per_second: u64,
    credit: Duration,
}

impl Pace {
    /// Before a message.
    pub(crate) fn new(bytes_per_second: u64) -> Self {
        Self {
            bytes_per_second: bytes_per_second.max(1),
            credit: SLOW_START,
        }
    }

    /// How long the next PDU may take: as long as the credit, and as one of the greatest length earns.
    pub(crate) fn patience(&self) -> Duration {
        self.credit + self.earned(MAX_PDU_LENGTH as usize, 0.0)
    }

    /// Counts a PDU of a message, how long it was waited for, and which part of the associations is taken; `false` if the peer is too slow.
    pub(crate) fn is_kept(&mut self, bytes: usize, waited: Duration, taken: f64) -> bool {
        let earned = self.earned(bytes, taken);
        match (self.credit + earned).checked_sub(waited) {
            None => false,
            Some(left) => {
                self.credit = left.min(SLOW_START);
                true
            }
        }
    }

    /// The time for some bytes. The rate rises once half of the associations are taken.
    fn earned(&self, bytes: usize, taken: f64) -> Duration {
        let rate = self.bytes_per_second as f64 * hurry(taken);
        Duration::try_from_secs_f64(bytes as f64 / rate).unwrap_or(Duration::MAX / 4)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    /// After how many PDUs of so many bytes, a second apart, a peer is too slow; `None` if it never is.
    fn given_up(bytes: usize, taken: f64) -> Option<usize> {
        let mut pace = Pace::new(10_000);
        (0..1000).position(|_| !pace.is_kept(bytes, SECOND, taken))
    }

    #[test]
    fn whoever_drips_is_given_up_after_the_slow_start_and_whoever_keeps_the_rate_is_not() {
        assert_eq!(given_up(0, 0.0), Some(10));
        assert_eq!(given_up(5_000, 0.0), Some(20));
        assert_eq!(given_up(10_000, 0.5), None);
    }

    #[test]
    fn the_rate_rises_once_half_of_the_associations_are_taken() {
        assert_eq!(given_up(20_000, 0.5), None);
        assert!(given_up(20_000, 0.75).is_some());
        assert!(given_up(90_000, 1.0).is_some());
        assert_eq!(given_up(100_000, 1.0), None);
    }

    #[test]
    fn speed_is_not_saved_for_later_and_a_long_pdu_has_its_time() {
        let mut pace = Pace::new(10_000);
        assert!(pace.is_kept(100_000_000, SECOND, 0.0));
        assert!(!pace.is_kept(0, 11 * SECOND, 0.0));
        let mut pace = Pace::new(10_000);
        let longest = pace.patience();
        assert!(longest > 23 * SECOND && longest < 24 * SECOND);
        assert!(pace.is_kept(MAX_PDU_LENGTH as usize, longest, 0.0));
    }
}
