//! Prepares layers of ready cases.

use async_trait::async_trait;
use case::{FailureKind, JobKind, ObjectKind};
use pipeline::layers::PreparedLayer;
use storage::{Count, Published, Publisher, StoreError, frame_all};

use super::usual_terms;
use crate::library::Library;
use crate::runner::{End, Failed, Running, Terms, Work};

pub(super) struct PrepareLayer(pub(super) Library);

#[async_trait]
impl Work for PrepareLayer {
    fn kind(&self) -> JobKind {
        JobKind::LAYER
    }

    fn terms(&self) -> Terms {
        usual_terms(&self.0)
    }

    async fn run(&self, job: &Running) -> Result<End, Failed> {
        let store = self.0.store();
        let owner = job.claim.owner();
        let Some((case, id)) = owner.and_then(|owner| Some((owner.case, owner.layer?))) else {
            return Ok(End::Settled);
        };
        let Some(layer) = store.layer(&case, &id).await? else {
            return Ok(End::Settled);
        };
        let prepared = match self.0.prepare_layer(&layer).await {
            Ok(Some(prepared)) => prepared,
            // Its case was deleted.
            Ok(None) => return Ok(End::Settled),
            // A decoder panicked, and would again.
            Err(StoreError::Stopped(error)) if error.is_panic() => {
                std::panic::resume_unwind(error.into_panic())
            }
            Err(error) => return Err(error.into()),
        };
        let PreparedLayer { payload, facts } = prepared.map_err(|failure| {
            if failure.kind == FailureKind::OutOfMemory {
                tracing::warn!(
                    job = job.claim.fence,
                    case = case.short(),
                    "there is not enough memory for a layer"
                );
            }
            Failed::Forever(failure)
        })?;
        let framed = frame_all(vec![(ObjectKind::Layer, payload)]).await?;
        let publisher = Publisher::Layer(job.claim.clone(), Box::new(facts.clone()));
        let published = store.publish(publisher, framed).await?;
        if published == Published::Done {
            store.signals().count(Count::Prepared);
            let placement = &facts.placement;
            tracing::info!(
                job = job.claim.fence,
                case = case.short(),
                origin = placement.origin.name(),
                quality = placement.quality.name(),
                "a layer is ready"
            );
            if layer.is_flair() {
                // Queues its map, if it is the newest one. If that fails, whoever asks for the map queues it.
                if let Err(error) = self.0.flair(&case).await {
                    tracing::warn!(
                        case = case.short(),
                        error = &error as &dyn std::error::Error,
                        "the map of a FLAIR will be computed later"
                    );
                }
            }
        }
        Ok(End::Settled)
    }
}
