//! Work without a client: series are fetched and results are sent. Both are kinds of jobs, which the runner of all jobs
//! does.

use std::sync::Arc;

use cases::runner::{Runner, Work};

use crate::fetch::FetchSeries;
use crate::send::SendResult;
use crate::state::Pacs;

/// Starts to fetch series and to send results on the current runtime. Without nodes there is nothing to do.
pub fn start_transfers(pacs: Pacs) -> Runner {
    let store = pacs.cases().store().clone();
    let mut lanes: Vec<Vec<Arc<dyn Work>>> = Vec::new();
    if !pacs.options().nodes.is_empty() {
        lanes.push(vec![Arc::new(FetchSeries(pacs.clone()))]);
        lanes.push(vec![Arc::new(SendResult(pacs))]);
    }
    Runner::start(&store, lanes)
}
