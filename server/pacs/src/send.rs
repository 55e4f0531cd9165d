//! Sends the results that were requested, one after the other.

use std::time::Duration;

use access::audit::{Action, Event, EventKind, Outcome};
use async_trait::async_trait;
use case::{Failure, JobKind};
use cases::runner::{End, Failed, Running, Terms, Work};
use storage::Unreadable;

use crate::node::NodeError;
use crate::series::SEVERAL_PATIENTS;
use crate::state::Pacs;
use crate::store::REJECTION_NOTE;
use crate::transfer::{TransferError, end};
use crate::values::{SEND, SentResult};

/// The terms of a delivery.
const TERMS: Terms = Terms {
    max_attempts: 8,
    retry_after: Duration::from_secs(5),
    longest: Duration::from_secs(900),
};

pub(crate) struct SendResult(pub(crate) Pacs);

#[async_trait]
impl Work for SendResult {
    fn kind(&self) -> JobKind {
        SEND
    }

    fn terms(&self) -> Terms {
        TERMS
    }

    async fn run(&self, job: &Running) -> Result<End, Failed> {
        let id = &job.claim.key;
        let pacs = &self.0;
        let Some(result) = pacs.store().result(id).await? else {
            return Ok(End::Done);
        };
        let (case, node) = (result.case.short(), result.node.as_str());
        let sent = recorded(pacs, &result).await;
        match &sent {
            Ok(()) => tracing::info!(result = id, case, node, "a result was sent"),
            Err(error) => {
                tracing::warn!(result = id, case, node, %error, "a result was not sent");
            }
        }
        end(pacs, node, sent)
    }
}

/// Why a result was not sent.
#[derive(Debug, thiserror::Error)]
enum SendError {
    #[error("no node of the configuration has this name any more")]
    NoSuchNode,
    #[error(transparent)]
    Node(#[from] NodeError),
    #[error("the stored object is damaged; request the result again")]
    Lost,
    #[error("the store cannot be read at the moment")]
    Store,
    #[error("{0}")]
    Contradicted(&'static str),
    #[error("the audit record of the server cannot be written")]
    NotRecorded,
}

impl TransferError for SendError {
    fn of_node(&self) -> Option<NodeError> {
        match self {
            Self::Node(error) => Some(*error),
            _ => None,
        }
    }

    fn may_pass(&self) -> bool {
        match self {
            Self::Node(error) => error.may_pass(),
            Self::NoSuchNode | Self::Lost | Self::Contradicted(_) => false,
            Self::Store | Self::NotRecorded => true,
        }
    }

    fn into_failure(self) -> Failure {
        let kind = match &self {
            Self::NoSuchNode => "no-such-node",
            Self::Node(error) => error.kind(),
            Self::Lost => "result-lost",
            Self::Contradicted(_) => SEVERAL_PATIENTS,
            Self::Store => "store-failed",
            Self::NotRecorded => "audit-full",
        };
        Failure::unusable(kind, self.to_string())
    }
}

/// Sends a result, and records it before, and again if it fails.
async fn recorded(pacs: &Pacs, result: &SentResult) -> Result<(), SendError> {
    let event = |outcome| Event {
        outcome,
        to: Some(result.node.as_str().into()),
        case: Some(result.case.to_string().into()),
        ..Event::new(
            EventKind::InstancesTransferred,
            Action::Read,
            "result",
            "isocortex",
        )
    };
    let audit = pacs.audit();
    let allowed = audit.record(event(Outcome::Allowed)).await;
    allowed.map_err(|_| SendError::NotRecorded)?;
    let sent = send(pacs, result).await;
    if let Err(error) = &sent {
        let outcome = match error {
            SendError::Node(_) | SendError::Store => Outcome::SeriousFailure,
            _ => Outcome::MinorFailure,
        };
        if audit.record(event(outcome)).await.is_err() {
            tracing::error!("the failure of a delivery is not in the audit record");
        }
    }
    sent
}

async fn send(pacs: &Pacs, result: &SentResult) -> Result<(), SendError> {
    let node = pacs.node(&result.node).ok_or(SendError::NoSuchNode)?;
    let file = pacs.cases().store().object(&result.object).await;
    let file = file.map_err(|error| match error {
        // What is not found now may be back in a moment.
        Unreadable::Store(_) | Unreadable::Missing => SendError::Store,
        Unreadable::Damaged(_) => SendError::Lost,
    })?;
    may_leave(pacs, result).await?;
    Ok(node.store(&result.instance, &file).await?)
}

/// Refuses a result of a case whose series or study the PACS has as another patient's. A rejection note may leave all the same: it withdraws
/// what was sent of the wrong patient. What is closed or withdrawn was refused when the job was claimed.
async fn may_leave(pacs: &Pacs, result: &SentResult) -> Result<(), SendError> {
    if result.series.sop_class_uid.as_str() == REJECTION_NOTE {
        return Ok(());
    }
    let arrivals = pacs.arrivals();
    let named = arrivals.patient_of(result.object);
    let found = arrivals.contradiction(&result.case, &result.study, named);
    match found.await {
        Ok(None) => Ok(()),
        Ok(Some(why)) => Err(SendError::Contradicted(why)),
        Err(_) => Err(SendError::Store),
    }
}
