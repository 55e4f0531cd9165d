//! What goes into the rows and comes out of them.
//!
//! Every change is one transaction, which ends before its method returns. The time is the database's own: leases, pins and
//! tombstones of several machines, whose clocks differ, are compared by one clock. Callers give durations.
//!
//! An object is removed in three steps, none of which holds a transaction while the object store works:
//! `mark` leaves a tombstone on an unneeded object, the object is deleted, and `remove_tombstones` removes
//! the tombstone. An object with a tombstone cannot be pinned, and a pinned or needed object gets no tombstone; so no
//! object is deleted that a process is about to reference. A tombstone has a lease: if its holder is killed, another
//! sweep takes it over and deletes the object again.

use std::time::Duration;

use case::images::Image;
use case::series::{CaseSeries, Uid};
use case::{Case, CaseId, Contrast, LayerId, LayerParameters, Parameters};

use super::ObjectName;

/// A case to be inserted.
#[derive(Debug, Clone)]
pub(crate) struct NewCase {
    /// Its name.
    pub id: CaseId,
    /// The parameters from the upload.
    pub parameters: Parameters,
    /// The case of which it is a version.
    pub previous: Option<CaseId>,
    /// The images that it is made of; those of `previous`, and its series, if there is nothing here.
    pub images: Option<Vec<Image>>,
    /// The series that it is made of.
    pub series: Option<CaseSeries>,
    /// Whether a case that is there already gets the label of the parameters.
    pub relabel: Relabel,
    /// Its source objects and its manifest: durable, and pinned.
    pub sources: Pinned,
    /// How many jobs may wait.
    pub queue_limit: usize,
    /// Whose it is: see [`Store::for_client`](crate::Store::for_client).
    pub client: String,
}

/// The result of an upload.
#[derive(Debug, Clone, PartialEq)]
pub struct Submitted {
    pub case: Case,
    /// Whether its preparation was queued, because the case is new or had failed.
    pub created: bool,
}

/// Which label a case that is there already gets when it is uploaded again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Relabel {
    /// It stays as it is.
    None,
    /// That of the upload, if it has none.
    Unlabelled,
    /// That of the upload, if that has one.
    Any,
}

/// A layer to be inserted.
#[derive(Debug, Clone)]
pub(crate) struct NewLayer {
    pub case: CaseId,
    pub id: LayerId,
    /// Its name; if another layer of the case has it, a number is added to it or the layer is refused.
    pub name: LayerName,
    pub parameters: LayerParameters,
    /// The series that it is made of, if that is known.
    pub series: Option<Uid>,
    /// The images that it is made of.
    pub images: Vec<Image>,
    /// Its source objects and its manifest: durable, and pinned.
    pub sources: Pinned,
    /// How many layers a case may have.
    pub most: usize,
    /// How many jobs may wait.
    pub queue_limit: usize,
    /// Whose it is: see [`Store::for_client`](crate::Store::for_client).
    pub client: String,
}

impl NewLayer {
    pub(crate) fn owner(&self) -> Owner {
        (&self.case, &self.id).into()
    }
}

/// The name of a new layer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LayerName {
    /// The user's; it must be free.
    Given(String),
    /// Made up: gets a number if it is taken.
    Usual(String),
}

/// What has objects: a case, or a layer of one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Owner {
    pub case: CaseId,
    pub layer: Option<LayerId>,
}

impl Owner {
    /// The one that a key of jobs names: the case, and after a slash the layer.
    pub(crate) fn of_key(key: &str) -> Option<Self> {
        let (case, layer) = match key.split_once('/') {
            None => (key, None),
            Some((case, layer)) => (case, Some(LayerId::parse(layer)?)),
        };
        let case = CaseId::parse(case)?;
        Some(Self { case, layer })
    }

    /// Its columns in tables of both: the case, and the layer or nothing.
    pub(crate) fn columns(&self) -> [String; 2] {
        let layer = self
            .layer
            .map_or_else(String::new, |layer| layer.to_string());
        [self.case.to_string(), layer]
    }

    pub(crate) fn key(&self) -> String {
        match &self.layer {
            None => self.case.to_string(),
            Some(layer) => format!("{}/{layer}", self.case),
        }
    }
}

impl From<&CaseId> for Owner {
    fn from(&case: &CaseId) -> Self {
        Self { case, layer: None }
    }
}

impl From<(&CaseId, &LayerId)> for Owner {
    fn from((&case, &layer): (&CaseId, &LayerId)) -> Self {
        let layer = Some(layer);
        Self { case, layer }
    }
}

/// Changes of a case that keep its id.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct CaseChange {
    /// Another label.
    pub name: Option<String>,
    /// Whether it stays for good.
    pub kept: Option<bool>,
    /// Whether lists leave it out.
    pub trashed: Option<bool>,
}

/// Changes of a layer that keep its id.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct LayerChange {
    /// Another name.
    pub name: Option<String>,
    /// Another place in the list, from 0; beyond the end is the end.
    pub place: Option<usize>,
    /// Its contrast, of a layer of the kind `mr`.
    pub contrast: Option<Contrast>,
}

/// Objects about to be written, protected by their holder's pins.
#[derive(Debug, Clone)]
pub struct Pinned {
    /// The holder of the pins; unique for each write.
    pub holder: String,
    /// The pinned objects.
    pub names: Vec<ObjectName>,
}

/// What became of pins in a transaction.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Referred<T> {
    /// They are references now.
    Done(T),
    /// The objects are not needed. Nothing of them has changed.
    Unneeded(T),
    /// A pin is gone, and perhaps its object too; write the objects again. Nothing has changed.
    PinLost,
}

/// The result of a publication.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Published {
    /// It is there.
    Done,
    /// The lease is lost, or the case is deleted. Nothing has changed.
    Fenced,
}

/// What is made of images: a case, a layer of it, or a result that shows layers of it. Its fields are columns.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Made {
    pub case: String,
    pub layer: String,
    pub result: String,
}

impl Made {
    /// A case.
    pub fn case(case: &CaseId) -> Self {
        Self::result(case, "")
    }

    /// A layer of a case.
    pub fn layer(case: &CaseId, layer: &LayerId) -> Self {
        let layer = layer.to_string();
        Self {
            layer,
            ..Self::case(case)
        }
    }

    /// A result that was made from a case.
    pub fn result(case: &CaseId, result: &str) -> Self {
        Self {
            case: case.to_string(),
            layer: String::new(),
            result: result.to_owned(),
        }
    }
}

/// The holder of tombstones, and their lease.
#[derive(Debug, Clone)]
pub(crate) struct Sweep {
    /// Unique for each sweep.
    pub holder: String,
    /// After this time, another sweep may take over the tombstones.
    pub lease: Duration,
}

/// How many rows are in which state.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RowCounts {
    /// What they are (`cases`, `closed` or `jobs`), why they are closed or the kind of jobs, their state, and how many.
    pub by_state: Vec<(String, String, String, u64)>,
    /// Cases that are past their age and are still there; 0 if all are kept.
    pub expired: u64,
    /// For how long the oldest job of each kind has not ended.
    pub oldest: Vec<(String, Duration)>,
}

/// A change of the rows by any process, including this one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Change {
    /// A job waits for a worker.
    Queued,
    /// A case is new or has changed.
    Changed(CaseId),
    /// A case was deleted.
    Deleted(CaseId),
}
