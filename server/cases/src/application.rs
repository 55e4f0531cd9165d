//! The application, which a protocol needs to serve cases.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use case::{Case, CaseFacts, CaseId, CaseState, Failure, QualityState, SurfaceName};
use geometry::Volume;
use pipeline::atlas::{Atlas, NoAtlas};
use pipeline::{Extractor, HeadLimits, NoNetwork, Pipeline};
use quick_cache::sync::Cache;
use storage::{Location, Store, StoreError};
use worker::{ChildBudget, FileReader, PrepareProcess, Program};

use crate::cache::Part;
use crate::check_memory::CheckMemory;
use crate::dicom::{DicomReader, HeaderReader};
use crate::error::Error;
use crate::library::{Library, LibraryOptions, Preparation};
use crate::limit::ConcurrencyLimit;
use crate::models::{Models, WarmModel};
use crate::pictures::{Graphics, PictureRequest};
use crate::removal::BeforeRemoval;
use crate::settings::{Limits, MapsUse, Prepare, Render, cores};

/// The number of cases that are remembered as ready.
const REMEMBERED_CASES: usize = 4096;

/// How long a case is remembered as ready; another server on the same store may delete it.
pub(crate) const REMEMBERED_FOR: Duration = Duration::from_secs(2);

/// The same if the database is unreachable.
pub(crate) const REMEMBERED_WHILE_AWAY: Duration = Duration::from_secs(600);

/// The options of the application.
#[derive(Debug, Clone)]
pub struct Options {
    /// The location of the store.
    pub location: Location,
    /// The options of the store.
    pub store: storage::Options,
    pub limits: Limits,
    pub prepare: Prepare,
    pub render: Render,
    /// What the processes that read files and prepare cases may use.
    pub children: ChildBudget,
    /// Whether each preparation runs in a process of its own, which is `dicom_program`.
    pub prepares_apart: bool,
    /// The program that reads DICOM files.
    pub dicom_program: Program,
    /// Whether no identity of a patient is kept.
    pub deidentify: bool,
    /// What is told of each expired case before it is removed.
    pub before_removal: BeforeRemoval,
}

/// The reason why the application cannot start.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// The weights of the network cannot be used.
    #[error(transparent)]
    Network(#[from] NoNetwork),
    /// The atlas cannot be used.
    #[error(transparent)]
    Atlas(#[from] NoAtlas),
    /// The store cannot be opened.
    #[error("the store cannot be opened: {0}")]
    Store(#[from] StoreError),
}

/// Opens the store and the preparation of its cases.
///
/// # Errors
/// If the store or the network cannot be opened.
pub async fn open_library(options: &Options) -> Result<Library, StartError> {
    let extractor = Extractor::open(options.prepare.network.as_deref())?;
    let store = Store::open(options.location.clone(), options.store.clone()).await?;
    library_on(store, extractor, options)
}

/// The preparation of the cases of a store.
fn library_on(
    store: Store,
    extractor: Extractor,
    options: &Options,
) -> Result<Library, StartError> {
    let words = extractor.words();
    match extractor.has_network() {
        true => tracing::info!("brains are extracted {words}"),
        false => tracing::warn!("brains are extracted {words}"),
    }
    let pipeline = Pipeline::new(extractor).with_threads(cores());
    let preparation = match options.prepares_apart {
        false => pipeline.into(),
        true => {
            let absolute = |path: &PathBuf| std::path::absolute(path).map_err(StoreError::Disk);
            let process = PrepareProcess {
                program: options.dicom_program.clone(),
                network: (options.prepare.network.as_ref().map(absolute)).transpose()?,
                scratch: absolute(&store.spools().path())?,
                threads: cores(),
                cpu_seconds: options.prepare.max_cpu_secs,
            };
            Preparation {
                has_network: pipeline.has_network(),
                is_apart: true,
                prepare: Arc::new(move |source, parameters, limits, observe, cancelled| {
                    process.prepare(source, parameters, limits, (observe, cancelled))
                }),
            }
        }
    };
    let library_options = LibraryOptions {
        limits: options.limits.volumes(),
        makes_maps: options.limits.maps == MapsUse::On,
        cache_bytes: options.render.cache_bytes,
        children: options.children,
    };
    let library = Library::new(store, preparation, library_options);
    Ok(library.with_before_removal(options.before_removal.clone()))
}

/// Everything that a protocol needs to serve cases. Cheap to clone.
///
/// It holds no results of its own: caches are filled from the store, so a restarted server gives the same bytes.
#[derive(Debug, Clone)]
pub struct Cases {
    /// Cases in the store, and their preparation.
    pub library: Library,
    pub models: Models,
    /// The queue for pictures, meshes and all other CPU work for clients.
    pub queue: ConcurrencyLimit,
    /// The graphics device, if there is one.
    pub graphics: Graphics,
    /// The reader of DICOM files.
    pub dicom: Arc<DicomReader>,
    /// The reader of the headers of DICOM files.
    pub headers: Arc<HeaderReader>,
    pub(crate) checks: CheckMemory,
    /// One registration of cases at a time: pictures get their turns between them.
    pub(crate) registering: Arc<tokio::sync::Mutex<()>>,
    /// The atlas that names gyri, if there is one.
    pub(crate) atlas: Option<Arc<Atlas>>,
    deidentify: bool,
    /// The cases that were ready recently. They are not in the cache of the library: if the database is away, they stay.
    remembered: Arc<Cache<CaseId, (Instant, Arc<CaseFacts>)>>,
}

impl Cases {
    /// Opens the store. Cases are prepared only after workers are started on the library.
    ///
    /// # Errors
    /// If the store or the network cannot be opened.
    pub async fn open(options: Options) -> Result<Self, StartError> {
        // Boxed, because the compiler rejects futures that are nested deeper.
        let library = Box::pin(open_library(&options)).await?;
        let atlas = Atlas::open(&options.prepare.atlas)?.map(Arc::new);
        Ok(Self {
            atlas,
            ..Self::on(library, &options)
        })
    }

    /// The application on a store in memory, which ends with it, and the library for workers that prepare its cases. Maps are made on
    /// request ([`Library::make_maps_now`]), by no worker.
    ///
    /// # Errors
    /// If there is no memory or no temporary folder for the store, or the network cannot be opened.
    pub async fn in_memory(
        options: &Options,
        atlas: Option<Arc<Atlas>>,
    ) -> Result<(Self, Library), StartError> {
        let extractor = Extractor::open(options.prepare.network.as_deref())?;
        let store = Store::in_memory(options.store.clone()).await?;
        let mut without_maps = options.clone();
        without_maps.limits.maps = MapsUse::Off;
        let workers = library_on(store.clone(), extractor, &without_maps)?;
        let library_options = LibraryOptions {
            limits: options.limits.volumes(),
            makes_maps: true,
            cache_bytes: options.render.cache_bytes,
            children: options.children,
        };
        let library = Library::new(store, Preparation::default(), library_options);
        let cases = Self {
            atlas,
            ..Self::on(library, options)
        };
        Ok((cases, workers))
    }

    /// The application on a library, without an atlas.
    pub fn on(library: Library, options: &Options) -> Self {
        let remembered = Arc::new(Cache::new(REMEMBERED_CASES));
        let ready = Arc::clone(&remembered);
        library.store().on_delete(move |id| {
            ready.remove(id);
        });
        let Options { limits, render, .. } = options;
        let head = HeadLimits::with_sides_from(limits.min_field_mm);
        let (program, memory) = (&options.dicom_program, library.children());
        let dicom = DicomReader::new(program.clone(), limits.volumes(), limits.max_dicom_bytes());
        let dicom = dicom.with_memory(memory.clone());
        let headers = HeaderReader::new(FileReader::new(program.clone(), memory.clone()));
        Self {
            models: Models::new(library.clone()),
            library,
            queue: ConcurrencyLimit::new(render.threads, limits.max_queued_renders),
            graphics: Graphics::start(render),
            dicom: Arc::new(dicom),
            headers: Arc::new(headers),
            checks: CheckMemory::new(head, limits.volumes()),
            registering: Arc::default(),
            atlas: None,
            deidentify: options.deidentify,
            remembered,
        }
    }

    /// The store of the cases.
    pub fn store(&self) -> &Store {
        self.library.store()
    }

    /// Whether no identity of a patient is kept.
    pub fn deidentifies(&self) -> bool {
        self.deidentify
    }

    /// A case.
    ///
    /// # Errors
    /// [`Error::NoSuchCase`], or an error of the store.
    pub async fn case(&self, id: &CaseId) -> Result<Case, Error> {
        self.store().case(id).await?.ok_or(Error::NoSuchCase)
    }

    /// The facts of a case that is ready.
    ///
    /// # Errors
    /// [`Error::NoSuchCase`], [`Error::NotReady`], the failure of a failed case, or an error of the store.
    pub async fn ready(&self, id: &CaseId) -> Result<Arc<CaseFacts>, Error> {
        let remembered = self.remembered.get(id);
        if let Some((since, facts)) = &remembered
            && since.elapsed() < REMEMBERED_FOR
        {
            return Ok(Arc::clone(facts));
        }
        let asked = self.store().case(id).await;
        if let Err(error) = &asked
            && error.is_away()
            && let Some((since, facts)) = &remembered
            && since.elapsed() < REMEMBERED_WHILE_AWAY
        {
            return Ok(Arc::clone(facts));
        }
        let case = asked?;
        let is_ready = case
            .as_ref()
            .is_some_and(|case| case.state == CaseState::Ready);
        if remembered.is_some() && !is_ready {
            self.forget(id);
        }
        let case = case.ok_or(Error::NoSuchCase)?;
        match (case.state, case.facts, case.failure) {
            (CaseState::Ready, Some(facts), _) => {
                let facts = Arc::new(facts);
                self.remembered
                    .insert(*id, (Instant::now(), Arc::clone(&facts)));
                Ok(facts)
            }
            (CaseState::Failed, _, Some(failure)) => Err(failure.into()),
            (state, ..) => Err(Error::NotReady { state }),
        }
    }

    /// The line about a case in an annotated picture: see [`Case::identity`](case::Case::identity). It also states that the case is closed, and
    /// why. `None` without annotation.
    ///
    /// # Errors
    /// If the case does not exist.
    pub async fn identity(&self, id: &CaseId, annotate: bool) -> Result<Option<String>, Error> {
        if !annotate {
            return Ok(None);
        }
        let case = self.store().case(id).await?.ok_or(Error::NoSuchCase)?;
        let line = case.identity();
        Ok(Some(match case.closed {
            Some(why) => format!("{line} · closed: {}", why.name()),
            None => line,
        }))
    }

    /// The verdict on the mask of a recently requested case.
    pub fn known_quality(&self, id: &CaseId) -> Option<QualityState> {
        let (_, facts) = self.remembered.get(id)?;
        facts.quality.as_ref().map(|quality| quality.state)
    }

    /// The model of the whole brain of a case that is ready.
    ///
    /// # Errors
    /// As [`Cases::ready`].
    pub async fn model(&self, id: &CaseId) -> Result<WarmModel, Error> {
        self.surface(id, SurfaceName::Whole).await
    }

    /// The model of a surface of a case that is ready.
    ///
    /// # Errors
    /// As [`Cases::ready`], and [`Error::NoSurfaces`].
    pub async fn surface(&self, id: &CaseId, surface: SurfaceName) -> Result<WarmModel, Error> {
        self.ready(id).await?;
        match self.models.get(id, surface).await {
            Err(Error::NoSuchCase) => Err(self.gone(id).await),
            loaded => loaded,
        }
    }

    /// The models of the surfaces that a picture of a ready case shows.
    ///
    /// # Errors
    /// As [`Cases::surface`].
    pub async fn surfaces_of(
        &self,
        id: &CaseId,
        picture: &PictureRequest,
    ) -> Result<Vec<WarmModel>, Error> {
        let mut models = Vec::new();
        for surface in picture.surfaces() {
            models.push(self.surface(id, surface).await?);
        }
        Ok(models)
    }

    /// The whole acquired volume of a case that is ready.
    ///
    /// # Errors
    /// As [`Cases::ready`].
    pub async fn whole_volume(&self, id: &CaseId) -> Result<Arc<Volume>, Error> {
        let load = async {
            let volume = self.library.whole_volume(id).await?;
            volume.ok_or(Error::NoSuchCase)
        };
        match self
            .library
            .cache()
            .get_or_make(id, Part::WholeVolume, load)
            .await
        {
            Err(Error::NoSuchCase) => Err(self.gone(id).await),
            loaded => loaded,
        }
    }

    /// The whole acquired volume of a case in any state: from its source, unless the case is ready.
    ///
    /// # Errors
    /// [`Error::NoSuchCase`]; [`Error::Busy`] if too many volumes are read; the reason if the source is damaged; or an error
    /// of the store.
    pub async fn acquired_volume(&self, id: &CaseId) -> Result<Arc<Volume>, Error> {
        if self.case(id).await?.state == CaseState::Ready {
            return self.whole_volume(id).await;
        }
        let read = async {
            let names = self.store().objects_of(id).await?;
            let Some(source) = self.library.source(id, &names).await? else {
                return Err(Error::from(Failure::source_damaged()));
            };
            let room = self.checks.enter(&source.volume).await?;
            let limits = self.library.limits();
            let volume = tokio::task::spawn_blocking(move || {
                let _room = room;
                pipeline::read_volume(&source, &limits)
            });
            Ok(volume.await.map_err(StoreError::from)??)
        };
        let cache = self.library.cache();
        cache.get_or_make(id, Part::WholeVolume, read).await
    }

    /// The reason why a case that was ready a moment ago cannot be read: it has been deleted, or has failed because its
    /// source is damaged.
    pub(crate) async fn gone(&self, id: &CaseId) -> Error {
        self.forget(id);
        self.ready(id).await.err().unwrap_or(Error::Unavailable)
    }

    /// Removes a case and the objects that no other case needs; `false` if the case did not exist.
    ///
    /// # Errors
    /// As [`Store::delete`].
    pub async fn delete(&self, id: &CaseId) -> Result<bool, Error> {
        let deleted = self.store().delete(id).await;
        self.forget(id);
        Ok(deleted?)
    }

    /// Lets time pass for what is remembered.
    #[cfg(test)]
    pub(crate) fn pass_time(&self, by: Duration) {
        for (id, (since, facts)) in self.remembered.iter() {
            self.remembered.insert(id, (since - by, facts));
        }
    }

    fn forget(&self, id: &CaseId) {
        self.remembered.remove(id);
        self.library.cache().forget(id);
    }
}
