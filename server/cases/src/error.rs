//! Errors of the application, independent of any protocol.

use std::borrow::Cow;
use std::time::Duration;

use case::{CaseState, Closed, ErrorKind, Failure, INTERNAL, PublicError};
use geometry::GeometryError;
use pipeline::Undefined;
use render::RenderError;
use storage::{ObjectError, STORE_AWAY, StoreError};

/// An error of the application. The sentences may be shown to clients, except for [`Error::Store`].
#[derive(Debug, thiserror::Error)]
pub enum Error {
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
    #[error("the case has no layer with this name; `/v1/cases/{{id}}/layers` lists its layers")]
    NoSuchLayer,
    #[error("the case has no such reading; `/v1/cases/{{id}}/readings` lists its readings")]
    NoSuchReading,
    /// Somebody asks for the reading of somebody else before they have signed their own.
    #[error("the reading of another reader is shown to those who have signed their own")]
    ReadingHidden,
    /// Somebody signs what they have signed.
    #[error("this version of the reading is signed already; a change begins the next one")]
    ReadingSigned,
    /// The case has no maps.
    #[error(transparent)]
    MapsUndefined(Undefined),
    /// The case has only the surface of the whole brain.
    #[error("only the whole brain has a surface: {0}")]
    NoSurfaces(Undefined),
    /// The input cannot be used, as found now or during its preparation.
    #[error(transparent)]
    Failure(#[from] Failure),
    /// A parameter of a request is invalid.
    #[error("`{name}` {detail}")]
    Parameter {
        /// The stable name of the error, in kebab case.
        kind: &'static str,
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
    #[error("{}", StoreError::QueueFull(*.0))]
    BusyFor(Duration),
    /// The server is stopping, or its store does not answer in time.
    #[error("{STORE_AWAY}")]
    Unavailable,
    /// What else the store reports, as it reports it.
    #[error(transparent)]
    Store(StoreError),
    #[error("{INTERNAL}")]
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

/// When to ask again for what is being prepared.
const READY_AFTER: Duration = Duration::from_secs(2);

impl PublicError for Error {
    fn kind(&self) -> ErrorKind {
        match self {
            Self::Parameter { .. } => ErrorKind::Invalid,
            Self::NoSuchCase | Self::NoSuchLayer | Self::NoSuchReading => ErrorKind::NotFound,
            Self::NotReady { .. }
            | Self::LayerNotReady
            | Self::LayerClosed(_)
            | Self::ReadingHidden
            | Self::ReadingSigned
            | Self::MapsUndefined(_)
            | Self::NoSurfaces(_) => ErrorKind::Conflict,
            Self::Failure(failure) => failure.kind(),
            Self::Geometry(_) => ErrorKind::Unusable,
            Self::Busy | Self::BusyFor(_) | Self::Unavailable => ErrorKind::Unavailable,
            Self::Store(error) => error.kind(),
            Self::Internal => ErrorKind::Internal,
        }
    }

    fn name(&self) -> Cow<'static, str> {
        let name = match self {
            Self::NoSuchCase => "no-such-case",
            Self::NotReady { .. } => "case-not-ready",
            Self::LayerNotReady => "layer-not-ready",
            Self::LayerClosed(_) => "closed",
            Self::NoSuchLayer => "no-such-layer",
            Self::NoSuchReading => "no-such-reading",
            Self::ReadingHidden => "reading-hidden",
            Self::ReadingSigned => "reading-signed",
            Self::MapsUndefined(_) => "maps-undefined",
            Self::NoSurfaces(_) => "no-surfaces",
            Self::Failure(failure) => return failure.name(),
            Self::Parameter { kind, .. } => kind,
            Self::Geometry(_) => "geometry",
            Self::Busy | Self::BusyFor(_) => "busy",
            Self::Unavailable => "unavailable",
            Self::Store(error) => return error.name(),
            Self::Internal => "internal",
        };
        name.into()
    }

    fn sentence(&self) -> String {
        match self {
            Self::Store(error) => error.sentence(),
            // The parameter `.` is the whole body.
            Self::Parameter { name, detail, .. } if name == "." => format!("the body {detail}"),
            other => other.to_string(),
        }
    }

    fn parameter(&self) -> Option<&str> {
        match self {
            Self::Parameter { name, .. } => Some(name),
            _ => None,
        }
    }

    fn reason(&self) -> Option<String> {
        match self {
            Self::NoSurfaces(reason) => Some(reason.code.to_string()),
            _ => None,
        }
    }

    fn retry_after(&self) -> Option<Duration> {
        match self {
            Self::NotReady { .. } | Self::LayerNotReady => Some(READY_AFTER),
            Self::BusyFor(wait) => Some(*wait),
            Self::Store(error) => error.retry_after(),
            _ => None,
        }
    }

    fn hidden_cause(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Store(error) => error.hidden_cause(),
            _ => None,
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
            StoreError::NoSuchLayer => Self::NoSuchLayer,
            error => {
                if error.is_unusable() {
                    tracing::warn!(
                        error = &error as &dyn std::error::Error,
                        "the store cannot be used"
                    );
                }
                Self::Store(error)
            }
        }
    }
}

impl From<worker::Error> for Error {
    fn from(error: worker::Error) -> Self {
        match error {
            worker::Error::Failure(failure) => Self::Failure(failure),
            worker::Error::Interrupted => Self::Unavailable,
            worker::Error::NotRun => Self::Internal,
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failing_disk_shows_no_path() {
        let disk = std::io::Error::other("/home/someone/store is full");
        let error = Error::from(StoreError::Disk(disk));
        assert_eq!(error.kind(), ErrorKind::Full);
        assert_eq!(error.name(), "storage-failed");
        assert!(!error.sentence().contains("/home"));
    }

    #[test]
    fn an_error_of_the_store_is_told_as_the_store_tells_it() {
        let disk = |kind| StoreError::Disk(std::io::Error::from(kind));
        let errors: [fn() -> StoreError; 6] = [
            || StoreError::NoSuchCase,
            || StoreError::NoSuchLayer,
            || StoreError::SourceMissing,
            || StoreError::LayerNameTaken,
            || StoreError::TooManyLayers,
            || StoreError::QueueFull(Duration::from_millis(8300)),
        ];
        let told = |error: &dyn PublicError| {
            let words = (error.name(), error.sentence(), error.retry_after());
            (error.kind(), words, error.hidden_cause().is_some())
        };
        for error in errors {
            assert_eq!(told(&Error::from(error())), told(&error()));
        }
        for kind in [std::io::ErrorKind::StorageFull, std::io::ErrorKind::Other] {
            assert_eq!(told(&Error::from(disk(kind))), told(&disk(kind)));
        }
    }

    #[test]
    fn a_full_queue_says_when_to_come_again() {
        let wait = Duration::from_secs(20);
        let error = Error::from(StoreError::QueueFull(wait));
        assert_eq!(error.retry_after(), Some(wait));
    }
}
