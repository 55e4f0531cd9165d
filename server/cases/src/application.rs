//! Everything that a protocol needs to serve cases.

use std::fmt;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use case::{Case, CaseFacts, CaseId, CaseState, QualityState};
use imaging::Limits;
use pipeline::{Extractor, HeadLimits, NoNetwork, Pipeline};
use quick_cache::sync::Cache;
use storage::{Store, StoreError};

use crate::dicom::{DicomReader, Program};
use crate::error::Error;
use crate::library::Library;
use crate::limit::ConcurrencyLimit;
use crate::models::{Models, WarmModel};
use crate::pictures::{Graphics, GraphicsOptions};
use crate::room::RoomToCheck;

/// How many cases are remembered to be ready.
const REMEMBERED_CASES: usize = 4096;

/// For how long: another server on the same store may delete a case.
const REMEMBERED_FOR: Duration = Duration::from_secs(10);

/// How the application is set up.
#[derive(Debug, Clone)]
pub struct Options {
    /// The directory of the store.
    pub data: PathBuf,
    /// How the store behaves.
    pub store: storage::Options,
    /// The weights of the network that extracts brains; by default those beside the program.
    pub network: Option<PathBuf>,
    /// What uploads may ask for.
    pub limits: Limits,
    /// What the volume of a head may measure.
    pub head: HeadLimits,
    /// Pictures, meshes and the like at work at a time.
    pub render_threads: usize,
    /// How many more may wait.
    pub max_queued_renders: usize,
    /// Memory for warm cases, in bytes.
    pub model_cache_bytes: u64,
    /// The graphics device.
    pub graphics: GraphicsOptions,
    /// The program that reads DICOM files.
    pub dicom_program: Program,
    /// The most bytes of the DICOM files of an upload, unpacked.
    pub max_dicom_bytes: u64,
}

/// Why the application cannot start.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// The network's weights cannot be used.
    #[error(transparent)]
    Network(#[from] NoNetwork),
    /// The store cannot be opened.
    #[error("the store cannot be opened: {0}")]
    Store(#[from] StoreError),
}

/// Everything that a protocol needs to serve cases. Cheap to clone.
///
/// Nothing in it is needed to answer: caches are filled from the store, so a restarted server gives the same bytes.
#[derive(Debug, Clone)]
pub struct Cases {
    /// Cases on disk, and what prepares them.
    pub library: Library,
    /// Cases in memory.
    pub models: Models,
    /// The one queue for pictures, meshes and whatever else keeps a processor busy for a client.
    pub queue: ConcurrencyLimit,
    /// The graphics device, if there is one.
    pub graphics: Graphics,
    /// Where DICOM files are read.
    pub dicom: Arc<DicomReader>,
    pub(crate) checks: RoomToCheck,
    ready: Arc<Cache<CaseId, (Instant, Arc<CaseFacts>)>>,
    forget_hooks: Arc<ForgetHooks>,
}

type ForgetHook = Box<dyn Fn(&CaseId) + Send + Sync>;

/// Who else remembers something of cases. Held for moments.
#[derive(Default)]
struct ForgetHooks(Mutex<Vec<ForgetHook>>);

impl ForgetHooks {
    fn lock(&self) -> MutexGuard<'_, Vec<ForgetHook>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl fmt::Debug for ForgetHooks {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "ForgetHooks({})", self.lock().len())
    }
}

impl Cases {
    /// Opens the store. No case is prepared until workers are started on the library.
    ///
    /// # Errors
    /// When the store or the network cannot be opened.
    pub async fn open(options: Options) -> Result<Self, StartError> {
        let extractor = Extractor::open(options.network.as_deref())?;
        tracing::info!("brains are extracted {}", extractor.words());
        let store = Store::open_with(&options.data, options.store.clone()).await?;
        let library = Library::new(store, Pipeline::new(extractor).into(), options.limits);
        Ok(Self::on(library, &options))
    }

    /// The application on a library.
    pub(crate) fn on(library: Library, options: &Options) -> Self {
        let dicom = DicomReader::new(
            options.dicom_program.clone(),
            options.limits,
            options.max_dicom_bytes,
        );
        Self {
            models: Models::new(library.clone(), options.model_cache_bytes),
            library,
            queue: ConcurrencyLimit::new(options.render_threads, options.max_queued_renders),
            graphics: Graphics::start(options.graphics),
            dicom: Arc::new(dicom),
            checks: RoomToCheck::new(options.head, options.limits),
            ready: Arc::new(Cache::new(REMEMBERED_CASES)),
            forget_hooks: Arc::default(),
        }
    }

    /// Where the cases are.
    pub fn store(&self) -> &Store {
        self.library.store()
    }

    /// A case.
    ///
    /// # Errors
    /// [`Error::NoSuchCase`], or the store's.
    pub async fn case(&self, id: &CaseId) -> Result<Case, Error> {
        self.store().case(id).await?.ok_or(Error::NoSuchCase)
    }

    /// The facts of a case that is ready.
    ///
    /// # Errors
    /// [`Error::NoSuchCase`], [`Error::NotReady`], the failure of a failed case, or the store's.
    pub async fn ready(&self, id: &CaseId) -> Result<Arc<CaseFacts>, Error> {
        if let Some((since, facts)) = self.ready.get(id)
            && since.elapsed() < REMEMBERED_FOR
        {
            return Ok(facts);
        }
        let case = self.case(id).await?;
        match (case.state, case.facts, case.failure) {
            (CaseState::Ready, Some(facts), _) => {
                let facts = Arc::new(facts);
                self.ready.insert(*id, (Instant::now(), Arc::clone(&facts)));
                Ok(facts)
            }
            (CaseState::Failed, _, Some(failure)) => Err(failure.into()),
            (state, ..) => Err(Error::NotReady { state }),
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
    /// As [`Cases::ready`].
    pub async fn model(&self, id: &CaseId) -> Result<Arc<WarmModel>, Error> {
        if let Some(model) = self.models.get(id).await? {
            return Ok(model);
        }
        // It was ready a moment ago, but is deleted or, with its source lost, failed by now.
        self.forget(id);
        self.ready(id).await?;
        Err(Error::Unavailable)
    }

    /// Removes a case and what no other case needs; `false` if there was none.
    ///
    /// # Errors
    /// As [`Store::delete`].
    pub async fn delete(&self, id: &CaseId) -> Result<bool, Error> {
        let deleted = self.store().delete(id).await;
        self.forget(id);
        Ok(deleted?)
    }

    /// Calls `hook` whenever a case turns out to be gone, or is removed by this process.
    pub fn on_forget(&self, hook: impl Fn(&CaseId) + Send + Sync + 'static) {
        self.forget_hooks.lock().push(Box::new(hook));
    }

    fn forget(&self, id: &CaseId) {
        self.ready.remove(id);
        for hook in self.forget_hooks.lock().iter() {
            hook(id);
        }
    }
}
