//! Work without a client: series are fetched and results are sent. Both are kinds of jobs, which the runner of all jobs
//! does.

use std::sync::Arc;

use case::Failure;
use cases::runner::{End, Failed, Runner, Work};

use crate::fetch::FetchSeries;
use crate::node::NodeError;
use crate::send::SendResult;
use crate::state::Pacs;

/// Starts to fetch series and to send results on the current runtime. Without nodes there is nothing to do.
pub fn start_transfers(pacs: Pacs) -> Runner {
    let store = pacs.store().clone();
    let mut lanes: Vec<Vec<Arc<dyn Work>>> = Vec::new();
    if !pacs.nodes().is_empty() {
        lanes.push(vec![Arc::new(FetchSeries(pacs.clone()))]);
        lanes.push(vec![Arc::new(SendResult(pacs))]);
    }
    Runner::start(&store, lanes)
}

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
