//! How long clients may take.

use std::time::Duration;

/// How long clients and their requests may take. They are the same on every server, since nobody could choose them better; tests shorten them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Timeouts {
    /// Time for the headers of a request, and for which a connection may be idle between two.
    pub header: Duration,
    /// Time for an answer.
    pub answer: Duration,
    /// Time within which the next bytes of a body must arrive, or of an answer be received.
    pub idle: Duration,
    /// Time for a whole upload, and for a client to receive a whole answer, unless that is a stream of events.
    pub whole: Duration,
    /// Time for running requests to finish when the server stops.
    pub shutdown_grace: Duration,
}

impl Default for Timeouts {
    fn default() -> Self {
        Self {
            header: Duration::from_secs(10),
            answer: Duration::from_secs(60),
            idle: Duration::from_secs(30),
            whole: Duration::from_secs(3600),
            shutdown_grace: Duration::from_secs(20),
        }
    }
}
