//! Errors of the application, independent of any protocol.

use std::borrow::Cow;
use std::time::Duration;

use case::{CaseState, Closed, Failure};
use geometry::GeometryError;
use pipeline::maps::NoMaps;
use pipeline::surfaces::NoSurfaces;
use render::RenderError;
use storage::{ObjectError, StoreError};

use crate::models::{ModelError, PathsError};

/// An error of the application. The sentences may be shown to clients, except for [`Error::Store`].
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// No such case.
    #[error("there is no case with this id")]
    NoSuchCase,
    /// The case is not prepared yet.
    #[error("the case is not ready yet: it is {}", .state.name())]
    NotReady { state: CaseState },
    /// The maps of the case are being computed, or the layer is being prepared.
    #[error("the layer is being computed; try again in a moment")]
    LayerNotReady,
    /// The layer is closed, and is not drawn.
    #[error("the layer is closed and is not drawn: {}", .0.sentence())]
    LayerClosed(Closed),
    /// No such layer.
    #[error("the case has no layer with this name; `/v1/cases/{{id}}/layers` lists its layers")]
    NoSuchLayer,
    /// The case has as many layers as it may have.
    #[error("the case has {most} layers, the limit; delete one, or raise `limits.max_layers`")]
    TooManyLayers { most: usize },
    /// Another layer of the case has the name.
    #[error("another layer of the case has this name; choose another name")]
    LayerNameTaken,
    /// The case has no maps.
    #[error(transparent)]
    MapsUndefined(NoMaps),
    /// The case has only the surface of the whole brain.
    #[error(transparent)]
    NoSurfaces(NoSurfaces),
    /// The input cannot be used, as found now or during its preparation.
    #[error(transparent)]
    Failure(#[from] Failure),
    /// A parameter of a request is invalid.
    #[error("`{name}` {detail}")]
    Parameter {
        /// The stable name of the error, in kebab case.
        kind: &'static str,
        /// The parameter.
        name: Cow<'static, str>,
        /// The error, as a sentence that begins with its verb.
        detail: String,
    },
    /// The geometry rejects the parameters.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
    /// Too much work is waiting.
    #[error("too much work is waiting; try again in a moment")]
    Busy,
    /// Too much work is waiting, and about how long that will take.
    #[error("too much work is waiting; try again in {} s", .0.as_secs_f64().ceil().max(1.0))]
    BusyFor(Duration),
    /// A stored upload that the request needs is missing. It may be back in a moment, if somebody mounts a folder.
    #[error("{}", StoreError::SourceMissing)]
    SourceMissing,
    /// The server is stopping, or its store is unreachable.
    #[error("the server cannot answer now; try again in a moment")]
    Unavailable,
    /// The database and the objects do not belong to one store.
    #[error("{0}")]
    Mismatch(storage::Mismatch),
    /// The store is full.
    #[error("the store is full; delete cases, or enlarge its disk")]
    StorageFull,
    /// The disk of the store has room, but cannot be written. The cause is for the log.
    #[error(
        "the disk of the server failed: cases can be viewed, but nothing can be stored; check the disk"
    )]
    StorageFailed(#[source] StoreError),
    /// The store failed.
    #[error(transparent)]
    Store(StoreError),
    /// An internal error.
    #[error("internal error; see the server's log for this request id")]
    Internal,
}

impl Error {
    /// A parameter outside its range.
    pub fn out_of_range(name: &'static str, detail: impl Into<String>) -> Self {
        Self::Parameter {
            kind: "query-value-out-of-range",
            name: name.into(),
            detail: detail.into(),
        }
    }
}

impl From<ObjectError> for Error {
    fn from(error: ObjectError) -> Self {
        StoreError::from(error).into()
    }
}

impl From<StoreError> for Error {
    fn from(error: StoreError) -> Self {
        match error {
            StoreError::QueueFull(wait) => Self::BusyFor(wait),
            StoreError::NoSuchCase => Self::NoSuchCase,
            StoreError::SourceMissing => Self::SourceMissing,
            StoreError::LayerNameTaken => Self::LayerNameTaken,
            StoreError::Mismatch(found) => Self::Mismatch(found),
            full if full.is_full() => Self::StorageFull,
            failed if failed.is_unwritable() => Self::StorageFailed(failed),
            away if away.is_away() => {
                tracing::warn!(
                    error = &away as &dyn std::error::Error,
                    "the store is unreachable"
                );
                Self::Unavailable
            }
            other => Self::Store(other),
        }
    }
}

impl From<ModelError> for Error {
    fn from(error: ModelError) -> Self {
        match error {
            ModelError::NoSurfaces(reason) => Self::NoSurfaces(reason),
            ModelError::Store(error) => error.into(),
        }
    }
}

impl From<PathsError> for Error {
    fn from(error: PathsError) -> Self {
        match error {
            PathsError::Deleted => Self::NoSuchCase,
            PathsError::Store(error) => error.into(),
            PathsError::Geometry(error) => error.into(),
        }
    }
}

impl From<RenderError> for Error {
    fn from(error: RenderError) -> Self {
        let name = match error {
            RenderError::Parameter { name, .. } | RenderError::UnknownName { name, .. } => name,
            RenderError::TooManyContours { .. } => "depth_mm",
            _ => return Self::Internal,
        };
        // `window centre` and `window width` both belong to the key `window`; the rest of the name stays in the
        // sentence.
        let key = name.split(' ').next().unwrap_or(name);
        let text = error.to_string();
        let detail = match text.strip_prefix(key) {
            Some(rest) => rest.trim_start().to_owned(),
            None => text,
        };
        Self::out_of_range(key, detail)
    }
}
