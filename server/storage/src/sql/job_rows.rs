//! The transactions of jobs.

use std::time::Duration;

use case::{Failure, JobKind};

use super::claims::{self, Wanted};
use super::connection::microseconds;
use super::jobs;
use crate::jobs::{Claim, Job, JobQuery, NewJob, Release};
use crate::{ListCursor, Store, StoreError};

impl Store {
    /// Queues a job, unless there is an open one of its kind and key; returns the open one. `None` if there is no such
    /// case.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub async fn enqueue(&self, new: &NewJob) -> Result<Option<Job>, StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        if let Some(case) = &new.case
            && !transaction.has_case(&case.to_string()).await?
        {
            return Ok(None);
        }
        jobs::enqueue(&mut transaction, new, now).await?;
        let job = jobs::latest(&mut transaction, new.kind, &new.key).await?;
        transaction.commit().await?;
        self.signals().queued();
        Ok(job)
    }

    /// A job; `None` if there is none, or if it ended some days ago.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn job(&self, id: &str) -> Result<Option<Job>, StoreError> {
        jobs::one(&mut self.rows().connect().await?, id).await
    }

    /// The latest job of a kind and a key.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn latest_job(&self, kind: JobKind, key: &str) -> Result<Option<Job>, StoreError> {
        jobs::latest(&mut self.rows().connect().await?, kind, key).await
    }

    /// At most `limit` jobs after a cursor, newest first, and the cursor of the next page.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn jobs(
        &self,
        query: &JobQuery,
        after: Option<&ListCursor>,
        limit: usize,
    ) -> Result<(Vec<Job>, Option<ListCursor>), StoreError> {
        let mut connection = self.rows().connect().await?;
        jobs::page(&mut connection, query, after, limit).await
    }

    /// Forgets jobs that ended this long ago, but those that other tables keep.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub async fn forget_jobs(&self, ended: Duration) -> Result<(), StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        jobs::forget(&mut transaction, now - microseconds(ended)).await?;
        transaction.commit().await
    }

    /// The number of jobs of a kind that wait for a lease.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn waiting(&self, kind: JobKind) -> Result<usize, StoreError> {
        jobs::waiting(&mut self.rows().connect().await?, kind).await
    }

    /// Refuses one more job of a kind of the client of this store, before anything is done for it.
    ///
    /// # Errors
    /// [`StoreError::QueueFull`], or if the rows cannot be read.
    pub(crate) async fn check_room(&self, kind: JobKind) -> Result<(), StoreError> {
        let mut connection = self.rows().connect().await?;
        let now = self.rows().now(&mut connection).await?;
        let most = self.options().queue_limit;
        jobs::check_room(&mut connection, kind, most, &self.client, now).await
    }

    /// Leases the oldest job of a kind. Those with as many attempts behind them fail on the way.
    ///
    /// # Errors
    /// If the rows cannot be written, or do not belong to the objects.
    pub async fn claim(
        &self,
        kind: JobKind,
        max_attempts: u32,
    ) -> Result<Option<Claim>, StoreError> {
        let wanted = Wanted { kind, key: None };
        // Most queries find nothing and must not wait for writers.
        let mut reader = self.rows().connect().await?;
        let now = self.rows().now(&mut reader).await?;
        let found = claims::oldest_available(&mut reader, wanted, now).await?;
        drop(reader);
        if found.is_none() {
            return Ok(None);
        }
        self.check_id().await?;
        let (mut transaction, now) = self.rows().write().await?;
        let lease = self.options().lease;
        let claim = claims::claim(&mut transaction, wanted, max_attempts, lease, now).await?;
        transaction.commit_soon().await?;
        if let Some(case) = claim.as_ref().and_then(|claim| claim.case) {
            self.signals().changed(&case);
        }
        Ok(claim)
    }

    /// Renews a lease from now on and notes the progress; `false` if the lease is not ours any more.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub async fn renew(&self, claim: &Claim, progress: Option<&str>) -> Result<bool, StoreError> {
        let mut connection = self.rows().connect().await?;
        let until = self.rows().now(&mut connection).await? + microseconds(self.options().lease);
        jobs::renew(&mut connection, claim, until, progress).await
    }

    /// Returns a lease; `false` if it is not ours any more.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub async fn release(&self, claim: &Claim, release: &Release) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        let released = jobs::release(&mut transaction, claim, release, now).await?;
        transaction.commit().await?;
        self.job_changed(claim);
        Ok(released)
    }

    /// Ends a job that is done, if the lease is still ours; returns whether it was.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub async fn finish(&self, claim: &Claim) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        let is_ours = jobs::finish(&mut transaction, claim, Ok(()), now).await?;
        transaction.commit().await?;
        self.job_changed(claim);
        Ok(is_ours)
    }

    /// Makes a job failed, and with it what it is about, if the lease is still ours; returns whether it was.
    ///
    /// # Errors
    /// If the rows or the objects cannot be written. It may have failed even so; objects that nobody needs are then
    /// removed later.
    pub async fn fail(&self, claim: &Claim, failure: &Failure) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        let is_ours = jobs::finish(&mut transaction, claim, Err(failure), now).await?;
        if is_ours {
            claims::fail_item(&mut transaction, claim.kind, &claim.key, failure, now).await?;
        }
        transaction.commit().await?;
        self.job_changed(claim);
        if is_ours && claim.kind == JobKind::LAYER {
            self.collect().await?;
        }
        Ok(is_ours)
    }

    /// Queues a job, unless there is an open one, and leases it; `None` if another process has it, or it failed just now.
    pub(crate) async fn enqueue_and_claim(
        &self,
        new: &NewJob,
        max_attempts: u32,
    ) -> Result<Option<Claim>, StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        if let Some(case) = &new.case
            && !transaction.has_case(&case.to_string()).await?
        {
            return Ok(None);
        }
        jobs::enqueue(&mut transaction, new, now).await?;
        let wanted = Wanted {
            kind: new.kind,
            key: Some(&new.key),
        };
        let lease = self.options().lease;
        let claim = claims::claim(&mut transaction, wanted, max_attempts, lease, now).await?;
        transaction.commit().await?;
        Ok(claim)
    }

    pub(crate) fn job_changed(&self, claim: &Claim) {
        if let Some(case) = &claim.case {
            self.signals().changed(case);
        }
    }
}
