//! Errors of confined processes.

use case::Failure;

/// Why a process gave no values.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// What is wrong with the input, or how the process died.
    #[error(transparent)]
    Failure(#[from] Failure),
    /// The process was ended by a signal that was meant for the server, which is stopping.
    #[error("the process was ended with the server")]
    Interrupted,
    /// The process could not be run. The reason is in the log.
    #[error("the process could not be run")]
    NotRun,
}
