//! Progress, timings and cancellation between the steps of a preparation.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use super::failure::cancelled;
use crate::case::{Failure, Progress, Stage};

/// How much of a preparation is done when a stage begins: from the timings of a head of 256³.
fn fraction_at(stage: Stage) -> f32 {
    match stage {
        Stage::Reading => 0.0,
        Stage::Extracting => 0.04,
        Stage::Mask => 0.18,
        Stage::Closing => 0.24,
        Stage::Distance => 0.32,
        Stage::Core => 0.36,
        Stage::Forest => 0.40,
        Stage::Mesh => 0.80,
        Stage::Storing => 0.90,
    }
}

impl Progress {
    /// The progress of a preparation that begins a stage.
    pub fn at(stage: Stage) -> Self {
        Self {
            stage,
            fraction: fraction_at(stage),
        }
    }
}

/// The steps of one preparation.
pub(super) struct Steps<'a> {
    observe: &'a (dyn Fn(Progress) + Sync),
    cancelled: &'a AtomicBool,
    begun: Vec<(Stage, Instant)>,
}

impl<'a> Steps<'a> {
    pub(super) fn new(observe: &'a (dyn Fn(Progress) + Sync), cancelled: &'a AtomicBool) -> Self {
        Self {
            observe,
            cancelled,
            begun: Vec::new(),
        }
    }

    /// The step before is done and the next begins.
    pub(super) fn begin(&mut self, stage: Stage) -> Result<(), Failure> {
        if self.cancelled.load(Ordering::Relaxed) {
            return Err(cancelled());
        }
        (self.observe)(Progress::at(stage));
        self.begun.push((stage, Instant::now()));
        Ok(())
    }

    /// Wall time of each step in ms; the last one ends now.
    pub(super) fn timings(&self) -> Vec<(Stage, f64)> {
        let now = Instant::now();
        let ends = self
            .begun
            .iter()
            .skip(1)
            .map(|&(_, begin)| begin)
            .chain([now]);
        let took = |((stage, begin), end): (&(Stage, Instant), Instant)| {
            (*stage, (end - *begin).as_secs_f64() * 1000.0)
        };
        self.begun.iter().zip(ends).map(took).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fractions_grow_from_stage_to_stage() {
        let fractions = Stage::ALL.map(fraction_at);
        assert!(fractions.is_sorted() && fractions[0] == 0.0 && fractions[8] < 1.0);
    }

    #[test]
    fn each_step_is_told_and_timed_and_none_begins_after_a_cancellation() {
        let seen = std::sync::Mutex::new(Vec::new());
        let observe = |progress: Progress| seen.lock().unwrap().push(progress.stage);
        let flag = AtomicBool::new(false);
        let mut steps = Steps::new(&observe, &flag);
        steps.begin(Stage::Reading).unwrap();
        steps.begin(Stage::Mask).unwrap();
        flag.store(true, Ordering::Relaxed);
        assert_eq!(steps.begin(Stage::Closing).unwrap_err().kind, "cancelled");
        assert_eq!(*seen.lock().unwrap(), [Stage::Reading, Stage::Mask]);
        let timed: Vec<_> = steps
            .timings()
            .into_iter()
            .map(|(stage, _)| stage)
            .collect();
        assert_eq!(timed, [Stage::Reading, Stage::Mask]);
    }
}
