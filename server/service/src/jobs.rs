//! Workers that prepare queued cases.

use std::time::Duration;

use crate::store::Store;

/// Running workers; dropping them hands their work back at its lease's end.
#[derive(Debug)]
pub struct Workers {}

impl Workers {
    /// Starts `count` workers on the current runtime.
    pub fn start(store: Store, count: usize) -> Self {
        let _ = (store, count);
        todo!()
    }

    /// Takes no more work, lets running work finish within `grace`, and hands back what is not done by then.
    pub async fn shut_down(self, grace: Duration) {
        let _ = grace;
        todo!()
    }
}
