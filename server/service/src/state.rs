//! The state that handlers share, by concern; a route names the parts that it needs.

use std::sync::Arc;
use std::time::Duration;

use axum::extract::{FromRef, Request};
use case::Client;
use cases::{Cases, Error};
use http::client_limit::{ClientLimit, ClientPermit};
use tokio::sync::watch;

use crate::routes::bodies::Bodies;
use access::audit::Audit;
use access::auth::Access;
use access::origins::Origins;
use http::listen::client_of;
use http::metrics::Metrics;
use http::problem::AppError;
use http::uploads::UploadLimits;

/// What HTTP may ask of the server, and who may ask.
#[derive(Debug, Clone)]
pub struct HttpOptions {
    pub access: Access,
    /// What uploads may take.
    pub uploads: UploadLimits,
    /// Time for an answer.
    pub answer_timeout: Duration,
    /// Origins in whose frames the page may stand, beside its own.
    pub frame_ancestors: Origins,
    /// Whether metrics, version and documents need a token too.
    pub guard_all: bool,
    /// The record of who does what.
    pub audit: Audit,
}

/// Everything that handlers share. Cheap to clone.
///
/// It holds no answers of its own: caches are filled from the store, so a restarted server gives the same bytes.
#[derive(Debug, Clone, FromRef)]
pub struct AppState {
    pub cases: Cases,
    bodies: Bodies,
    metrics: Metrics,
    access: Access,
    audit: Audit,
    uploads: Uploads,
    streams: EventStreams,
    answer_timeout: AnswerTimeout,
    frame_ancestors: FrameAncestors,
    guard_all: GuardAll,
}

/// Origins in whose frames the page may stand, beside its own.
#[derive(Debug, Clone)]
pub(crate) struct FrameAncestors(pub(crate) Origins);

/// Whether metrics, version and documents need a token too.
#[derive(Debug, Clone, Copy)]
pub(crate) struct GuardAll(pub(crate) bool);

impl AppState {
    /// What handlers share to answer for an application.
    pub fn new(cases: Cases, options: HttpOptions) -> Self {
        let metrics = Metrics::new();
        Self {
            bodies: Bodies::new(&cases),
            uploads: Uploads::new(options.uploads, metrics.clone()),
            cases,
            metrics,
            access: options.access,
            audit: options.audit,
            streams: EventStreams::new(),
            answer_timeout: AnswerTimeout(options.answer_timeout),
            frame_ancestors: FrameAncestors(options.frame_ancestors),
            guard_all: GuardAll(options.guard_all),
        }
    }

    pub fn metrics(&self) -> &Metrics {
        &self.metrics
    }

    pub fn access(&self) -> &Access {
        &self.access
    }

    /// The record of who does what.
    pub fn audit(&self) -> &Audit {
        &self.audit
    }

    /// What tells endless answers to end.
    pub fn stopping(&self) -> &Stopping {
        &self.streams.stopping
    }
}

/// Room for uploads. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Uploads {
    /// What each may take.
    pub limits: UploadLimits,
    /// The counter of their bytes.
    pub metrics: Metrics,
    room: ClientLimit,
}

impl Uploads {
    fn new(limits: UploadLimits, metrics: Metrics) -> Self {
        Self {
            room: ClientLimit::new(limits.at_a_time),
            limits,
            metrics,
        }
    }

    /// Room for one more upload, until it is dropped. There is room for fewer uploads than connections, so that uploads
    /// do not block others, and one client may take a quarter of it.
    ///
    /// # Errors
    /// [`Error::Busy`].
    pub fn begin(&self, request: &Request) -> Result<ClientPermit, AppError> {
        let permit = self.room.try_acquire(client_of(request.extensions()));
        permit.ok_or_else(|| Error::Busy.into())
    }
}

/// Streams of events at a time.
const EVENT_STREAMS: usize = 256;

/// What streams of events share. Cheap to clone.
#[derive(Debug, Clone)]
pub struct EventStreams {
    /// When they end.
    pub stopping: Stopping,
    room: ClientLimit,
}

impl EventStreams {
    fn new() -> Self {
        Self {
            stopping: Stopping::default(),
            room: ClientLimit::new(EVENT_STREAMS),
        }
    }

    /// Room for one more stream, until it is dropped. One client may take a quarter of it.
    ///
    /// # Errors
    /// [`Error::Busy`].
    pub fn begin(&self, client: Client) -> Result<ClientPermit, AppError> {
        self.room
            .try_acquire(client)
            .ok_or_else(|| Error::Busy.into())
    }
}

/// Whether the server is about to stop. Cheap to clone.
#[derive(Debug, Clone, Default)]
pub struct Stopping(Arc<watch::Sender<bool>>);

impl Stopping {
    /// Ends answers that would go on for ever, such as streams of events.
    pub fn begin(&self) {
        self.0.send_replace(true);
    }

    /// Resolves when the server stops.
    pub fn begun(&self) -> impl Future<Output = ()> + Send + use<> {
        let mut stopping = self.0.subscribe();
        async move {
            // An error means that the sender is gone, and the server with it.
            let _ = stopping.wait_for(|&stopping| stopping).await;
        }
    }
}

/// The time limit of an answer.
#[derive(Debug, Clone, Copy)]
pub struct AnswerTimeout(pub Duration);
