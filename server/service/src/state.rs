//! What every handler can reach.

use std::ops::Deref;
use std::sync::Arc;
use std::time::Duration;

use case::CaseId;
use cases::models::WarmModel;
use cases::{Cases, Error};
use tokio::sync::{Semaphore, SemaphorePermit, watch};

use crate::auth::Access;
use crate::metrics::Metrics;
use crate::problem::AppError;
use crate::routes::bodies::Bodies;

/// What HTTP may ask of the server, and who may ask.
#[derive(Debug, Clone)]
pub struct HttpOptions {
    /// Who may ask.
    pub access: Access,
    /// The largest accepted upload, in bytes.
    pub max_upload_bytes: u64,
    /// Uploads at a time.
    pub max_uploads: usize,
    /// Memory for compressed bodies, in bytes.
    pub body_cache_bytes: u64,
    /// Time for an answer.
    pub answer_timeout: Duration,
    /// Time within which the next bytes of an upload must come.
    pub upload_idle: Duration,
    /// Time for a whole upload.
    pub upload_timeout: Duration,
}

/// What handlers share. Cheap to clone: everything is behind one `Arc`.
///
/// Nothing in it is needed to answer: caches are filled from the store, so a restarted server gives the same bytes.
#[derive(Debug, Clone)]
pub struct AppState(Arc<Shared>);

/// The fields of [`AppState`].
#[derive(Debug)]
pub struct Shared {
    /// The application.
    pub cases: Cases,
    /// Bodies that are made once, compressed.
    pub bodies: Bodies,
    /// Counts for Prometheus.
    pub metrics: Metrics,
    /// Who may ask.
    pub access: Access,
    /// Room for uploads under way.
    pub uploads: Semaphore,
    /// The largest accepted upload, in bytes.
    pub max_upload_bytes: u64,
    /// Time for an answer.
    pub answer_timeout: Duration,
    /// Time within which the next bytes of an upload must come.
    pub upload_idle: Duration,
    /// Time for a whole upload.
    pub upload_timeout: Duration,
    stopping: watch::Sender<bool>,
}

impl Deref for AppState {
    type Target = Shared;

    fn deref(&self) -> &Shared {
        &self.0
    }
}

impl AppState {
    /// What handlers share to answer for an application.
    pub fn new(cases: Cases, options: HttpOptions) -> Self {
        let shared = Arc::new(Shared {
            bodies: Bodies::new(cases.pool.clone(), options.body_cache_bytes),
            cases,
            metrics: Metrics::new(),
            access: options.access,
            uploads: Semaphore::new(options.max_uploads),
            max_upload_bytes: options.max_upload_bytes,
            answer_timeout: options.answer_timeout,
            upload_idle: options.upload_idle,
            upload_timeout: options.upload_timeout,
            stopping: watch::Sender::new(false),
        });
        // Whoever deletes the case, this server or another one.
        let state = Arc::downgrade(&shared);
        shared.cases.store().on_delete(move |id| {
            if let Some(state) = state.upgrade() {
                state.forget(id);
            }
        });
        Self(shared)
    }
}

impl Shared {
    /// The model of a case that is ready.
    ///
    /// # Errors
    /// As [`Cases::ready`].
    pub async fn model(&self, id: &CaseId) -> Result<Arc<WarmModel>, AppError> {
        let model = self.cases.model(id).await;
        if model.is_err() {
            self.bodies.forget(id);
        }
        Ok(model?)
    }

    /// Room for one more upload, until it is dropped. They are fewer than connections: uploads leave room for everybody else.
    ///
    /// # Errors
    /// [`Error::Busy`].
    pub fn begin_upload(&self) -> Result<SemaphorePermit<'_>, AppError> {
        self.uploads.try_acquire().map_err(|_| Error::Busy.into())
    }

    /// Forgets what is remembered of a case.
    pub fn forget(&self, id: &CaseId) {
        self.cases.forget(id);
        self.bodies.forget(id);
    }

    /// Ends answers that would go on for ever, such as streams of events.
    pub fn stop(&self) {
        self.stopping.send_replace(true);
    }

    /// Resolves when the server stops.
    pub fn stopped(&self) -> impl Future<Output = ()> + Send + use<> {
        let mut stopping = self.stopping.subscribe();
        async move {
            // An error means that the sender is gone, and the server with it.
            let _ = stopping.wait_for(|&stopping| stopping).await;
        }
    }
}
