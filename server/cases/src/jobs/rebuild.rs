//! Rebuilds the derived objects of ready cases whose first rebuild was interrupted. Whoever finds an object lost takes the
//! job itself ([`Store::rebuild_alone`](storage::Store::rebuild_alone)); only if it ends before, a worker does.

use async_trait::async_trait;
use case::JobKind;
use storage::StoreError;

use super::usual_terms;
use crate::library::Library;
use crate::runner::{End, Failed, Running, Terms, Work};

pub(super) struct Rebuild(pub(super) Library);

#[async_trait]
impl Work for Rebuild {
    fn kind(&self) -> JobKind {
        JobKind::REBUILD
    }

    fn terms(&self) -> Terms {
        usual_terms(&self.0)
    }

    async fn run(&self, job: &Running) -> Result<End, Failed> {
        if let Some(case) = &job.claim.case {
            match self.0.rebuild(case).await {
                // Whoever needs an object asks for it again.
                Ok(()) | Err(StoreError::SourceMissing) => {}
                Err(error) => return Err(error.into()),
            }
        }
        Ok(End::Done)
    }
}
