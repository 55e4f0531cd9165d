//! Sends the results that were requested, one after the other.

use std::time::Duration;

use access::audit::{Action, Event, EventKind, Outcome};
use async_trait::async_trait;
use case::JobKind;
use cases::runner::{End, Failed, Running, Terms, Work};
use storage::Unreadable;

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
        let (case, node) = (result.what.case.short(), result.what.node.as_str());
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

/// The store cannot tell whether the result may leave, or what it is.
fn store_failed<E>(_: E) -> TransferError {
    let text = "the store cannot be read at the moment";
    TransferError::passing("store-failed", text)
}

/// Sends a result, and records it before, and again if it fails.
async fn recorded(pacs: &Pacs, result: &SentResult) -> Result<(), TransferError> {
    let event = |outcome| Event {
        outcome,
        to: Some(result.what.node.as_str().into()),
        case: Some(result.what.case.to_string().into()),
        ..Event::new(
            EventKind::InstancesTransferred,
            Action::Read,
            "result",
            "isocortex",
        )
    };
    let audit = &pacs.options().audit;
    let allowed = audit.record(event(Outcome::Allowed)).await;
    allowed.map_err(|_| {
        let text = "the audit record of the server cannot be written";
        TransferError::passing("audit-full", text)
    })?;
    let sent = send(pacs, result).await;
    if let Err(error) = &sent {
        let outcome = match error.node.is_some() || error.may_pass {
            true => Outcome::SeriousFailure,
            false => Outcome::MinorFailure,
        };
        if audit.record(event(outcome)).await.is_err() {
            tracing::error!("the failure of a delivery is not in the audit record");
        }
    }
    sent
}

async fn send(pacs: &Pacs, result: &SentResult) -> Result<(), TransferError> {
    let node = pacs.node(&result.what.node).ok_or_else(|| {
        let text = "no node of the configuration has this name any more";
        TransferError::lasting("no-such-node", text)
    })?;
    let file = pacs.cases().store().object(&result.what.object()).await;
    let file = file.map_err(|error| match error {
        // What is not found now may be back in a moment.
        Unreadable::Store(_) | Unreadable::Missing => store_failed(error),
        Unreadable::Damaged(_) => {
            let text = "the stored object is damaged; request the result again";
            TransferError::lasting("result-lost", text)
        }
    })?;
    may_leave(pacs, result).await?;
    Ok(node.store(&result.what.instance, &file).await?)
}

/// Refuses a result of a case whose series or study the PACS has as another patient's. A rejection note may leave all the same: it withdraws
/// what was sent of the wrong patient. What is closed or withdrawn was refused when the job was claimed.
async fn may_leave(pacs: &Pacs, result: &SentResult) -> Result<(), TransferError> {
    if result.what.series.sop_class_uid.as_str() == REJECTION_NOTE {
        return Ok(());
    }
    let arrivals = pacs.arrivals();
    let named = arrivals.patient_of(result.what.object());
    let found = arrivals.contradiction(&result.what.case, &result.what.study, named);
    match found.await.map_err(store_failed)? {
        None => Ok(()),
        Some(why) => Err(TransferError::lasting(SEVERAL_PATIENTS, why)),
    }
}
