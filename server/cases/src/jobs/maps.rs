//! Computes the maps of ready cases, and those of their layers.

use async_trait::async_trait;
use case::JobKind;

use super::usual_terms;
use crate::library::Library;
use crate::runner::{End, Failed, Running, Terms, Work};

/// Computes the maps of a case, or of one of its layers.
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
        if let Some(owner) = job.claim.owner() {
            self.0.make_maps(owner).await?;
        }
        Ok(End::Done)
    }
}
