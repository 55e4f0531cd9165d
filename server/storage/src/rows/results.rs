//! The rows of results that are sent to a node.

use std::time::Duration;

use async_trait::async_trait;

use super::terms::Pinned;
use crate::arrivals::{ArrivalCursor, TransferEnd, TransferQuery, Uid};
use crate::results::{HeldResult, NewResult, SentResult};
use crate::{ObjectName, StoreError};

/// Results, which wait to be sent or were sent.
#[async_trait]
pub trait ResultRows {
    /// Queues a result for its node, and turns the pin of its object into a reference; `None`, and nothing has changed, if
    /// the pin is gone. A result that was sent to the node before, or could not be, is sent there again with its first
    /// object; one that still waits is left as it is.
    ///
    /// # Errors
    /// Also if there is no such case.
    async fn queue_result(
        &self,
        new: &NewResult,
        pinned: &Pinned,
    ) -> Result<Option<SentResult>, StoreError>;

    /// Makes a result of another store as it is there, and turns the pin of its object into a reference; one that was on
    /// its way waits again. `false`, and nothing has changed, if the pin is gone or its case is not here.
    async fn adopt_result(&self, result: &SentResult, pinned: &Pinned) -> Result<bool, StoreError>;

    /// At most `limit` results after a cursor, newest first, and the cursor of the next page.
    async fn results(
        &self,
        query: &TransferQuery,
        after: Option<&ArrivalCursor>,
        limit: usize,
    ) -> Result<(Vec<SentResult>, Option<ArrivalCursor>), StoreError>;

    /// A result.
    async fn result(&self, id: &str) -> Result<Option<SentResult>, StoreError>;

    /// The object of a result that was queued before, for any node.
    async fn object_of_result(&self, instance: &Uid) -> Result<Option<ObjectName>, StoreError>;

    /// The results of a study, each once, in the order of their series.
    async fn results_of(&self, study: &Uid) -> Result<Vec<HeldResult>, StoreError>;

    /// Leases the result that has waited longest.
    async fn lease_result(&self, lease: Duration) -> Result<Option<SentResult>, StoreError>;

    /// Ends the lease of a result; `false` if it is not ours any more.
    async fn end_result(&self, result: &SentResult, end: &TransferEnd) -> Result<bool, StoreError>;
}
