//! Errors of confined processes.

use case::Failure;

/// Why a process gave no values.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// What is wrong with the input, or how the process died.
    #[error(transparent)]
    Failure(#[from] Failure),
    /// The process could not be run. The reason is in the log.
    #[error("the process could not be run")]
    NotRun,
}
