//! What every handler can reach.

use std::ops::Deref;
use std::sync::Arc;
use std::time::{Duration, Instant};

use quick_cache::sync::Cache;
use tokio::sync::{Semaphore, SemaphorePermit, watch};

use crate::auth::Access;
use crate::case::{CaseFacts, CaseId, CaseState};
use crate::config::{Config, ConfigError};
use crate::dicom::DicomReader;
use crate::graphics::{Graphics, GraphicsOptions};
use crate::metrics::Metrics;
use crate::models::{Model, Models};
use crate::prepare::{Extractor, Limits, NoNetwork, Pipeline};
use crate::problem::AppError;
use crate::quality::QualityState;
use crate::render_pool::RenderPool;
use crate::routes::bodies::Bodies;
use crate::store::{Options, Store, StoreError};
use crate::turnstile::Turnstile;

/// How many cases are remembered to be ready.
const REMEMBERED_CASES: usize = 4096;

/// For how long: another server on the same store may delete a case.
const REMEMBERED_FOR: Duration = Duration::from_secs(10);

/// How much more than an upload the DICOM files in it may take when they are unpacked.
const DICOM_UNPACKING: u64 = 4;

/// What handlers share. Cheap to clone: everything is behind one `Arc`.
///
/// Nothing in it is needed to answer: caches are filled from the store, so a restarted server gives the same bytes.
#[derive(Debug, Clone)]
pub struct AppState(Arc<Shared>);

/// The fields of [`AppState`].
#[derive(Debug)]
pub struct Shared {
    /// Cases on disk.
    pub store: Store,
    /// Cases in memory.
    pub models: Models,
    /// Threads for rendering, encoding and compressing.
    pub pool: RenderPool,
    /// The graphics device, if there is one.
    pub graphics: Graphics,
    /// Bodies that are made once, compressed.
    pub bodies: Bodies,
    /// Where DICOM files are read.
    pub dicom: DicomReader,
    /// Counts for Prometheus.
    pub metrics: Metrics,
    /// Who may ask.
    pub access: Access,
    /// Work that the store does for a request.
    pub turnstile: Turnstile,
    /// Room for uploads under way.
    pub uploads: Semaphore,
    /// What uploads may ask for.
    pub upload_limits: Limits,
    /// The largest accepted upload, in bytes.
    pub max_upload_bytes: u64,
    /// Time for an answer.
    pub answer_timeout: Duration,
    /// Time within which the next bytes of an upload must come.
    pub upload_idle: Duration,
    /// Time for a whole upload.
    pub upload_timeout: Duration,
    ready: Cache<CaseId, (Instant, Arc<CaseFacts>)>,
    stopping: watch::Sender<bool>,
}

impl Deref for AppState {
    type Target = Shared;

    fn deref(&self) -> &Shared {
        &self.0
    }
}

/// Why a server cannot start.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// The configuration is not right.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The network's weights cannot be used.
    #[error(transparent)]
    Network(#[from] NoNetwork),
    /// The store cannot be opened.
    #[error("the store cannot be opened: {0}")]
    Store(#[from] StoreError),
    /// The system gives no threads.
    #[error("the render threads cannot be started: {0}")]
    Threads(std::io::Error),
}

impl AppState {
    /// Opens the store and starts the render threads. No case is prepared until workers are started on [`Shared::store`].
    ///
    /// # Errors
    /// When the configuration is not right, or the store cannot be opened.
    pub async fn open(config: &Config) -> Result<Self, StartError> {
        config.check()?;
        let access = config.access()?;
        let extractor = Extractor::open(config.network.as_deref())?;
        tracing::info!("brains are extracted {}", extractor.words());
        let options = Options {
            preparation: Arc::new(Pipeline::new(extractor)),
            queue_limit: config.max_queued_cases,
            min_free_bytes: config.min_free_bytes,
            limits: Limits {
                max_voxels: config.max_voxels,
                ..Limits::default()
            },
            ..Options::default()
        };
        let upload_limits = options.limits;
        let store = Store::open_with(&config.data, options).await?;
        let turnstile = Turnstile::new(config.render_threads, config.max_queued_renders);
        let pool = RenderPool::start(config.render_threads, config.max_queued_renders)
            .map_err(StartError::Threads)?;
        Ok(Self(Arc::new(Shared {
            models: Models::new(store.clone(), config.model_cache_bytes),
            store,
            bodies: Bodies::new(pool.clone(), config.body_cache_bytes),
            graphics: Graphics::start(GraphicsOptions {
                use_of: config.gpu,
                drawers: config.render_threads,
                case_bytes: config.gpu_case_bytes,
            }),
            dicom: DicomReader::new(
                config.dicom_program.clone(),
                upload_limits,
                config.max_upload_bytes.saturating_mul(DICOM_UNPACKING),
            ),
            pool,
            turnstile,
            uploads: Semaphore::new(config.max_uploads),
            upload_limits,
            metrics: Metrics::new(),
            access,
            max_upload_bytes: config.max_upload_bytes,
            answer_timeout: Duration::from_secs(config.answer_timeout_secs),
            upload_idle: Duration::from_secs(config.upload_idle_secs),
            upload_timeout: Duration::from_secs(config.upload_timeout_secs),
            ready: Cache::new(REMEMBERED_CASES),
            stopping: watch::Sender::new(false),
        })))
    }
}

impl Shared {
    /// The facts of a case that is ready.
    ///
    /// # Errors
    /// [`AppError::NoSuchCase`], [`AppError::NotReady`], the failure of a failed case, or the store's.
    pub async fn ready(&self, id: &CaseId) -> Result<Arc<CaseFacts>, AppError> {
        if let Some((since, facts)) = self.ready.get(id)
            && since.elapsed() < REMEMBERED_FOR
        {
            return Ok(facts);
        }
        let case = self.store.case(id).await?.ok_or(AppError::NoSuchCase)?;
        match (case.state, case.facts, case.failure) {
            (CaseState::Ready, Some(facts), _) => {
                let facts = Arc::new(facts);
                self.ready.insert(*id, (Instant::now(), Arc::clone(&facts)));
                Ok(facts)
            }
            (CaseState::Failed, _, Some(failure)) => Err(failure.into()),
            (state, ..) => Err(AppError::NotReady { state }),
        }
    }

    /// The verdict on the mask of a case that was asked about a moment ago.
    pub fn known_quality(&self, id: &CaseId) -> Option<QualityState> {
        let (_, facts) = self.ready.get(id)?;
        facts.quality.as_ref().map(|quality| quality.state)
    }

    /// The model of a case that is ready.
    ///
    /// # Errors
    /// As [`Shared::ready`].
    pub async fn model(&self, id: &CaseId) -> Result<Arc<Model>, AppError> {
        if let Some(model) = self.models.get(id).await? {
            return Ok(model);
        }
        // It was ready a moment ago, but is deleted or, with its source lost, failed by now.
        self.forget(id);
        self.ready(id).await?;
        Err(AppError::Unavailable)
    }

    /// Room for one more upload, until it is dropped. They are fewer than connections: uploads leave room for everybody else.
    ///
    /// # Errors
    /// [`AppError::Busy`].
    pub fn begin_upload(&self) -> Result<SemaphorePermit<'_>, AppError> {
        self.uploads.try_acquire().map_err(|_| AppError::Busy)
    }

    /// Forgets what is remembered of a case.
    pub fn forget(&self, id: &CaseId) {
        self.ready.remove(id);
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
