//! Exit statuses.

use std::fmt::Display;
use std::io::ErrorKind;
use std::process::ExitCode;

use crate::config::ConfigError;
use crate::start::StartError;
use case::{Failure, FailureKind};
use cases::Error;
use pacs::settings::BadSettings;
use storage::StoreError;

/// The exit status of a failed command: 2 for an invalid command line, the others from `sysexits.h` of BSD.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ExitStatus {
    /// The command line is invalid.
    Usage = 2,
    /// The input cannot be used.
    BadInput = 65,
    /// The input does not exist.
    NoInput = 66,
    /// A needed resource is taken or busy.
    Unavailable = 69,
    /// An internal error.
    Internal = 70,
    /// The output cannot be written.
    CannotCreate = 73,
    /// The store or its disk failed.
    InputOutput = 74,
    /// The configuration is invalid, or leads to no store.
    Config = 78,
}

impl From<ExitStatus> for ExitCode {
    fn from(status: ExitStatus) -> Self {
        Self::from(status as u8)
    }
}

/// Why a command failed, in one sentence.
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
        let status = match failure.kind {
            FailureKind::Internal | FailureKind::NotSupported | FailureKind::OutOfMemory => {
                ExitStatus::Internal
            }
            FailureKind::NotRecognised
            | FailureKind::TooLarge
            | FailureKind::Unusable
            | FailureKind::Cancelled => ExitStatus::BadInput,
        };
        let hint = match failure.name.as_str() {
            "mask-missing" => " (on the command line: --mask FILE)",
            _ => "",
        };
        Self::new(status, format!("{}{hint}", failure.detail))
    }
}

impl From<StoreError> for CliError {
    fn from(error: StoreError) -> Self {
        let status = match error {
            StoreError::QueueFull(_) => ExitStatus::Unavailable,
            StoreError::NoSuchCase | StoreError::NoSuchLayer => ExitStatus::NoInput,
            StoreError::TooManyLayers | StoreError::LayerNameTaken => ExitStatus::BadInput,
            StoreError::NoStore(_)
            | StoreError::Mismatch(_)
            | StoreError::OtherUser(_)
            | StoreError::AccessDenied(_) => ExitStatus::Config,
            _ => ExitStatus::InputOutput,
        };
        let cause = std::error::Error::source(&error).map(|cause| match &error {
            StoreError::AccessDenied(_) | StoreError::ClocksDiffer(_) => error.cause(),
            _ => cause.to_string(),
        });
        let cause = cause.map(|cause| format!(": {cause}"));
        let hint = match &error {
            StoreError::Disk(cause)
                if matches!(
                    cause.kind(),
                    ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem
                ) =>
            {
                "; use a folder that this user may write (`--data`)"
            }
            _ => "",
        };
        let cause = cause.unwrap_or_default();
        Self::new(status, format!("{error}{cause}{hint}"))
    }
}

impl From<ConfigError> for CliError {
    fn from(error: ConfigError) -> Self {
        Self::new(ExitStatus::Config, error)
    }
}

impl From<BadSettings> for CliError {
    fn from(error: BadSettings) -> Self {
        Self::new(ExitStatus::Config, error)
    }
}

impl From<StartError> for CliError {
    fn from(error: StartError) -> Self {
        match error {
            StartError::Config(error) => error.into(),
            StartError::Cases(cases::StartError::Store(error)) => {
                let error = Self::from(error);
                let message = format!("the store cannot be opened: {}", error.message);
                Self { message, ..error }
            }
            error @ StartError::Cases(
                cases::StartError::Network(_) | cases::StartError::Atlas(_),
            ) => Self::new(ExitStatus::Config, error),
        }
    }
}

impl From<Error> for CliError {
    fn from(error: Error) -> Self {
        let status = match error {
            Error::Failure(failure) => return failure.into(),
            Error::Store(error) => return error.into(),
            Error::Parameter { .. } => ExitStatus::Usage,
            Error::NoSuchCase
            | Error::NoSuchLayer
            | Error::NoSuchReading
            | Error::ReadingHidden
            | Error::ReadingSigned => ExitStatus::NoInput,
            Error::NotReady { .. } | Error::LayerNotReady | Error::Busy | Error::BusyFor(_) => {
                ExitStatus::Unavailable
            }
            Error::LayerClosed(_) => ExitStatus::BadInput,
            Error::Geometry(_) | Error::MapsUndefined { .. } | Error::NoSurfaces(_) => {
                ExitStatus::BadInput
            }
            Error::Unavailable | Error::Internal => ExitStatus::Internal,
        };
        Self::new(status, error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unusable_input_is_told_from_a_fault_of_the_program() {
        let failure = |kind| Failure::new(kind, "name", "what is wrong");
        let unusable = CliError::from(failure(FailureKind::Unusable));
        assert_eq!(unusable.status, ExitStatus::BadInput);
        assert_eq!(unusable.message, "what is wrong");
        let fault = CliError::from(failure(FailureKind::Internal));
        assert_eq!(fault.status, ExitStatus::Internal);
    }
    #[test]
    fn a_folder_that_cannot_be_written_leads_to_another_one() {
        for kind in [ErrorKind::PermissionDenied, ErrorKind::ReadOnlyFilesystem] {
            let error = CliError::from(StoreError::from(std::io::Error::from(kind)));
            assert!(error.message.ends_with("(`--data`)"), "{}", error.message);
        }
        let full = StoreError::from(std::io::Error::from(ErrorKind::StorageFull));
        assert!(!CliError::from(full).message.contains("--data"));
    }
}
