//! The transactions of layers.

use std::time::Duration;

use async_trait::async_trait;
use case::{CaseId, Failure, Layer, LayerFacts, LayerId};

use super::connection::microseconds;
use super::{SqlRows, layers};
use crate::rows::{
    ChangedLayer, InsertedLayer, LayerChange, LayerClaim, LayerRows, LeaseTerms, NewLayer, Pinned,
    Published, Release,
};
use crate::{ObjectName, StoreError};

impl SqlRows {
    async fn forget_facts(&self, case: &CaseId, layer: &LayerId) -> Result<(), StoreError> {
        let (mut transaction, now) = self.write().await?;
        layers::forget_facts(&mut transaction, case, layer, now).await?;
        transaction.commit().await
    }
}

#[async_trait]
impl LayerRows for SqlRows {
    async fn insert_layer(&self, new: &NewLayer) -> Result<InsertedLayer, StoreError> {
        let (mut transaction, now) = self.write().await?;
        let inserted = layers::insert(&mut transaction, new, now).await?;
        if matches!(inserted, InsertedLayer::Created | InsertedLayer::Requeued) {
            transaction.commit().await?;
        }
        Ok(inserted)
    }

    async fn layers(&self, case: &CaseId) -> Result<Vec<Layer>, StoreError> {
        loop {
            match layers::of_case(&mut self.database.connect().await?, case).await {
                Err(StoreError::DamagedLayer(case, layer)) => {
                    self.forget_facts(&case, &layer).await?;
                }
                read => return read,
            }
        }
    }

    async fn layer_objects(
        &self,
        case: &CaseId,
        layer: &LayerId,
    ) -> Result<Vec<ObjectName>, StoreError> {
        layers::objects(&mut self.database.connect().await?, case, layer).await
    }

    async fn change_layer(
        &self,
        case: &CaseId,
        layer: &LayerId,
        change: &LayerChange,
    ) -> Result<ChangedLayer, StoreError> {
        let (mut transaction, _) = self.write().await?;
        let changed = layers::change(&mut transaction, (case, layer), change).await?;
        if changed == ChangedLayer::Done {
            transaction.commit().await?;
        }
        Ok(changed)
    }

    async fn delete_layer(&self, case: &CaseId, layer: &LayerId) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.write().await?;
        let deleted = layers::delete(&mut transaction, case, layer, now).await?;
        transaction.commit().await?;
        if deleted {
            self.database.empty_log().await;
        }
        Ok(deleted)
    }

    async fn claim_layer(&self, terms: &LeaseTerms) -> Result<Option<LayerClaim>, StoreError> {
        // Most queries find nothing and must not wait for writers.
        let mut reader = self.database.connect().await?;
        let now = self.now(&mut reader).await?;
        if layers::oldest_available(&mut reader, now).await?.is_none() {
            return Ok(None);
        }
        drop(reader);
        loop {
            let (mut transaction, now) = self.write().await?;
            match layers::claim(&mut transaction, terms, now).await {
                Err(StoreError::DamagedLayer(case, layer)) => {
                    drop(transaction);
                    self.forget_facts(&case, &layer).await?;
                }
                claim => {
                    transaction.commit().await?;
                    return claim;
                }
            }
        }
    }

    async fn renew_layer(&self, claim: &LayerClaim, lease: Duration) -> Result<bool, StoreError> {
        let mut connection = self.database.connect().await?;
        let until = self.now(&mut connection).await? + microseconds(lease);
        layers::renew(&mut connection, claim, until).await
    }

    async fn release_layer(
        &self,
        claim: &LayerClaim,
        release: Release,
    ) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.write().await?;
        let released = layers::release(&mut transaction, claim, release, now).await?;
        transaction.commit().await?;
        Ok(released)
    }

    async fn publish_layer(
        &self,
        claim: &LayerClaim,
        derived: &Pinned,
        facts: &LayerFacts,
    ) -> Result<Published, StoreError> {
        let (mut transaction, now) = self.write().await?;
        if !layers::make_ready(&mut transaction, claim, facts).await? {
            return Ok(Published::Fenced);
        }
        let layer = (&claim.layer.case, &claim.layer.id);
        if !layers::refer(&mut transaction, layer, derived, now).await? {
            return Ok(Published::PinLost);
        }
        transaction.commit().await?;
        Ok(Published::Done)
    }

    async fn fail_layer(&self, claim: &LayerClaim, failure: &Failure) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.write().await?;
        let ours = layers::fail(&mut transaction, claim, failure, now).await?;
        transaction.commit().await?;
        Ok(ours)
    }

    async fn prepare_layer_again(
        &self,
        case: &CaseId,
        layer: &LayerId,
    ) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.write().await?;
        let queued = layers::prepare_again(&mut transaction, case, layer, now).await?;
        transaction.commit().await?;
        Ok(queued)
    }

    async fn adopt_layer(&self, layer: &Layer, objects: &Pinned) -> Result<(), StoreError> {
        let (mut transaction, now) = self.write().await?;
        layers::adopt(&mut transaction, layer, objects, now).await?;
        transaction.commit().await
    }
}
