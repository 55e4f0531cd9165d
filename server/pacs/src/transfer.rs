//! How a transfer to or from a node ends.

use case::Failure;
use cases::runner::{End, Failed};

use crate::node::NodeError;
use crate::state::Pacs;

/// Why something did not pass between us and a node.
pub(crate) trait TransferError {
    /// The error of the node, if it is one.
    fn of_node(&self) -> Option<NodeError>;

    /// Whether another attempt may succeed.
    fn may_pass(&self) -> bool;

    /// What clients see.
    fn into_failure(self) -> Failure;
}

/// Ends a transfer, and notes whether the node answered.
pub(crate) fn end<E: TransferError>(
    pacs: &Pacs,
    node: &str,
    transferred: Result<(), E>,
) -> Result<End, Failed> {
    let Err(error) = transferred else {
        pacs.note(node, true);
        return Ok(End::Done);
    };
    if let Some(error) = error.of_node() {
        pacs.note(node, error.is_answer());
    }
    Err(match error.may_pass() {
        true => Failed::ForNow(error.into_failure()),
        false => Failed::Forever(error.into_failure()),
    })
}
