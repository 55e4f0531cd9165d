//! What goes on, for whoever waits.

/// A line on standard error for everything that is measured.
#[derive(Debug, Clone, Copy)]
pub(super) struct OnStandardError;

impl measure::paper::Telling for OnStandardError {
    fn tell(&self, what: &str) {
        eprintln!("isocortex bench: {what}");
    }
}
