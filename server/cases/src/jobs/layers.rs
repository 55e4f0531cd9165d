//! Workers that prepare queued layers.

use std::time::Duration;

use case::{Failure, FailureKind, ObjectKind};
use pipeline::layers::PreparedLayer;
use storage::{Count, LayerClaim, LeaseTerms, Published, Release, StoreError, frame_all};

use super::{Phase, Worker, until};

impl Worker {
    pub(super) async fn claim_layer(&self) -> Result<Option<LayerClaim>, StoreError> {
        let terms = LeaseTerms {
            lease: self.store.options().lease,
            max_attempts: self.store.options().max_attempts,
        };
        self.store.claim_layer(&terms).await
    }

    pub(super) async fn prepare_layer(&self, claim: &LayerClaim) {
        tracing::info!(job = claim.fence, "preparing a layer");
        self.store.signals().changed(&claim.layer.case);
        let settled = match self.run_layer(claim).await {
            Ok(Some(Ok(prepared))) => self.publish_layer(claim, prepared).await,
            Ok(Some(Err(failure))) => self.refuse_layer(claim, &failure).await,
            // Deleted, or handed back.
            Ok(None) => Ok(()),
            Err(error) => Err(error),
        };
        if let Err(error) = settled {
            tracing::error!(
                job = claim.fence,
                error = &error as &dyn std::error::Error,
                "the preparation of a layer was interrupted by a failure of the store"
            );
            self.store.signals().count(Count::Retried);
            self.return_layer(claim, self.store.options().retry_after, true)
                .await;
        }
        self.store.signals().changed(&claim.layer.case);
    }

    /// Prepares and renews the lease; nothing is stored yet. `None` if the result is not wanted any more.
    async fn run_layer(
        &self,
        claim: &LayerClaim,
    ) -> Result<Option<Result<PreparedLayer, Failure>>, StoreError> {
        let library = self.library.clone();
        let owned = claim.clone();
        // A task of its own, so that a panic of the decoder ends the job and not the worker.
        let prepare = async move { library.prepare_layer(&owned).await };
        let mut prepare = tokio::spawn(prepare);
        let mut heartbeat = tokio::time::interval(self.store.options().heartbeat);
        let mut phase = self.phase.clone();
        let longest = self.store.options().longest_preparation;
        let mut end = std::pin::pin!(tokio::time::sleep(longest));
        loop {
            tokio::select! {
                prepared = &mut prepare => {
                    return match prepared {
                        Ok(Err(StoreError::Stopped(_))) | Err(_) => Ok(Some(Err(super::crashed()))),
                        Ok(prepared) => prepared,
                    };
                }
                () = &mut end => {
                    prepare.abort();
                    return Ok(Some(Err(super::too_slow(longest))));
                }
                _ = heartbeat.tick() => {
                    let lease = self.store.options().lease;
                    let renewed = self.store.renew_layer(claim, lease).await;
                    if matches!(renewed, Ok(false)) {
                        tracing::info!(job = claim.fence, "the preparation of a layer was cancelled");
                        prepare.abort();
                        return Ok(None);
                    }
                }
                () = until(&mut phase, Phase::Stopping) => {
                    prepare.abort();
                    self.return_layer(claim, Duration::ZERO, false).await;
                    return Ok(None);
                }
            }
        }
    }

    async fn publish_layer(
        &self,
        claim: &LayerClaim,
        prepared: PreparedLayer,
    ) -> Result<(), StoreError> {
        let PreparedLayer { payload, facts } = prepared;
        let framed = frame_all(vec![(ObjectKind::Layer, payload)]).await?;
        let published = self.store.publish_layer(claim, &framed, &facts).await?;
        if published == Published::Done {
            let placement = &facts.placement;
            tracing::info!(
                job = claim.fence,
                origin = placement.origin.name(),
                quality = placement.quality.name(),
                "a layer is ready"
            );
        }
        Ok(())
    }

    async fn refuse_layer(&self, claim: &LayerClaim, failure: &Failure) -> Result<(), StoreError> {
        if failure.kind == FailureKind::OutOfMemory {
            tracing::warn!(job = claim.fence, "there is not enough memory for a layer");
        }
        tracing::info!(
            job = claim.fence,
            kind = failure.name,
            "a layer cannot be prepared"
        );
        if self.store.fail_layer(claim, failure).await? {
            self.store.signals().count(Count::Failed);
        }
        Ok(())
    }

    async fn return_layer(&self, claim: &LayerClaim, after: Duration, counts: bool) {
        let release = Release { after, counts };
        // If even this fails, the lease ends by itself.
        if let Err(error) = self.store.release_layer(claim, release).await {
            tracing::warn!(
                job = claim.fence,
                error = &error as &dyn std::error::Error,
                "cannot return a lease"
            );
        }
    }
}
