//! The transactions of layers.

use std::time::Duration;

use case::{CaseId, Failure, Layer, LayerFacts, LayerId};

use super::connection::microseconds;
use super::layers;
use crate::rows::{
    ChangedLayer, InsertedLayer, LayerChange, LayerClaim, LeaseTerms, NewLayer, Pinned, Published,
    Release,
};
use crate::{ObjectName, Store, StoreError};

impl Store {
    async fn forget_facts(&self, case: &CaseId, layer: &LayerId) -> Result<(), StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        layers::forget_facts(&mut transaction, case, layer, now).await?;
        transaction.commit().await
    }
}

impl Store {
    /// Makes a layer, which is its own job, and turns its pins into references; or queues a failed one again.
    /// Only [`InsertedLayer::Created`] and [`InsertedLayer::Requeued`] change anything.
    pub(crate) async fn insert_layer(&self, new: &NewLayer) -> Result<InsertedLayer, StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        let inserted = layers::insert(&mut transaction, new, now).await?;
        if matches!(inserted, InsertedLayer::Created | InsertedLayer::Requeued) {
            transaction.commit().await?;
        }
        Ok(inserted)
    }

    /// The layers of a case, in their order.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn layers(&self, case: &CaseId) -> Result<Vec<Layer>, StoreError> {
        loop {
            match layers::of_case(&mut self.rows().connect().await?, case).await {
                Err(StoreError::DamagedLayer(case, layer)) => {
                    self.forget_facts(&case, &layer).await?;
                }
                read => return read,
            }
        }
    }

    /// The objects that a layer needs; none if there is no such layer.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn layer_objects(
        &self,
        case: &CaseId,
        layer: &LayerId,
    ) -> Result<Vec<ObjectName>, StoreError> {
        layers::objects(&mut self.rows().connect().await?, case, layer).await
    }

    /// Renames a layer, or moves it in the list.
    pub(crate) async fn change_layer_row(
        &self,
        case: &CaseId,
        layer: &LayerId,
        change: &LayerChange,
    ) -> Result<ChangedLayer, StoreError> {
        let (mut transaction, _) = self.rows().write().await?;
        let changed = layers::change(&mut transaction, (case, layer), change).await?;
        if changed == ChangedLayer::Done {
            transaction.commit().await?;
        }
        Ok(changed)
    }

    /// Removes a layer; returns whether it existed. Its objects are left with expired pins.
    pub(crate) async fn delete_layer_row(
        &self,
        case: &CaseId,
        layer: &LayerId,
    ) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        let deleted = layers::delete(&mut transaction, case, layer, now).await?;
        transaction.commit().await?;
        if deleted {
            self.rows().database.empty_log().await;
        }
        Ok(deleted)
    }

    /// Leases the oldest layer of a ready case that waits or whose lease has ended. Those with too many attempts behind
    /// them fail on the way.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn claim_layer(&self, terms: &LeaseTerms) -> Result<Option<LayerClaim>, StoreError> {
        // Most queries find nothing and must not wait for writers.
        let mut reader = self.rows().connect().await?;
        let now = self.rows().now(&mut reader).await?;
        if layers::oldest_available(&mut reader, now).await?.is_none() {
            return Ok(None);
        }
        drop(reader);
        loop {
            let (mut transaction, now) = self.rows().write().await?;
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

    /// Renews a lease from now on; `false` if it is not ours any more.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn renew_layer(
        &self,
        claim: &LayerClaim,
        lease: Duration,
    ) -> Result<bool, StoreError> {
        let mut connection = self.rows().connect().await?;
        let until = self.rows().now(&mut connection).await? + microseconds(lease);
        layers::renew(&mut connection, claim, until).await
    }

    /// Returns a lease; `false` if it is not ours any more.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn release_layer(
        &self,
        claim: &LayerClaim,
        release: Release,
    ) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        let released = layers::release(&mut transaction, claim, release, now).await?;
        transaction.commit().await?;
        Ok(released)
    }

    /// Makes a layer ready, if the lease is still ours.
    pub(crate) async fn make_layer_ready(
        &self,
        claim: &LayerClaim,
        derived: &Pinned,
        facts: &LayerFacts,
    ) -> Result<Published, StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
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

    /// Makes a layer failed, which then needs no objects, if the lease is still ours; returns whether it was.
    pub(crate) async fn make_layer_failed(
        &self,
        claim: &LayerClaim,
        failure: &Failure,
    ) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        let ours = layers::fail(&mut transaction, claim, failure, now).await?;
        transaction.commit().await?;
        Ok(ours)
    }

    /// Queues a ready layer again, because its object is lost; its placement stays. Returns whether it was ready.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn prepare_layer_again(
        &self,
        case: &CaseId,
        layer: &LayerId,
    ) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        let queued = layers::prepare_again(&mut transaction, case, layer, now).await?;
        transaction.commit().await?;
        Ok(queued)
    }

    /// Inserts the layers of a case of another store, in their order, unless they are here, and turns their pins into
    /// references. What is neither ready nor failed is queued.
    pub(crate) async fn adopt_layer(
        &self,
        layer: &Layer,
        objects: &Pinned,
    ) -> Result<(), StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        layers::adopt(&mut transaction, layer, objects, now).await?;
        transaction.commit().await
    }
}
