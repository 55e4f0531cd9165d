//! Computes the maps of ready cases.

use async_trait::async_trait;
use case::JobKind;

use super::usual_terms;
use crate::library::Library;
use crate::runner::{End, Failed, Running, Terms, Work};

/// Computes the maps of a case.
pub(super) struct ComputeMaps(pub(super) Library);

#[async_trait]
impl Work for ComputeMaps {
    fn kind(&self) -> JobKind {
        JobKind::MAPS
    }

    fn terms(&self) -> Terms {
        usual_terms(&self.0)
    }

    async fn run(&self, job: &Running) -> Result<End, Failed> {
        if let Some(case) = &job.claim.case {
            self.0.make_maps(case).await?;
        }
        Ok(End::Done)
    }
}
