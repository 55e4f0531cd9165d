//! The vocabulary of jobs: work that one process at a time does, and that is tried so many times.

use strum::{EnumString, IntoStaticStr};

use crate::{Failure, FailureKind};

/// A kind of job. Whoever does the work names its kind. The store knows those of its own items; of all others, it knows the word alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct JobKind {
    name: &'static str,
    noun: &'static str,
}

impl JobKind {
    pub const PREPARE: Self = Self::new("prepare", "preparation");
    /// Prepares a layer of a ready case.
    pub const LAYER: Self = Self::new("layer", "preparation");
    /// Computes the maps of a ready case.
    pub const MAPS: Self = Self::new("maps", "computation");
    /// Makes the derived objects of a ready case again.
    pub const REBUILD: Self = Self::new("rebuild", "preparation");

    /// Another kind, with its word in rows, and what such work is called.
    pub const fn new(name: &'static str, noun: &'static str) -> Self {
        Self { name, noun }
    }

    /// Its word in rows, logs and metrics.
    pub fn name(self) -> &'static str {
        self.name
    }

    /// What the work is called in failures.
    pub fn noun(self) -> &'static str {
        self.noun
    }
}

/// The state of a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, EnumString, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
pub enum JobState {
    Queued,
    /// A process is at it.
    Running,
    Done,
    /// It failed, for a reason.
    Failed,
}

impl JobState {
    /// The word in rows and answers.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// What a word means.
    pub fn from_name(name: &str) -> Option<Self> {
        name.parse().ok()
    }

    /// Whether it will not change by itself any more.
    pub fn has_ended(self) -> bool {
        matches!(self, Self::Done | Self::Failed)
    }
}

/// The reason of an attempt during which the store failed: nothing is said about what the job is about.
pub const STORE_FAILED: &str = "store-failed";

impl Failure {
    /// The end of a job that was tried as often as it may be: the reason of the last attempt, or, if its process ended
    /// each time without one, that it was interrupted.
    pub fn after_attempts(kind: JobKind, attempts: u32, last: Option<Self>) -> Self {
        match last {
            Some(last) => Self {
                detail: format!("failed after {attempts} attempts: {}", last.detail),
                ..last
            },
            None => Self::new(
                FailureKind::Internal,
                &format!("{}-interrupted", kind.noun()),
                format!(
                    "failed after {attempts} attempts: the program ended during each of them; request it again, or send the input again"
                ),
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_state_is_found_by_its_word() {
        for state in [
            JobState::Queued,
            JobState::Running,
            JobState::Done,
            JobState::Failed,
        ] {
            assert_eq!(JobState::from_name(state.name()), Some(state));
        }
        assert_eq!(JobState::from_name("paused"), None);
    }

    #[test]
    fn the_last_reason_is_told_with_the_number_of_attempts() {
        let last = Failure::new(FailureKind::OutOfMemory, "too-little", "not enough memory");
        let failure = Failure::after_attempts(JobKind::MAPS, 30, Some(last));
        assert_eq!(failure.name, "too-little");
        assert_eq!(
            failure.detail,
            "failed after 30 attempts: not enough memory"
        );
        let failure = Failure::after_attempts(JobKind::PREPARE, 30, None);
        assert_eq!(failure.name, "preparation-interrupted");
        assert!(failure.detail.contains("30 attempts"));
    }
}
