//! Fetches the series that were requested, one after the other.

use std::time::Duration;

use async_trait::async_trait;
use case::JobKind;
use case::series::{SeriesUids, Uid};
use cases::runner::{End, Failed, Running, Terms, Work};
use serde::{Deserialize, Serialize};
use storage::{NewJob, Spooled};

use crate::identity::InstanceIdentity;
use crate::node::{Node, WebNode};
use crate::parts::{Parts, PartsError, is_dicom};
use crate::refusal::{Refusal, Refusals};
use crate::state::Pacs;
use crate::transfer::{TransferError, end};
use crate::values::{ArrivalSource, Reception};

pub(crate) const FETCH: JobKind = JobKind::new("fetch", "retrieval");

/// The terms of a retrieval.
const TERMS: Terms = Terms {
    max_attempts: 5,
    retry_after: Duration::from_secs(20),
    longest: Duration::from_secs(3600),
};

/// Images that are made durable together.
const BATCH: usize = 32;

/// What to fetch, and from where.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Wanted {
    /// The name of the node.
    pub(crate) node: String,
    study: String,
    series: String,
}

impl Wanted {
    pub(crate) fn new(node: &str, uids: &SeriesUids) -> Self {
        Self {
            node: node.to_owned(),
            study: uids.study.as_str().to_owned(),
            series: uids.series.as_str().to_owned(),
        }
    }

    /// What a job is to fetch; `None` if it is not one of ours.
    pub(crate) fn of(payload: &str) -> Option<Self> {
        serde_json::from_str(payload).ok()
    }

    pub(crate) fn uids(&self) -> Option<SeriesUids> {
        let study = Uid::parse(&self.study)?;
        let series = Uid::parse(&self.series)?;
        Some(SeriesUids { study, series })
    }

    /// How the keys of the jobs that fetch a series begin.
    pub(crate) fn key_prefix(uids: &SeriesUids) -> String {
        format!("{} {} ", uids.study.as_str(), uids.series.as_str())
    }

    /// The job that fetches it.
    pub(crate) fn job(&self) -> NewJob {
        let key = format!("{} {} {}", self.study, self.series, self.node);
        NewJob {
            payload: serde_json::to_string(self).unwrap_or_default(),
            ..NewJob::new(FETCH, key)
        }
    }
}

/// How far a retrieval is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Received {
    /// Images so far.
    pub(crate) received: usize,
    /// How many the node says there are.
    pub(crate) expected: Option<usize>,
}

pub(crate) struct FetchSeries(pub(crate) Pacs);

#[async_trait]
impl Work for FetchSeries {
    fn kind(&self) -> JobKind {
        FETCH
    }

    fn terms(&self) -> Terms {
        TERMS
    }

    async fn run(&self, job: &Running) -> Result<End, Failed> {
        let wanted = Wanted::of(&job.claim.payload);
        let pacs = &self.0;
        let node = wanted.as_ref().map_or("", |wanted| &wanted.node);
        let fetched = fetch(pacs, job, wanted.as_ref()).await;
        match &fetched {
            Ok(()) => tracing::info!(retrieval = job.claim.id, node, "a series was fetched"),
            Err(error) => {
                tracing::warn!(retrieval = job.claim.id, node, %error, "a series was not fetched");
            }
        }
        end(pacs, node, fetched)
    }
}

/// The node sent nothing that can be used.
fn no_images() -> TransferError {
    let text = "the node sent nothing that is an MR or CT image of this series";
    TransferError::lasting("no-images", text)
}

async fn fetch(pacs: &Pacs, job: &Running, wanted: Option<&Wanted>) -> Result<(), TransferError> {
    let node = wanted.and_then(|wanted| pacs.node(&wanted.node));
    let (Some(wanted), Some(node)) = (wanted, node.and_then(Node::web)) else {
        let text = "no node of the configuration has this name and a `url` any more";
        return Err(TransferError::lasting("no-such-node", text));
    };
    let uids = wanted.uids().ok_or_else(no_images)?;
    let expected = node.count(&uids).await?;
    let mut images = Images {
        pacs,
        job,
        uids: &uids,
        expected,
        batch: Vec::new(),
        received: 0,
        refusals: Refusals::of(ArrivalSource::Retrieval),
    };
    images.read(node).await?;
    let (received, refused) = (images.received, images.refusals.count());
    match expected {
        _ if received == 0 => return Err(no_images()),
        Some(expected) if received < expected => {
            let text = format!("the node sent {received} of {expected} images");
            return Err(TransferError::passing("node-failed", text));
        }
        _ if refused == received => {
            let text = format!(
                "none of the {refused} images of the node is kept: better ones came with their UIDs before"
            );
            return Err(TransferError::lasting("no-images", text));
        }
        _ => {}
    }
    // All that the node has is here: the series need not wait.
    pacs.store().expect(&uids, received - refused).await?;
    let progress = Received { received, expected };
    let progress = serde_json::to_string(&progress).ok();
    let store = pacs.cases().store();
    store.renew(&job.claim, progress.as_deref()).await?;
    Ok(())
}

struct Images<'a> {
    pacs: &'a Pacs,
    job: &'a Running,
    uids: &'a SeriesUids,
    expected: Option<usize>,
    /// Read, and not durable yet.
    batch: Vec<(InstanceIdentity, Spooled)>,
    received: usize,
    /// Of these, those that are not kept.
    refusals: Refusals,
}

impl Images<'_> {
    async fn read(&mut self, node: &WebNode) -> Result<(), TransferError> {
        let (boundary, body) = node.series(self.uids).await?;
        let mut parts = Parts::new(body, &boundary, self.pacs.options().uploads);
        while let Some(kind) = parts.next().await? {
            if !is_dicom(kind.as_deref()) {
                parts.skip().await?;
                continue;
            }
            let Some(file) = parts.spool(self.pacs.cases().store()).await? else {
                return Err(PartsError::TooLarge(cases::dicom::MAX_FILE_BYTES).into());
            };
            let identity = InstanceIdentity::read(self.pacs.cases(), &file).await?;
            if identity.uids == *self.uids && identity.is_image {
                self.batch.push((identity, file));
            }
            if self.batch.len() == BATCH {
                self.flush().await?;
            }
        }
        self.flush().await
    }

    async fn flush(&mut self) -> Result<(), TransferError> {
        let batch = std::mem::take(&mut self.batch);
        let count = batch.len();
        if count > 0 {
            let source = ArrivalSource::Retrieval;
            let receptions = self.pacs.arrivals().receive(batch, source).await?;
            for _ in receptions
                .iter()
                .filter(|became| **became == Reception::Refused)
            {
                self.pacs.arrivals().refused(source);
                self.refusals.add(&Refusal::NOT_BETTER);
            }
        }
        self.received += count;
        self.job.report(&Received {
            received: self.received,
            expected: self.expected,
        });
        Ok(())
    }
}
