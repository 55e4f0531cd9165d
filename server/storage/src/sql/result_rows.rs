//! The interface of the rows of results.

use std::time::Duration;

use async_trait::async_trait;

use super::connection::microseconds;
use super::{SqlRows, pins, results};
use crate::arrivals::{ArrivalCursor, TransferEnd, TransferQuery, Uid};
use crate::results::{HeldResult, NewResult, SentResult};
use crate::rows::{Pinned, ResultRows};
use crate::{ObjectName, StoreError};

#[async_trait]
impl ResultRows for SqlRows {
    async fn queue_result(
        &self,
        new: &NewResult,
        pinned: &Pinned,
    ) -> Result<Option<SentResult>, StoreError> {
        let (mut transaction, now) = self.write().await?;
        if !pins::consume(&mut transaction, pinned).await? {
            return Ok(None);
        }
        let queued = results::queue(&mut transaction, new, now).await?;
        transaction.commit().await?;
        Ok(Some(queued))
    }

    async fn adopt_result(&self, result: &SentResult, pinned: &Pinned) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.write().await?;
        if !transaction.has_case(&result.case.to_string()).await?
            || !pins::consume(&mut transaction, pinned).await?
        {
            return Ok(false);
        }
        results::adopt(&mut transaction, result, now).await?;
        transaction.commit().await?;
        Ok(true)
    }

    async fn results(
        &self,
        query: &TransferQuery,
        after: Option<&ArrivalCursor>,
        limit: usize,
    ) -> Result<(Vec<SentResult>, Option<ArrivalCursor>), StoreError> {
        results::page(&mut self.database.connect().await?, query, after, limit).await
    }

    async fn result(&self, id: &str) -> Result<Option<SentResult>, StoreError> {
        results::one(&mut self.database.connect().await?, id).await
    }

    async fn object_of_result(&self, instance: &Uid) -> Result<Option<ObjectName>, StoreError> {
        results::of_instance(&mut self.database.connect().await?, instance).await
    }

    async fn results_of(&self, study: &Uid) -> Result<Vec<HeldResult>, StoreError> {
        results::of_study(&mut self.database.connect().await?, study).await
    }

    async fn lease_result(&self, lease: Duration) -> Result<Option<SentResult>, StoreError> {
        // Most queries find nothing and must not wait for writers.
        let mut reader = self.database.connect().await?;
        let now = self.now(&mut reader).await?;
        if results::available(&mut reader, now).await?.is_none() {
            return Ok(None);
        }
        drop(reader);
        let (mut transaction, now) = self.write().await?;
        let Some(id) = results::available(&mut transaction, now).await? else {
            return Ok(None);
        };
        let until = now + microseconds(lease);
        let leased = results::lease(&mut transaction, &id, until).await?;
        transaction.commit().await?;
        Ok(leased)
    }

    async fn end_result(&self, result: &SentResult, end: &TransferEnd) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.write().await?;
        let ended = results::end(&mut transaction, result, end, now).await?;
        transaction.commit().await?;
        Ok(ended)
    }
}
