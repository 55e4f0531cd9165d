//! Sends the results that were requested, one after the other.

use std::time::Duration;

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
}

impl SendError {
    fn may_pass(&self) -> bool {
        match self {
            Self::Node(error) => error.may_pass(),
            Self::NoSuchNode | Self::Lost => false,
            Self::Store => true,
        }
    }

    fn kind(&self) -> &'static str {
        match self {
            Self::NoSuchNode => "no-such-node",
            Self::Node(error) => error.kind(),
            Self::Lost => "result-lost",
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
    Ok(node.store(&result.instance, &file).await?)
}
