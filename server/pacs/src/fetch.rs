//! Fetches the series that were requested, one after the other.

use std::time::Duration;

use case::Failure;
use cases::Error;
use storage::arrivals::{ArrivalSource, Retrieval, TransferEnd};
use storage::{Spooled, StoreError};

use cases::dicom::InstanceIdentity;

use crate::node::{Node, NodeError, WebNode};
use crate::parts::{Parts, PartsError, is_dicom};
use crate::state::Pacs;

/// The lease of a retrieval, which is renewed with every batch of images.
const LEASE: Duration = Duration::from_secs(300);

/// Images that are made durable together.
const BATCH: usize = 32;

/// How often to try.
const MAX_ATTEMPTS: u32 = 5;

/// How long to wait before the next attempt.
const RETRY_AFTER: Duration = Duration::from_secs(20);

/// Fetches the series that was requested first; `false` if there is none.
pub(crate) async fn next(pacs: &Pacs) -> Result<bool, StoreError> {
    let store = pacs.cases().store();
    let Some(retrieval) = store.lease_retrieval(LEASE).await? else {
        return Ok(false);
    };
    let fetched = fetch(pacs, &retrieval).await;
    match &fetched {
        Ok(()) => pacs.note(&retrieval.node, true),
        Err(FetchError::Node(error)) => pacs.note(&retrieval.node, error.is_answer()),
        Err(_) => {}
    }
    let fetched = match fetched {
        Ok(()) => {
            tracing::info!(
                retrieval = retrieval.id,
                node = retrieval.node,
                "a series was fetched"
            );
            TransferEnd::Done
        }
        Err(FetchError::Lost) => return Ok(true),
        Err(error) if error.may_pass() && retrieval.attempts < MAX_ATTEMPTS => {
            tracing::warn!(retrieval = retrieval.id, node = retrieval.node, %error, "a series will be fetched later");
            TransferEnd::Later(RETRY_AFTER)
        }
        Err(error) => {
            tracing::warn!(retrieval = retrieval.id, node = retrieval.node, %error, "a series cannot be fetched");
            TransferEnd::Failed(error.into_failure())
        }
    };
    store.end_retrieval(&retrieval, &fetched).await?;
    Ok(true)
}

/// Why a series was not fetched.
#[derive(Debug, thiserror::Error)]
enum FetchError {
    #[error("no node of the configuration has this name and a `url` any more")]
    NoSuchNode,
    #[error(transparent)]
    Node(#[from] NodeError),
    #[error(transparent)]
    Parts(#[from] PartsError),
    #[error(transparent)]
    Cases(#[from] Error),
    #[error("the node sent nothing that is an MR or CT image of this series")]
    NoImages,
    #[error("the node sent {received} of {expected} images")]
    Incomplete { received: usize, expected: usize },
    #[error("another process fetches it")]
    Lost,
}

impl From<StoreError> for FetchError {
    fn from(error: StoreError) -> Self {
        Error::from(error).into()
    }
}

impl FetchError {
    fn may_pass(&self) -> bool {
        match self {
            Self::Node(error) => error.may_pass(),
            Self::Parts(PartsError::TooLarge(_)) | Self::NoSuchNode | Self::NoImages => false,
            Self::Cases(Error::Failure(_)) => false,
            Self::Parts(_) | Self::Cases(_) | Self::Incomplete { .. } | Self::Lost => true,
        }
    }

    fn into_failure(self) -> Failure {
        let kind = match &self {
            Self::NoSuchNode => "no-such-node",
            Self::Node(error) => error.kind(),
            Self::Parts(_) | Self::Incomplete { .. } => "node-failed",
            Self::NoImages => "no-images",
            Self::Cases(_) | Self::Lost => "retrieval-failed",
        };
        // Messages of the store may contain paths.
        let detail = match &self {
            Self::Cases(_) | Self::Parts(PartsError::Store(_)) => {
                "the images could not be stored; the log of the server has the details".to_owned()
            }
            other => other.to_string(),
        };
        Failure::unusable(kind, detail)
    }
}

async fn fetch(pacs: &Pacs, retrieval: &Retrieval) -> Result<(), FetchError> {
    let node = pacs.node(&retrieval.node).and_then(Node::web);
    let node = node.ok_or(FetchError::NoSuchNode)?;
    let uids = &retrieval.uids;
    let expected = node.count(uids).await?;
    let mut images = Images {
        pacs,
        retrieval,
        expected,
        batch: Vec::new(),
        received: 0,
    };
    images.read(node).await?;
    let received = images.received;
    match expected {
        _ if received == 0 => return Err(FetchError::NoImages),
        Some(expected) if received < expected => {
            return Err(FetchError::Incomplete { received, expected });
        }
        _ => {}
    }
    // All that the node has is here: the series need not wait.
    let store = pacs.cases().store();
    store.expect(uids, received).await?;
    Ok(())
}

struct Images<'a> {
    pacs: &'a Pacs,
    retrieval: &'a Retrieval,
    expected: Option<usize>,
    /// Read, and not durable yet.
    batch: Vec<(InstanceIdentity, Spooled)>,
    received: usize,
}

impl Images<'_> {
    async fn read(&mut self, node: &WebNode) -> Result<(), FetchError> {
        let (boundary, body) = node.series(&self.retrieval.uids).await?;
        let mut parts = Parts::new(body, &boundary, *self.pacs.limits());
        while let Some(kind) = parts.next().await? {
            if !is_dicom(kind.as_deref()) {
                parts.skip().await?;
                continue;
            }
            let Some(file) = parts.spool(self.pacs.cases().store()).await? else {
                return Err(PartsError::TooLarge(cases::MAX_INSTANCE_BYTES).into());
            };
            let identity = self.pacs.cases().headers.read(&file).await?;
            if identity.uids == self.retrieval.uids && identity.is_image {
                self.batch.push((identity, file));
            }
            if self.batch.len() == BATCH {
                self.flush().await?;
            }
        }
        self.flush().await
    }

    async fn flush(&mut self) -> Result<(), FetchError> {
        let batch = std::mem::take(&mut self.batch);
        let count = batch.len();
        if count > 0 {
            let source = ArrivalSource::Retrieval;
            self.pacs.cases().receive(batch, source).await?;
        }
        self.received += count;
        let store = self.pacs.cases().store();
        let progress = store.note_progress(self.retrieval, self.received, self.expected, LEASE);
        match progress.await? {
            true => Ok(()),
            false => Err(FetchError::Lost),
        }
    }
}
