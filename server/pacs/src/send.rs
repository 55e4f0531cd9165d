//! Sends the results that were requested, one after the other.

use std::time::Duration;

use axum::body::Bytes;
use case::Failure;
use storage::arrivals::TransferEnd;
use storage::results::SentResult;
use storage::{StoreError, Unreadable};

use crate::node::NodeError;
use crate::state::Pacs;

/// The lease of a result: longer than sending can take.
const LEASE: Duration = Duration::from_secs(900);

/// How often to try.
const MAX_ATTEMPTS: u32 = 8;

/// How long to wait before the second attempt; each time twice as long.
const RETRY_AFTER: Duration = Duration::from_secs(5);

/// Sends the result that has waited longest; `false` if there is none.
pub(crate) async fn next(pacs: &Pacs) -> Result<bool, StoreError> {
    let store = pacs.cases().store();
    let Some(result) = store.lease_result(LEASE).await? else {
        return Ok(false);
    };
    let sent = send(pacs, &result).await;
    match &sent {
        Ok(()) => pacs.note(&result.node, true),
        Err(SendError::Node(error)) => pacs.note(&result.node, error.is_answer()),
        Err(_) => {}
    }
    let end = match sent {
        Ok(()) => {
            tracing::info!(
                result = result.id,
                case = result.case.short(),
                node = result.node,
                "a result was sent"
            );
            TransferEnd::Done
        }
        Err(error) if error.may_pass() && result.attempts < MAX_ATTEMPTS => {
            tracing::warn!(result = result.id, case = result.case.short(), node = result.node, %error, "a result will be sent later");
            let doubled = result.attempts.saturating_sub(1);
            TransferEnd::Later(RETRY_AFTER * 2_u32.pow(doubled))
        }
        Err(error) => {
            tracing::warn!(result = result.id, case = result.case.short(), node = result.node, %error, "a result cannot be sent");
            TransferEnd::Failed(Failure::unusable(error.kind(), error.to_string()))
        }
    };
    store.end_result(&result, &end).await?;
    Ok(true)
}

/// Why a result was not sent.
#[derive(Debug, thiserror::Error)]
enum SendError {
    #[error("no node of the configuration has this name any more")]
    NoSuchNode,
    #[error(transparent)]
    Node(#[from] NodeError),
    #[error("the stored object is missing or damaged; request the result again")]
    Lost,
    #[error("the store cannot be read at the moment")]
    Store,
    #[error("the patient or the study of its case was corrected since, or the PACS has rejected its images")]
    Superseded,
    #[error("it was withdrawn by a rejection note")]
    Withdrawn,
}

impl SendError {
    fn may_pass(&self) -> bool {
        match self {
            Self::Node(error) => error.may_pass(),
            Self::NoSuchNode | Self::Lost | Self::Superseded | Self::Withdrawn => false,
            Self::Store => true,
        }
    }

    fn kind(&self) -> &'static str {
        match self {
            Self::NoSuchNode => "no-such-node",
            Self::Node(error) => error.kind(),
            Self::Lost => "result-lost",
            Self::Superseded => "superseded",
            Self::Withdrawn => "withdrawn",
            Self::Store => "store-failed",
        }
    }
}

async fn send(pacs: &Pacs, result: &SentResult) -> Result<(), SendError> {
    let node = pacs.node(&result.node).ok_or(SendError::NoSuchNode)?;
    let file = pacs.cases().store().object(&result.object).await;
    let file = file.map_err(|error| match error {
        Unreadable::Store(_) => SendError::Store,
        Unreadable::Missing | Unreadable::Damaged(_) => SendError::Lost,
    })?;
    may_leave(pacs, result, &file).await?;
    Ok(node.store(&result.instance, &file).await?)
}

/// Refuses a result of a case that was corrected since it was requested, and one that was withdrawn. A rejection note
/// may leave all the same: it withdraws what was sent of the wrong patient.
async fn may_leave(pacs: &Pacs, result: &SentResult, file: &Bytes) -> Result<(), SendError> {
    let store = pacs.cases().store();
    let of_store = |_| SendError::Store;
    let instance = std::slice::from_ref(&result.instance);
    if store.are_withdrawn(instance).await.map_err(of_store)? == [true] {
        return Err(SendError::Withdrawn);
    }
    let series = store.series_of(&result.case).await.map_err(of_store)?;
    if !series.is_some_and(|series| series.is_superseded) {
        return Ok(());
    }
    let spooled = store.spool_all(file.clone()).await.map_err(of_store)?;
    match pacs.cases().headers.read(&spooled).await {
        Ok(identity) if identity.rejection.is_some() => Ok(()),
        Ok(_) | Err(cases::Error::Failure(_)) => Err(SendError::Superseded),
        Err(_) => Err(SendError::Store),
    }
}
