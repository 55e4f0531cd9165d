//! The rows of layers, which are also the rows of their jobs.

use std::time::Duration;

use async_trait::async_trait;
use case::{CaseId, Failure, Layer, LayerFacts, LayerId, LayerParameters};

use super::terms::{LeaseTerms, Pinned, Published, Release};
use crate::{ObjectName, StoreError};

/// A layer to be inserted.
#[derive(Debug, Clone)]
pub struct NewLayer {
    /// Its case.
    pub case: CaseId,
    /// Its id.
    pub id: LayerId,
    /// Its name; if another layer of the case has it, a number is added to it or the layer is refused.
    pub name: LayerName,
    /// Its parameters.
    pub parameters: LayerParameters,
    /// Its source objects: durable, and pinned.
    pub sources: Pinned,
    /// How many layers a case may have.
    pub most: usize,
    /// How many jobs may wait.
    pub queue_limit: usize,
}

/// The name of a new layer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LayerName {
    /// The user's; it must be free.
    Given(String),
    /// Made up: gets a number if it is taken.
    Usual(String),
}

/// The result of the insertion of a layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InsertedLayer {
    /// The layer is new, and queued.
    Created,
    /// It existed and had failed; it is queued again.
    Requeued,
    /// It existed.
    Exists,
    /// There is no such case.
    NoCase,
    /// The case has as many layers as it may have.
    TooMany,
    /// Another layer of the case has the name.
    NameTaken,
    /// The queue is full.
    QueueFull,
    /// A pin is gone, and perhaps its object too; write the objects again.
    PinLost,
}

/// A leased job of a layer.
#[derive(Debug, Clone, PartialEq)]
pub struct LayerClaim {
    /// The layer. Facts are those of an earlier preparation, whose placement stays.
    pub layer: Layer,
    /// The number of this lease; a greater one fences it off.
    pub fence: i64,
}

/// Changes of a layer that keep its id.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct LayerChange {
    /// Another name.
    pub name: Option<String>,
    /// Another place in the list, from 0; beyond the end is the end.
    pub place: Option<usize>,
}

/// The result of a change of a layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ChangedLayer {
    /// It is changed.
    Done,
    /// There is no such layer.
    NoLayer,
    /// Another layer of the case has the name.
    NameTaken,
}

/// The layers of cases, in a database that several processes may share.
#[async_trait]
pub trait LayerRows {
    /// Makes a layer, which is its own job, and turns its pins into references; or queues a failed one again.
    /// Only [`InsertedLayer::Created`] and [`InsertedLayer::Requeued`] change anything.
    async fn insert_layer(&self, new: &NewLayer) -> Result<InsertedLayer, StoreError>;

    /// The layers of a case, in their order.
    async fn layers(&self, case: &CaseId) -> Result<Vec<Layer>, StoreError>;

    /// The objects that a layer needs; none if there is no such layer.
    async fn layer_objects(
        &self,
        case: &CaseId,
        layer: &LayerId,
    ) -> Result<Vec<ObjectName>, StoreError>;

    /// Renames a layer, or moves it in the list.
    async fn change_layer(
        &self,
        case: &CaseId,
        layer: &LayerId,
        change: &LayerChange,
    ) -> Result<ChangedLayer, StoreError>;

    /// Removes a layer; returns whether it existed. Its objects are left with expired pins.
    async fn delete_layer(&self, case: &CaseId, layer: &LayerId) -> Result<bool, StoreError>;

    /// Leases the oldest layer of a ready case that waits or whose lease has ended. Those with too many attempts behind
    /// them fail on the way.
    async fn claim_layer(&self, terms: &LeaseTerms) -> Result<Option<LayerClaim>, StoreError>;

    /// Renews a lease from now on; `false` if it is not ours any more.
    async fn renew_layer(&self, claim: &LayerClaim, lease: Duration) -> Result<bool, StoreError>;

    /// Returns a lease; `false` if it is not ours any more.
    async fn release_layer(&self, claim: &LayerClaim, release: Release)
    -> Result<bool, StoreError>;

    /// Makes a layer ready, if the lease is still ours.
    async fn publish_layer(
        &self,
        claim: &LayerClaim,
        derived: &Pinned,
        facts: &LayerFacts,
    ) -> Result<Published, StoreError>;

    /// Makes a layer failed, which then needs no objects, if the lease is still ours; returns whether it was.
    async fn fail_layer(&self, claim: &LayerClaim, failure: &Failure) -> Result<bool, StoreError>;

    /// Queues a ready layer again, because its object is lost; its placement stays. Returns whether it was ready.
    async fn prepare_layer_again(&self, case: &CaseId, layer: &LayerId)
    -> Result<bool, StoreError>;

    /// Inserts the layers of a case of another store, in their order, unless they are here, and turns their pins into
    /// references. What is neither ready nor failed is queued.
    async fn adopt_layer(&self, layer: &Layer, objects: &Pinned) -> Result<(), StoreError>;
}
