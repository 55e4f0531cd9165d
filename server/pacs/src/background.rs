//! Work without a client: series are fetched and results are sent. Both are kinds of jobs, which the runner of all jobs
//! does.

use std::sync::Arc;
use std::time::Duration;

use cases::runner::{Runner, Work};

use crate::fetch::FetchSeries;
use crate::send::SendResult;
use crate::state::Pacs;

/// Running work. Dropping it stops it; another process continues after the leases end.
#[derive(Debug)]
pub struct Background(Runner);

impl Background {
    /// Starts on the current runtime. Without nodes there is nothing to do.
    pub fn start(pacs: Pacs) -> Self {
        let store = pacs.cases().store().clone();
        let mut lanes: Vec<Vec<Arc<dyn Work>>> = Vec::new();
        if !pacs.nodes().is_empty() {
            lanes.push(vec![Arc::new(FetchSeries(pacs.clone()))]);
            lanes.push(vec![Arc::new(SendResult(pacs))]);
        }
        Self(Runner::start(&store, lanes))
    }

    /// Begins nothing more, and finishes what is at hand within `grace`, or returns it.
    pub async fn shut_down(self, grace: Duration) {
        self.0.shut_down(grace).await;
    }
}
