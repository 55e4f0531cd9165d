//! Results that are sent to a node of the PACS. Each is a DICOM object that is durable before the request for it is
//! acknowledged, so every attempt sends the same bytes.

use bytes::Bytes;
use case::images::Image;
use case::series::Uid;
use storage::Pinned;
use storage::tables::{Referred, Writing, pins};
use storage::{ListCursor, ObjectName, StoreError};

use super::{PacsStore, results};
use crate::values::{NewResult, ResultSeries, SentResult, TransferQuery};

impl PacsStore {
    /// Keeps a result and queues the job that sends it. Afterwards it is durable. The operation completes even if the caller drops the future.
    ///
    /// # Errors
    /// If the rows or the objects cannot be written, or there is no such case.
    pub(crate) async fn queue_result(
        &self,
        new: NewResult,
        file: Bytes,
    ) -> Result<SentResult, StoreError> {
        let store = self.clone();
        tokio::spawn(async move { store.queue_result_now(&new, file).await }).await?
    }

    async fn queue_result_now(
        &self,
        new: &NewResult,
        file: Bytes,
    ) -> Result<SentResult, StoreError> {
        let spooled = self.spool_all(file).await?;
        let object = Writing::File(new.object(), &spooled);
        let insert = |pinned: Pinned| async move { self.insert_result(new, &pinned).await };
        let queued = self.with_pinned(&[object], insert).await?;
        self.signals().queued();
        Ok(queued)
    }

    /// Queues a result for its node, and turns the pin of its object into a reference. A result that was sent to the node
    /// before, or could not be, is sent there again with its first object; one that still waits is left as it is.
    pub(crate) async fn insert_result(
        &self,
        new: &NewResult,
        pinned: &Pinned,
    ) -> Result<Referred<SentResult>, StoreError> {
        let (mut transaction, now) = self.write().await?;
        if !pins::consume(&mut transaction, pinned).await? {
            return Ok(Referred::PinLost);
        }
        let queued = results::queue(&mut transaction, new, now).await?;
        transaction.commit().await?;
        Ok(Referred::Done(queued))
    }

    /// Makes a result of another store as it is there, whose layers are made of these images, and turns the pin of its object into a
    /// reference; one that was on its way waits again. `false`, and nothing has changed, if the pin is gone or its case is not here.
    pub(crate) async fn write_copied_result(
        &self,
        result: &SentResult,
        made_of: &[Image],
        pinned: &Pinned,
    ) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.write().await?;
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
    pub(crate) async fn results(
        &self,
        query: &TransferQuery,
        after: Option<&ListCursor>,
        limit: usize,
    ) -> Result<(Vec<SentResult>, Option<ListCursor>), StoreError> {
        let mut connection = self.connect().await?;
        results::page(&mut connection, query, after, limit).await
    }

    /// A result.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub(crate) async fn result(&self, id: &str) -> Result<Option<SentResult>, StoreError> {
        results::one(&mut self.connect().await?, id).await
    }

    /// The object of a result that was queued before, for any node.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub(crate) async fn object_of_result(
        &self,
        instance: &Uid,
    ) -> Result<Option<ObjectName>, StoreError> {
        results::of_instance(&mut self.connect().await?, instance).await
    }

    /// The results of a study and their series, each once, the first one first. Those that do not count any more are among them.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub(crate) async fn results_of(
        &self,
        study: &Uid,
    ) -> Result<Vec<(Uid, ResultSeries)>, StoreError> {
        results::of_study(&mut self.connect().await?, study).await
    }
}
