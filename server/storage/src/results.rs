//! Results that are sent to a node of the PACS. Each is a DICOM object that is durable before the request for it is
//! acknowledged, so every attempt sends the same bytes.

use bytes::Bytes;
use case::{CaseId, Failure, ObjectKind};
use jiff::Timestamp;

use super::arrivals::{TransferState, Uid};
use super::{ObjectName, PIN_ATTEMPTS, Store, StoreError};

/// The series of a result, which has no other instance.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ResultSeries {
    /// The class of the result.
    pub sop_class_uid: Uid,
    /// The series.
    pub series_uid: Uid,
    /// Its number in the study.
    pub number: u32,
    /// What viewers show in their list.
    pub description: String,
}

/// A result that a search finds.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct HeldResult {
    /// The result.
    pub instance: Uid,
    /// Its series.
    pub series: ResultSeries,
    /// The object with its file.
    pub object: ObjectName,
}

/// A result to be sent.
#[derive(Debug, Clone, PartialEq)]
pub struct NewResult {
    /// The case that it was made from.
    pub case: CaseId,
    /// The name of the node.
    pub node: String,
    /// Its study.
    pub study: Uid,
    /// Its series.
    pub series: ResultSeries,
    /// The result.
    pub instance: Uid,
    /// The digest of its file, which is an object of the kind `result`.
    pub digest: blake3::Hash,
}

impl NewResult {
    /// The object with its file.
    pub fn object(&self) -> ObjectName {
        object(self.digest)
    }
}

pub(super) fn object(digest: blake3::Hash) -> ObjectName {
    ObjectName {
        kind: ObjectKind::Result,
        digest,
    }
}

/// A result that is sent, or was.
#[derive(Debug, Clone, PartialEq)]
pub struct SentResult {
    /// Its name in addresses: 32 hexadecimal digits without a meaning.
    pub id: String,
    /// The case that it was made from.
    pub case: CaseId,
    /// The name of the node.
    pub node: String,
    /// Its study.
    pub study: Uid,
    /// Its series.
    pub series: ResultSeries,
    /// The result.
    pub instance: Uid,
    /// The object with its file.
    pub object: ObjectName,
    /// How far it is.
    pub state: TransferState,
    /// The reason, if it failed.
    pub reason: Option<Failure>,
    /// When it was first requested.
    pub created_at: Timestamp,
    /// The number of its lease.
    pub fence: i64,
    /// Leases since it was last requested.
    pub attempts: u32,
}

impl Store {
    /// Keeps a result and queues it for its node. Afterwards it is durable. The operation completes even if the caller
    /// drops the future.
    ///
    /// # Errors
    /// If the rows or the objects cannot be written, or there is no such case.
    pub async fn queue_result(
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
        for _ in 0..PIN_ATTEMPTS {
            let pinned = self.pin([new.object()]).await?;
            let written = self.objects().put_file(&new.object(), &spooled).await;
            let queued = match written {
                Ok(()) => self.insert_result(new, &pinned).await,
                Err(error) => Err(error.into()),
            };
            match queued {
                Ok(Some(queued)) => return Ok(queued),
                Ok(None) => self.abandon(&pinned).await,
                Err(error) => {
                    self.abandon(&pinned).await;
                    return Err(error);
                }
            }
        }
        Err(StoreError::Rows(
            "an object was removed repeatedly while it was written".into(),
        ))
    }
}
