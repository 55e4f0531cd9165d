//! The interface of the rows of results.

use super::{pins, results};
use crate::arrivals::{ArrivalCursor, TransferQuery, Uid};
use crate::results::{NewResult, ResultSeries, SentResult};
use crate::rows::{Pinned, Referred};
use crate::{ObjectName, Store, StoreError};
use case::JobKind;
use case::images::Image;

impl Store {
    /// Queues a result for its node, and turns the pin of its object into a reference. A result that was sent to the node
    /// before, or could not be, is sent there again with its first object; one that still waits is left as it is.
    pub(crate) async fn insert_result(
        &self,
        new: &NewResult,
        job: JobKind,
        pinned: &Pinned,
    ) -> Result<Referred<SentResult>, StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        if !pins::consume(&mut transaction, pinned).await? {
            return Ok(Referred::PinLost);
        }
        let queued = results::queue(&mut transaction, new, job, now).await?;
        transaction.commit().await?;
        Ok(Referred::Done(queued))
    }

    /// Makes a result of another store as it is there, whose layers are made of these images, and turns the pin of its object into a reference; one that was on
    /// its way waits again. `false`, and nothing has changed, if the pin is gone or its case is not here.
    pub(crate) async fn write_copied_result(
        &self,
        result: &SentResult,
        made_of: &[Image],
        pinned: &Pinned,
    ) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        if !transaction.has_case(&result.case.to_string()).await?
            || !pins::consume(&mut transaction, pinned).await?
        {
            return Ok(false);
        }
        results::write_copied(&mut transaction, result, made_of, now).await?;
        transaction.commit().await?;
        Ok(true)
    }

    /// At most `limit` results after a cursor, newest first, and the cursor of the next page.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn results(
        &self,
        query: &TransferQuery,
        after: Option<&ArrivalCursor>,
        limit: usize,
    ) -> Result<(Vec<SentResult>, Option<ArrivalCursor>), StoreError> {
        let mut connection = self.rows().connect().await?;
        results::page(&mut connection, query, after, limit).await
    }

    /// A result.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn result(&self, id: &str) -> Result<Option<SentResult>, StoreError> {
        results::one(&mut self.rows().connect().await?, id).await
    }

    /// The object of a result that was queued before, for any node.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn object_of_result(&self, instance: &Uid) -> Result<Option<ObjectName>, StoreError> {
        results::of_instance(&mut self.rows().connect().await?, instance).await
    }

    /// The results of a study and their series, each once, the first one first. Those that do not count any more are among them.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn results_of(&self, study: &Uid) -> Result<Vec<(Uid, ResultSeries)>, StoreError> {
        results::of_study(&mut self.rows().connect().await?, study).await
    }
}
