//! Why the application could not do what was asked, without the words of any protocol.

use std::borrow::Cow;

use case::{CaseState, Failure};
use geometry::GeometryError;
use render::RenderError;
use storage::StoreError;

use crate::models::PathsError;

/// Why the application could not do what was asked. The sentences are fit for clients, but for [`Error::Store`].
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// No such case.
    #[error("there is no case with this id")]
    NoSuchCase,
    /// The case is still on its way.
    #[error("the case is not ready yet: it is {}", .state.name())]
    NotReady {
        /// How far it has come.
        state: CaseState,
    },
    /// The maps of the case are being made.
    #[error("the maps of this case are being made; try again in a moment")]
    LayerNotReady,
    /// The case has no maps.
    #[error("{reason}")]
    MapsUndefined {
        /// Why: a sentence.
        reason: String,
    },
    /// The input cannot be used, now or when it was prepared.
    #[error(transparent)]
    Failure(#[from] Failure),
    /// A parameter of what was asked for is not accepted.
    #[error("`{name}` {detail}")]
    Parameter {
        /// A stable name of what is wrong, in kebab case.
        kind: &'static str,
        /// Which parameter.
        name: Cow<'static, str>,
        /// What is wrong with it: a sentence that begins with its verb.
        detail: String,
    },
    /// A step of the geometry refuses the parameters.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
    /// Too much work waits already.
    #[error("too much work is waiting; try again in a moment")]
    Busy,
    /// The server is stopping, or its store cannot be reached.
    #[error("the server cannot answer now; try again in a moment")]
    Unavailable,
    /// The store has no room left.
    #[error("the store has no room left: cases must be deleted, or its disk enlarged")]
    StorageFull,
    /// The store failed.
    #[error(transparent)]
    Store(StoreError),
    /// A fault of the program.
    #[error("the server failed at this request; its log says more under the request id")]
    Internal,
}

impl Error {
    /// A parameter that is out of its range.
    pub fn out_of_range(name: &'static str, detail: impl Into<String>) -> Self {
        Self::Parameter {
            kind: "query-value-out-of-range",
            name: name.into(),
            detail: detail.into(),
        }
    }
}

impl From<StoreError> for Error {
    fn from(error: StoreError) -> Self {
        match error {
            StoreError::QueueFull => Self::Busy,
            full if full.is_full() => Self::StorageFull,
            away if away.is_away() => {
                tracing::warn!(error = &away as &dyn std::error::Error, "the store is away");
                Self::Unavailable
            }
            other => Self::Store(other),
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
        // `window centre` and `window width` are both of the key `window`: the rest of the name stays in the sentence.
        let key = name.split(' ').next().unwrap_or(name);
        let text = error.to_string();
        let detail = match text.strip_prefix(key) {
            Some(rest) => rest.trim_start().to_owned(),
            None => text,
        };
        Self::out_of_range(key, detail)
    }
}
