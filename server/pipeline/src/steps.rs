//! Progress, timings and cancellation between the steps of a preparation.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use case::{Failure, Progress, Stage};

use crate::failure::cancelled;

/// The finished fraction when a stage begins, without an extraction.
fn fraction_at(stage: Stage) -> f32 {
    Progress::at(stage).fraction
}

/// The steps of one preparation.
pub(super) struct Steps<'a> {
    observe: &'a (dyn Fn(Progress) + Sync),
    cancelled: &'a AtomicBool,
    begun: Vec<(Stage, Instant)>,
}

/// The finished fraction after an extraction, which takes far longer than everything else.
const EXTRACTED: f32 = 0.8;

impl<'a> Steps<'a> {
    pub(super) fn new(observe: &'a (dyn Fn(Progress) + Sync), cancelled: &'a AtomicBool) -> Self {
        Self {
            observe,
            cancelled,
            begun: Vec::new(),
        }
    }

    /// Ends the previous stage and begins the next one.
    pub(super) fn begin(&mut self, stage: Stage) -> Result<(), Failure> {
        self.go_on()?;
        (self.observe)(Progress {
            stage,
            fraction: self.fraction(stage),
        });
        self.begun.push((stage, Instant::now()));
        Ok(())
    }

    /// A step within a stage begins.
    pub(super) fn go_on(&self) -> Result<(), Failure> {
        if self.cancelled.load(Ordering::Relaxed) {
            return Err(cancelled());
        }
        Ok(())
    }

    /// The finished fraction when a stage begins.
    fn fraction(&self, stage: Stage) -> f32 {
        let has_extracted = self
            .begun
            .iter()
            .any(|&(begun, _)| begun == Stage::Extracting);
        let at = fraction_at(stage);
        if !has_extracted {
            return at;
        }
        // The later stages share the rest.
        let [first, last] = [Stage::Mask, Stage::Storing].map(fraction_at);
        EXTRACTED + (at - first) / (last - first) * (last - EXTRACTED)
    }

    /// Reports the finished fraction of the extraction.
    pub(super) fn extracted(&self, share: f32) {
        let from = fraction_at(Stage::Extracting);
        (self.observe)(Progress {
            stage: Stage::Extracting,
            fraction: from + (EXTRACTED - from) * share.clamp(0.0, 1.0),
        });
    }

    /// The flag that cancels the preparation.
    pub(super) fn cancelled(&self) -> &'a AtomicBool {
        self.cancelled
    }

    /// The wall-clock time of each stage in ms; the last one ends now.
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
    fn an_extraction_takes_most_of_the_time_and_fractions_grow_all_the_same() {
        let seen = std::sync::Mutex::new(Vec::new());
        let observe = |progress: Progress| seen.lock().unwrap().push(progress.fraction);
        let flag = AtomicBool::new(false);
        let mut steps = Steps::new(&observe, &flag);
        steps.begin(Stage::Reading).unwrap();
        steps.begin(Stage::Extracting).unwrap();
        steps.extracted(0.5);
        steps.extracted(1.0);
        for stage in &Stage::ALL[2..] {
            steps.begin(*stage).unwrap();
        }
        let seen = seen.into_inner().unwrap();
        assert!(seen.is_sorted(), "{seen:?}");
        assert_eq!(seen.last(), Some(&fraction_at(Stage::Storing)));
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
        assert_eq!(steps.begin(Stage::Closing).unwrap_err().name, "cancelled");
        assert_eq!(*seen.lock().unwrap(), [Stage::Reading, Stage::Mask]);
        let timed: Vec<_> = steps
            .timings()
            .into_iter()
            .map(|(stage, _)| stage)
            .collect();
        assert_eq!(timed, [Stage::Reading, Stage::Mask]);
    }
}
