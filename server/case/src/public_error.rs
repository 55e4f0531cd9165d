//! Errors that clients may see, independent of any protocol.

use std::borrow::Cow;
use std::error::Error;
use std::time::Duration;

use crate::failure::{Failure, FailureKind};

/// What clients are told if the program is at fault.
pub const INTERNAL: &str = "internal error; see the server's log for this request id";

/// What a client can do about an error, which each protocol maps to its own status.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ErrorKind {
    /// A value of the request is wrong.
    Invalid,
    /// It does not exist.
    NotFound,
    /// The state of the case does not permit it, now or ever.
    Conflict,
    /// The bytes are not in a supported format.
    NotRecognised,
    /// The input exceeds a limit.
    TooLarge,
    /// The input was read but cannot be used.
    Unusable,
    /// This installation does not support the request.
    NotSupported,
    /// The same request may succeed later.
    Unavailable,
    /// Nothing can be stored.
    Full,
    /// The program or its store is at fault.
    Internal,
}

impl From<FailureKind> for ErrorKind {
    fn from(kind: FailureKind) -> Self {
        match kind {
            FailureKind::NotRecognised => Self::NotRecognised,
            FailureKind::TooLarge => Self::TooLarge,
            FailureKind::Unusable => Self::Unusable,
            FailureKind::NotSupported => Self::NotSupported,
            FailureKind::OutOfMemory => Self::Unavailable,
            FailureKind::Cancelled => Self::Conflict,
            FailureKind::Internal => Self::Internal,
        }
    }
}

/// An error that a protocol answers with.
pub trait PublicError: Error + Send + Sync + 'static {
    /// What a client can do.
    fn kind(&self) -> ErrorKind;

    /// A stable name in kebab case.
    fn name(&self) -> Cow<'static, str>;

    /// One plain sentence for the client, without paths and patient data.
    fn sentence(&self) -> String {
        self.to_string()
    }

    /// The parameter of the request that is wrong.
    fn parameter(&self) -> Option<&str> {
        None
    }

    /// The stable name of the reason, if it is one of several.
    fn reason(&self) -> Option<String> {
        None
    }

    /// When to repeat the request.
    fn retry_after(&self) -> Option<Duration> {
        None
    }

    /// What is for the log alone.
    fn hidden_cause(&self) -> Option<&(dyn Error + 'static)> {
        None
    }
}

impl PublicError for Failure {
    fn kind(&self) -> ErrorKind {
        self.kind.into()
    }

    fn name(&self) -> Cow<'static, str> {
        self.name.clone().into()
    }
}
