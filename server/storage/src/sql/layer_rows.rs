//! The transactions of layers.

use case::series::Uid;
use case::{CaseId, CaseState, Layer, LayerFacts, LayerId};

use super::{jobs, layers};
use crate::jobs::Claim;
use crate::rows::{Inserted, LayerChange, NewLayer, Pinned, Published, Referred};
use crate::{ObjectName, Store, StoreError};

impl Store {
    /// Makes a layer and its job, and turns its pins into references; or queues a failed one again.
    pub(crate) async fn insert_layer(
        &self,
        new: &NewLayer,
    ) -> Result<Referred<Inserted>, StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        let inserted = layers::submit(&mut transaction, new, now).await?;
        if matches!(inserted, Referred::Done(_)) {
            transaction.commit().await?;
        }
        Ok(inserted)
    }

    /// Renames a layer, or moves it in the list; returns whether there is such a layer.
    ///
    /// # Errors
    /// [`StoreError::LayerNameTaken`], or if the rows cannot be written.
    pub async fn change_layer(
        &self,
        case: &CaseId,
        layer: &LayerId,
        change: &LayerChange,
    ) -> Result<bool, StoreError> {
        let (mut transaction, _) = self.rows().write().await?;
        let changed = layers::change(&mut transaction, case, layer, change).await?;
        transaction.commit().await?;
        self.signals().changed(case);
        Ok(changed)
    }

    /// Makes a layer ready and ends its job, if the lease is still ours.
    pub(crate) async fn make_layer_ready(
        &self,
        claim: &Claim,
        derived: &Pinned,
        facts: &LayerFacts,
    ) -> Result<Referred<Published>, StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        let Some((case, layer)) = claim.layer() else {
            return Ok(Referred::Unneeded(Published::Fenced));
        };
        if !jobs::finish(&mut transaction, claim, Ok(()), now).await? {
            return Ok(Referred::Unneeded(Published::Fenced));
        }
        if !layers::refer(&mut transaction, &case, &layer, derived, now).await? {
            return Ok(Referred::PinLost);
        }
        layers::make_ready(&mut transaction, &case, &layer, facts).await?;
        transaction.commit().await?;
        Ok(Referred::Done(Published::Done))
    }

    /// Makes pinned objects those of a layer that is ready.
    pub(crate) async fn refer_to_layer(
        &self,
        case: &CaseId,
        layer: &LayerId,
        derived: &Pinned,
    ) -> Result<Referred<Published>, StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        let layers = layers::of_case(&mut transaction, case).await?;
        let is_meant = |known: &Layer| known.id == *layer && known.state == CaseState::Ready;
        if !layers.iter().any(is_meant) {
            return Ok(Referred::Unneeded(Published::Fenced));
        }
        if !layers::refer(&mut transaction, case, layer, derived, now).await? {
            return Ok(Referred::PinLost);
        }
        transaction.commit().await?;
        Ok(Referred::Done(Published::Done))
    }

    /// The layers of a case, in their order.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn layers(&self, case: &CaseId) -> Result<Vec<Layer>, StoreError> {
        loop {
            match layers::of_case(&mut self.rows().connect().await?, case).await {
                Err(StoreError::DamagedLayer(case, layer)) => {
                    let (mut transaction, now) = self.rows().write().await?;
                    layers::forget_facts(&mut transaction, &case, &layer, now).await?;
                    transaction.commit().await?;
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

    /// Queues a failed layer again; returns whether it had failed.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub async fn prepare_failed_layer_again(
        &self,
        case: &CaseId,
        layer: &LayerId,
    ) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        let layers = layers::of_case(&mut transaction, case).await?;
        let is_meant = |known: &Layer| known.id == *layer && known.state == CaseState::Failed;
        let had_failed = layers.iter().any(is_meant);
        if had_failed {
            layers::queue_again(&mut transaction, case, layer, "", now).await?;
            transaction.commit().await?;
            self.signals().queued();
        }
        Ok(had_failed)
    }

    /// Inserts the layers of a case of another store, in their order, unless they are here, and turns their pins into
    /// references. What is neither ready nor failed is queued.
    pub(crate) async fn write_copied_layer(
        &self,
        layer: &Layer,
        series: Option<&Uid>,
        objects: &Pinned,
    ) -> Result<(), StoreError> {
        let (mut transaction, now) = self.rows().write().await?;
        layers::write_copied(&mut transaction, layer, series, objects, now).await?;
        transaction.commit().await
    }

    /// The layers that are made of a series, of whichever case and study.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn layers_of_series(
        &self,
        series: &Uid,
    ) -> Result<Vec<(CaseId, LayerId)>, StoreError> {
        layers::of_series(&mut self.rows().connect().await?, series).await
    }

    /// The series that a layer is made of, if that is known.
    pub(crate) async fn series_of_layer(
        &self,
        case: &CaseId,
        layer: &LayerId,
    ) -> Result<Option<Uid>, StoreError> {
        layers::series_of(&mut self.rows().connect().await?, case, layer).await
    }
}
