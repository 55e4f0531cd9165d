//! What the time is: the system's, or a test's.

use std::fmt;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use jiff::Timestamp;

/// Tells the time.
#[derive(Clone)]
pub struct Clock(Arc<dyn Fn() -> Timestamp + Send + Sync>);

impl Clock {
    /// The system's clock.
    pub fn system() -> Self {
        Self(Arc::new(Timestamp::now))
    }

    /// A clock that stands still until it is moved.
    pub fn by_hand(start: Timestamp) -> (Self, HandOfClock) {
        let time = Arc::new(Mutex::new(start));
        let hand = HandOfClock(time.clone());
        (Self(Arc::new(move || *super::lock(&time))), hand)
    }

    /// The time.
    pub fn now(&self) -> Timestamp {
        (self.0)()
    }
}

impl fmt::Debug for Clock {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "Clock({})", self.now())
    }
}

/// Moves a clock made by [`Clock::by_hand`].
#[derive(Debug, Clone)]
pub struct HandOfClock(Arc<Mutex<Timestamp>>);

impl HandOfClock {
    /// Moves it forward.
    pub fn advance(&self, by: Duration) {
        *super::lock(&self.0) += by;
    }
}
