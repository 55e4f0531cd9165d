//! Reasons why a case cannot be prepared, independent of any protocol.

use serde::{Deserialize, Serialize};

/// The name of the failure of a case with a damaged stored upload.
pub const SOURCE_DAMAGED: &str = "source-damaged";

/// The name of the reason why a job waits for a stored upload.
pub const SOURCE_MISSING: &str = "source-missing";

/// The reason why an input cannot be prepared, safe to show to clients: without paths or patient data.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[error("{detail}")]
pub struct Failure {
    /// A stable name in kebab case, such as `mask-missing`.
    pub name: String,
    /// The kind of failure, which each protocol maps to its own status.
    pub kind: FailureKind,
    /// One plain sentence.
    pub detail: String,
}

/// The kinds of failures that clients treat differently.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FailureKind {
    /// The bytes are not in a supported format.
    NotRecognised,
    /// The input exceeds a limit.
    TooLarge,
    /// The input was read but cannot be used.
    Unusable,
    /// This installation does not support the request.
    NotSupported,
    /// Memory is short; the same input may succeed later.
    OutOfMemory,
    /// The preparation was cancelled.
    Cancelled,
    /// The program or its store is at fault, not the input.
    Internal,
}

impl Failure {
    /// A failure of the given kind.
    pub fn new(kind: FailureKind, name: &str, detail: impl Into<String>) -> Self {
        Self {
            name: name.to_owned(),
            kind,
            detail: detail.into(),
        }
    }

    /// A failure of the kind [`FailureKind::Unusable`].
    pub fn unusable(name: &str, detail: impl Into<String>) -> Self {
        Self::new(FailureKind::Unusable, name, detail)
    }

    /// The failure of a case with a damaged stored upload.
    pub fn source_damaged() -> Self {
        Self::new(
            FailureKind::Internal,
            SOURCE_DAMAGED,
            "the stored upload is damaged; upload the volume again",
        )
    }

    /// Why a job waits that needs a stored upload. No case fails for it: what is not found now may be back in a moment.
    pub fn source_missing() -> Self {
        Self::new(
            FailureKind::Internal,
            SOURCE_MISSING,
            "the stored upload is missing; tell the administrator of this server",
        )
    }
}
