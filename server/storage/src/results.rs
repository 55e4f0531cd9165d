//! Results that are sent to a node of the PACS. Each is a DICOM object that is durable before the request for it is
//! acknowledged, so every attempt sends the same bytes.

use bytes::Bytes;
use case::images::Closed;
use case::{CaseId, JobKind, LayerId, ObjectKind};
use jiff::Timestamp;

use super::arrivals::Uid;
use super::jobs::Job;
use super::pinned::Writing;
use super::rows::Pinned;
use super::{ObjectName, Store, StoreError};

/// The series of a result, which has no other instance.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ResultSeries {
    /// The class of the result.
    pub sop_class_uid: Uid,
    pub series_uid: Uid,
}

/// A result to be sent.
#[derive(Debug, Clone, PartialEq)]
pub struct NewResult {
    /// The case that it was made from.
    pub case: CaseId,
    /// The name of the node.
    pub node: String,
    pub study: Uid,
    pub series: ResultSeries,
    /// The result.
    pub instance: Uid,
    /// The layers of the case that it shows, or may show.
    pub layers: Vec<LayerId>,
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

/// Why a result that was sent does not count any more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NotValid {
    /// A rejection note of ours has withdrawn it.
    Withdrawn,
    /// Its case, or a layer that it shows or may show, is closed.
    Closed(Closed),
}

impl NotValid {
    /// The word in answers.
    pub fn name(self) -> &'static str {
        match self {
            Self::Withdrawn => "withdrawn",
            Self::Closed(_) => "closed",
        }
    }

    /// The reason as a sentence without its end.
    pub fn sentence(self) -> String {
        match self {
            Self::Withdrawn => "it was withdrawn by a rejection note".to_owned(),
            Self::Closed(why) => format!(
                "it is closed: {}; request it again of what the PACS has now",
                why.sentence()
            ),
        }
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
    pub study: Uid,
    pub series: ResultSeries,
    /// The result.
    pub instance: Uid,
    /// The object with its file.
    pub object: ObjectName,
    /// The layers of the case that it shows, or may show.
    pub layers: Vec<LayerId>,
    /// When it was first requested.
    pub created_at: Timestamp,
    /// Why it does not count any more.
    pub not_valid: Option<NotValid>,
    /// The job that sends it, or did.
    pub job: Option<Job>,
}

impl Store {
    /// Keeps a result and queues the job of this kind that sends it, whose key is the id of the result. Afterwards it is
    /// durable. The operation completes even if the caller
    /// drops the future.
    ///
    /// # Errors
    /// If the rows or the objects cannot be written, or there is no such case.
    pub async fn queue_result(
        &self,
        new: NewResult,
        file: Bytes,
        job: JobKind,
    ) -> Result<SentResult, StoreError> {
        let store = self.clone();
        tokio::spawn(async move { store.queue_result_now(&new, file, job).await }).await?
    }

    async fn queue_result_now(
        &self,
        new: &NewResult,
        file: Bytes,
        job: JobKind,
    ) -> Result<SentResult, StoreError> {
        let spooled = self.spool_all(file).await?;
        let object = Writing::File(new.object(), &spooled);
        let insert = |pinned: Pinned| async move { self.insert_result(new, job, &pinned).await };
        let queued = self.with_pinned(&[object], insert).await?;
        self.signals().queued();
        Ok(queued)
    }
}
