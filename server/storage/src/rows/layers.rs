//! The rows of layers, which are also the rows of their jobs.

use case::{CaseId, Layer, LayerId, LayerParameters};

use super::terms::Pinned;

/// A layer to be inserted.
#[derive(Debug, Clone)]
pub(crate) struct NewLayer {
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
pub(crate) enum InsertedLayer {
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
