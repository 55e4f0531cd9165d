//! Work without a client: series are fetched and results are sent, one after the other.

use std::time::Duration;

use tokio::sync::watch;
use tokio::task::JoinSet;

use crate::state::Pacs;
use crate::{fetch, send};

/// How often to look for work.
const LOOK_EVERY: Duration = Duration::from_millis(500);

/// Running work. Dropping it stops it; another process continues after the leases end.
#[derive(Debug)]
pub struct Background {
    stopping: watch::Sender<bool>,
    tasks: JoinSet<()>,
}

#[derive(Debug, Clone, Copy)]
enum Work {
    Fetch,
    Send,
}

impl Background {
    /// Starts on the current runtime. Without nodes there is nothing to do.
    pub fn start(pacs: Pacs) -> Self {
        let stopping = watch::Sender::new(false);
        let mut tasks = JoinSet::new();
        if !pacs.nodes().is_empty() {
            for work in [Work::Fetch, Work::Send] {
                tasks.spawn(repeat(pacs.clone(), work, stopping.subscribe()));
            }
        }
        Self { stopping, tasks }
    }

    /// Begins nothing more, and finishes what is at hand within `grace`.
    pub async fn shut_down(mut self, grace: Duration) {
        self.stopping.send_replace(true);
        let all_done = async { while self.tasks.join_next().await.is_some() {} };
        let _unfinished = tokio::time::timeout(grace, all_done).await;
    }
}

async fn repeat(pacs: Pacs, work: Work, mut stop: watch::Receiver<bool>) {
    while !*stop.borrow() {
        let done = match work {
            Work::Fetch => fetch::next(&pacs).await,
            Work::Send => send::next(&pacs).await,
        };
        match done {
            Ok(true) => continue,
            Ok(false) => {}
            Err(error) => {
                let error = &error as &dyn std::error::Error;
                tracing::error!(error, ?work, "cannot take a job");
            }
        }
        tokio::select! {
            _ = stop.wait_for(|&stop| stop) => {}
            () = tokio::time::sleep(LOOK_EVERY) => {}
        }
    }
}
