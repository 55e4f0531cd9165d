//! How a transfer to or from a node ends.

use case::Failure;
use cases::runner::{End, Failed};
use storage::StoreError;

use crate::node::NodeError;
use crate::parts::PartsError;
use crate::state::Pacs;

/// Why something did not pass between us and a node. Its text is for the log.
#[derive(Debug, thiserror::Error)]
#[error("{text}")]
pub(crate) struct TransferError {
    text: String,
    /// The error of the node, if it is one.
    pub(crate) node: Option<NodeError>,
    /// Whether another attempt may succeed.
    pub(crate) may_pass: bool,
    /// What clients see.
    failure: Failure,
}

impl TransferError {
    /// An error that every further attempt would meet again.
    pub(crate) fn lasting(kind: &str, text: impl Into<String>) -> Self {
        let text = text.into();
        Self {
            failure: Failure::unusable(kind, text.clone()),
            text,
            node: None,
            may_pass: false,
        }
    }

    /// An error that another attempt may not meet.
    pub(crate) fn passing(kind: &str, text: impl Into<String>) -> Self {
        Self {
            may_pass: true,
            ..Self::lasting(kind, text)
        }
    }

    /// The same without its text for clients.
    fn hidden(mut self) -> Self {
        "the images could not be stored; the log of the server has the details"
            .clone_into(&mut self.failure.detail);
        self
    }
}

impl From<NodeError> for TransferError {
    fn from(error: NodeError) -> Self {
        Self {
            node: Some(error),
            may_pass: error.may_pass(),
            ..Self::lasting(error.kind(), error.to_string())
        }
    }
}

impl From<PartsError> for TransferError {
    fn from(error: PartsError) -> Self {
        let text = error.to_string();
        match error {
            PartsError::TooLarge(_) => Self::lasting("node-failed", text),
            PartsError::Store(_) => Self::passing("node-failed", text).hidden(),
            _ => Self::passing("node-failed", text),
        }
    }
}

impl From<cases::Error> for TransferError {
    fn from(error: cases::Error) -> Self {
        let may_pass = !matches!(error, cases::Error::Failure(_));
        let cause = std::error::Error::source(&error);
        let cause = cause.map_or_else(String::new, |cause| format!(": {cause}"));
        Self {
            may_pass,
            ..Self::lasting("retrieval-failed", format!("{error}{cause}")).hidden()
        }
    }
}

impl From<StoreError> for TransferError {
    fn from(error: StoreError) -> Self {
        cases::Error::from(error).into()
    }
}

/// Ends a transfer, and notes whether the node answered.
pub(crate) fn end(
    pacs: &Pacs,
    node: &str,
    transferred: Result<(), TransferError>,
) -> Result<End, Failed> {
    let Err(error) = transferred else {
        pacs.note(node, true);
        return Ok(End::Done);
    };
    if let Some(error) = error.node {
        pacs.note(node, error.is_answer());
    }
    Err(match error.may_pass {
        true => Failed::ForNow(error.failure),
        false => Failed::Forever(error.failure),
    })
}
