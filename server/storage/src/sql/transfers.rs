//! What retrievals and results share: each is work with a node that ends or waits for another attempt.

use super::connection::microseconds;
use crate::StoreError;
use crate::arrivals::{TransferEnd, TransferState};

/// The columns of a row after an attempt.
pub(super) struct AfterAttempt {
    pub(super) state: &'static str,
    pub(super) reason: Option<String>,
    pub(super) available_at: i64,
}

impl AfterAttempt {
    /// After an attempt that ended now.
    pub(super) fn new(end: &TransferEnd, now: i64) -> Result<Self, StoreError> {
        let (state, reason, available_at) = match end {
            TransferEnd::Done => (TransferState::Done, None, now),
            TransferEnd::Failed(failure) => {
                let reason = serde_json::to_string(failure)?;
                (TransferState::Failed, Some(reason), now)
            }
            TransferEnd::Later(after) => (TransferState::Queued, None, now + microseconds(*after)),
        };
        Ok(Self {
            state: state.name(),
            reason,
            available_at,
        })
    }
}
