//! Why a case cannot be prepared, without the words of any protocol.

use serde::{Deserialize, Serialize};

/// Why an input cannot be prepared, in words that a client may read: no paths, nothing of the patient.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[error("{detail}")]
pub struct Failure {
    /// A stable name in kebab case, such as `mask-missing`.
    pub name: String,
    /// What kind of failure it is, from which each protocol makes its own number.
    pub kind: FailureKind,
    /// One plain sentence.
    pub detail: String,
}

/// The kinds of failures that clients treat differently.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FailureKind {
    /// The bytes are in no format that is read.
    NotRecognised,
    /// The input exceeds a limit.
    TooLarge,
    /// The input is understood and cannot be used.
    Unusable,
    /// This installation lacks what is asked for.
    NotSupported,
    /// Memory is short at the moment; the same input may succeed later.
    OutOfMemory,
    /// The preparation was stopped on purpose.
    Cancelled,
    /// The program or its store is at fault, not the input.
    Internal,
}

impl FailureKind {
    /// Every kind.
    pub const ALL: [Self; 7] = [
        Self::NotRecognised,
        Self::TooLarge,
        Self::Unusable,
        Self::NotSupported,
        Self::OutOfMemory,
        Self::Cancelled,
        Self::Internal,
    ];
}

impl Failure {
    /// A failure of a kind.
    pub fn new(kind: FailureKind, name: &str, detail: impl Into<String>) -> Self {
        Self {
            name: name.to_owned(),
            kind,
            detail: detail.into(),
        }
    }

    /// The input is understood and cannot be used.
    pub fn unusable(name: &str, detail: impl Into<String>) -> Self {
        Self::new(FailureKind::Unusable, name, detail)
    }

    /// The uploaded files themselves cannot be read back.
    pub fn source_damaged() -> Self {
        Self::new(
            FailureKind::Internal,
            "source-damaged",
            "the stored upload is damaged; upload the volume again",
        )
    }
}
