//! How a command ended.

use std::fmt::Display;
use std::process::ExitCode;

use crate::case::Failure;
use crate::config::ConfigError;
use crate::problem::AppError;
use crate::state::StartError;
use crate::store::StoreError;

/// The exit status of a command that failed: 2 as every command line has it, the others from BSD's `sysexits.h`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ExitStatus {
    /// The command line is not right.
    Usage = 2,
    /// The input cannot be used.
    BadInput = 65,
    /// The input is not there.
    NoInput = 66,
    /// Something that is needed is taken or busy.
    Unavailable = 69,
    /// A fault of the program.
    Internal = 70,
    /// The output cannot be written.
    CannotCreate = 73,
    /// The store or its disk failed.
    InputOutput = 74,
    /// The configuration is not right.
    Config = 78,
}

impl From<ExitStatus> for ExitCode {
    fn from(status: ExitStatus) -> Self {
        Self::from(status as u8)
    }
}

/// Why a command failed, in one plain sentence.
#[derive(Debug)]
pub(super) struct CliError {
    pub(super) status: ExitStatus,
    pub(super) message: String,
}

impl CliError {
    pub(super) fn new(status: ExitStatus, message: impl Display) -> Self {
        Self {
            status,
            message: message.to_string(),
        }
    }
}

impl From<Failure> for CliError {
    fn from(failure: Failure) -> Self {
        let status = match failure.status {
            500.. => ExitStatus::Internal,
            _ => ExitStatus::BadInput,
        };
        let hint = match failure.kind.as_str() {
            "mask-missing" => " (on the command line: --mask FILE)",
            _ => "",
        };
        Self::new(status, format!("{}{hint}", failure.detail))
    }
}

impl From<StoreError> for CliError {
    fn from(error: StoreError) -> Self {
        let status = match error {
            StoreError::QueueFull => ExitStatus::Unavailable,
            _ => ExitStatus::InputOutput,
        };
        let cause = std::error::Error::source(&error).map(|cause| format!(": {cause}"));
        Self::new(status, format!("{error}{}", cause.unwrap_or_default()))
    }
}

impl From<ConfigError> for CliError {
    fn from(error: ConfigError) -> Self {
        Self::new(ExitStatus::Config, error)
    }
}

impl From<StartError> for CliError {
    fn from(error: StartError) -> Self {
        match error {
            StartError::Config(error) => error.into(),
            StartError::Store(error) => {
                let error = Self::from(error);
                let message = format!("the store cannot be opened: {}", error.message);
                Self { message, ..error }
            }
            error @ StartError::Network(_) => Self::new(ExitStatus::Config, error),
            error @ StartError::Threads(_) => Self::new(ExitStatus::Unavailable, error),
        }
    }
}

impl From<AppError> for CliError {
    fn from(error: AppError) -> Self {
        let status = match &error {
            AppError::Query { .. } | AppError::NotACaseId => ExitStatus::Usage,
            AppError::NoSuchCase => ExitStatus::NoInput,
            AppError::Failure(failure) => return failure.clone().into(),
            AppError::NotReady { .. } | AppError::Busy => ExitStatus::Unavailable,
            AppError::Geometry(_) => ExitStatus::BadInput,
            AppError::Store(_) => ExitStatus::InputOutput,
            _ => ExitStatus::Internal,
        };
        Self::new(status, error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unusable_input_is_told_from_a_fault_of_the_program() {
        let failure = |status| Failure {
            kind: "kind".to_owned(),
            detail: "what is wrong".to_owned(),
            status,
        };
        assert_eq!(CliError::from(failure(422)).status, ExitStatus::BadInput);
        assert_eq!(CliError::from(failure(500)).status, ExitStatus::Internal);
        assert_eq!(CliError::from(failure(422)).message, "what is wrong");
    }
}
