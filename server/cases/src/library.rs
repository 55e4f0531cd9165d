//! The cases of a store and their preparation: the only place where `storage` and `pipeline` meet.
//!
//! Everything except the uploaded files is derived from them; a missing or damaged derived object is rebuilt here.

mod layers;
mod loaded_maps;
mod maps;
mod surfaces;
#[cfg(test)]
mod tests;
mod whole;

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

pub use self::layers::LayerVoxels;
pub use self::loaded_maps::{FlairState, LoadedMaps, MapsState};
use crate::cache::CaseCache;
use crate::removal::BeforeRemoval;
use crate::series::series_of_stored;
use bytes::Bytes;
use case::images::Image;
use case::{
    Case, CaseFacts, CaseId, Failure, FailureKind, MaskMethod, ObjectKind, Parameters, Progress,
    Quality,
};
use imaging::Limits;
use pipeline::{Derived, Pipeline, Source, StoredBrain, settled};
use storage::{
    Attempt, Count, ObjectName, Publisher, Store, StoreError, Submitted, Upload, frame_all,
};
use worker::{ChildBudget, ChildMemory, MemoryPermit};

/// What a library may take, and what it makes.
#[derive(Debug, Clone, Copy)]
pub struct LibraryOptions {
    /// The limits of uploads.
    pub limits: Limits,
    /// Whether maps of the cases are computed.
    pub makes_maps: bool,
    /// Memory for what is kept of cases, in bytes.
    pub cache_bytes: u64,
    /// What the processes that read files and prepare cases may use.
    pub children: ChildBudget,
}

impl Default for LibraryOptions {
    fn default() -> Self {
        Self {
            limits: Limits::default(),
            makes_maps: false,
            cache_bytes: 1 << 30,
            children: ChildBudget::default(),
        }
    }
}

/// The work on an upload: returns the objects and facts of a case, or the reason why there are none.
///
/// It reports each step when that begins, and ends soon after the flag is raised.
pub type PrepareFn = dyn Fn(
        &Source,
        &Parameters,
        &Limits,
        &(dyn Fn(Progress) + Sync),
        &AtomicBool,
    ) -> Result<Derived, Failure>
    + Send
    + Sync;

/// The preparation of cases.
#[derive(Clone)]
pub struct Preparation {
    /// Whether there is a network that extracts brains.
    pub has_network: bool,
    /// Whether it runs in a process of its own.
    pub is_apart: bool,
    /// The function that prepares a case.
    pub prepare: Arc<PrepareFn>,
}

impl fmt::Debug for Preparation {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter
            .debug_struct("Preparation")
            .field("has_network", &self.has_network)
            .finish_non_exhaustive()
    }
}

impl From<Pipeline> for Preparation {
    fn from(pipeline: Pipeline) -> Self {
        Self {
            has_network: pipeline.has_network(),
            is_apart: false,
            prepare: Arc::new(move |source, parameters, limits, observe, cancelled| {
                pipeline.derive(source, parameters, limits, observe, cancelled)
            }),
        }
    }
}

impl Default for Preparation {
    fn default() -> Self {
        Pipeline::default().into()
    }
}

/// The cases of a store, and their preparation. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Library {
    store: Store,
    inner: Arc<Inner>,
    before_removal: BeforeRemoval,
}

#[derive(Debug)]
struct Inner {
    preparation: Preparation,
    options: LibraryOptions,
    /// One rebuild at a time in this process, because it needs the memory of a whole preparation; held across awaits.
    /// Each case is rebuilt by one process at a time ([`Store::rebuild_alone`]).
    rebuilding: tokio::sync::Mutex<()>,
    /// One division of a brain at a time in this process; held across awaits.
    dividing: tokio::sync::Mutex<()>,
    /// What is kept of cases.
    cache: CaseCache,
    /// The memory of processes that read files and prepare cases.
    children: ChildMemory,
}

impl Library {
    /// The cases of a store with this preparation and these options.
    pub fn new(store: Store, preparation: Preparation, options: LibraryOptions) -> Self {
        let cache = CaseCache::new(options.cache_bytes);
        let kept = cache.clone();
        store.on_delete(move |id| kept.forget(id));
        Self {
            store,
            inner: Arc::new(Inner {
                preparation,
                children: ChildMemory::new(options.children),
                options,
                rebuilding: tokio::sync::Mutex::default(),
                dividing: tokio::sync::Mutex::default(),
                cache,
            }),
            before_removal: BeforeRemoval::default(),
        }
    }

    /// The same, with what is told of each expired case before it is removed.
    #[must_use]
    pub fn with_before_removal(self, before_removal: BeforeRemoval) -> Self {
        Self {
            before_removal,
            ..self
        }
    }

    /// What is told of each expired case before it is removed.
    pub fn before_removal(&self) -> &BeforeRemoval {
        &self.before_removal
    }

    /// The cases of a store, with the usual preparation.
    pub fn of(store: Store) -> Self {
        Self::new(store, Preparation::default(), LibraryOptions::default())
    }

    pub fn store(&self) -> &Store {
        &self.store
    }

    /// What is kept of the cases in memory.
    pub fn cache(&self) -> &CaseCache {
        &self.inner.cache
    }

    /// The limits of uploads.
    pub fn limits(&self) -> Limits {
        self.inner.options.limits
    }

    /// Whether maps of the cases are computed.
    pub fn makes_maps(&self) -> bool {
        self.inner.options.makes_maps
    }

    /// Whether the preparation has a network for brain extraction.
    pub fn has_network(&self) -> bool {
        self.inner.preparation.has_network
    }

    /// The memory of processes that read files and prepare cases.
    pub(crate) fn children(&self) -> &ChildMemory {
        &self.inner.children
    }

    /// Waits until there is memory for a preparation, if it has a process of its own.
    pub(crate) async fn memory_to_prepare(&self) -> MemoryPermit {
        match self.inner.preparation.is_apart {
            true => self.children().take_to_prepare().await,
            false => MemoryPermit::default(),
        }
    }

    /// Prepares a case on the calling thread.
    pub(crate) fn prepare(
        &self,
        source: &Source,
        parameters: &Parameters,
        observe: &(dyn Fn(Progress) + Sync),
        cancelled: &AtomicBool,
    ) -> Result<Derived, Failure> {
        let prepare = &self.inner.preparation.prepare;
        let limits = &self.inner.options.limits;
        prepare(source, parameters, limits, observe, cancelled)
    }

    /// Makes a case from files in memory and queues its preparation. The parameters are [`settled`] first.
    ///
    /// # Errors
    /// As [`Store::submit`].
    pub async fn submit(
        &self,
        source: Source,
        parameters: Parameters,
    ) -> Result<Submitted, StoreError> {
        self.submit_of(source, Vec::new(), parameters).await
    }

    /// As [`Library::submit`], of a source that is made of these images.
    ///
    /// # Errors
    /// As [`Library::submit`].
    pub async fn submit_of(
        &self,
        source: Source,
        images: Vec<Image>,
        parameters: Parameters,
    ) -> Result<Submitted, StoreError> {
        let (limits, has_network) = (self.limits(), self.has_network());
        let settle = move || (settled(&source, parameters, &limits, has_network), source);
        let (parameters, source) = tokio::task::spawn_blocking(settle).await?;
        let volume = self.store().spools().of(source.volume).await?;
        let mask = match source.mask {
            Some(bytes) => Some(self.store().spools().of(bytes).await?),
            None => None,
        };
        let series = source.dicom.as_deref().and_then(series_of_stored);
        let dicom = match source.dicom {
            Some(bytes) => Some(self.store().spools().of(bytes).await?),
            None => None,
        };
        let upload = Upload {
            volume,
            mask,
            dicom,
            images,
            series,
        };
        self.store().submit(upload, parameters, None, true).await
    }

    /// Reads derived objects of a ready case; `None` if it does not exist or is not ready.
    ///
    /// `decode` gets the payloads in the order of `kinds`, on a blocking thread. If an object is missing or damaged, or
    /// `decode` returns `None`, this is logged, and all are rebuilt from the source. If the source is damaged too, the
    /// case becomes failed.
    ///
    /// # Errors
    /// [`StoreError::SourceMissing`], and the case stays as it is; or if the store cannot be reached.
    pub async fn load<T: Send + 'static>(
        &self,
        id: &CaseId,
        kinds: &'static [ObjectKind],
        decode: impl Fn(&CaseFacts, &[Bytes]) -> Option<T> + Send + Sync + 'static,
    ) -> Result<Option<T>, StoreError> {
        let decode = Arc::new(decode);
        match self.store().read_derived(id, kinds, &decode).await? {
            Attempt::Read(value) => return Ok(Some(value)),
            Attempt::NoCase => return Ok(None),
            Attempt::Bad => {}
        }
        let _one_at_a_time = self.inner.rebuilding.lock().await;
        let read_or_rebuild = async {
            // Another caller may have done it meanwhile.
            if let Attempt::Read(value) = self.store().read_derived(id, kinds, &decode).await? {
                return Ok(Some(value));
            }
            self.rebuild(id).await?;
            match self.store().read_derived(id, kinds, &decode).await? {
                Attempt::Read(value) => Ok(Some(value)),
                Attempt::NoCase => Ok(None),
                Attempt::Bad => Err(StoreError::Objects(
                    "derived objects cannot be read immediately after they were written".into(),
                )),
            }
        };
        // In a box: the future of a rebuild is large, and rarely needed.
        let rebuilt = self.store().rebuild_alone(id, Box::pin(read_or_rebuild));
        Ok(rebuilt.await?.flatten())
    }

    /// The uploaded files of a case; `None`, reported, if one is damaged.
    ///
    /// # Errors
    /// [`StoreError::SourceMissing`], or if the store cannot be reached.
    pub async fn source(
        &self,
        id: &CaseId,
        names: &[ObjectName],
    ) -> Result<Option<Source>, StoreError> {
        let store = self.store();
        let Some(volume) = store.read(id, names, ObjectKind::SourceVolume).await? else {
            return Ok(None);
        };
        let mask = self.read_if_any(id, names, ObjectKind::SourceMask).await?;
        let dicom = self.read_if_any(id, names, ObjectKind::SourceDicom).await?;
        Ok(mask.zip(dicom).map(|(mask, dicom)| Source {
            volume,
            mask,
            dicom,
            brain: None,
        }))
    }

    /// An uploaded file that a case may have, or `None` in it; `None`, reported, if it is damaged.
    async fn read_if_any(
        &self,
        id: &CaseId,
        names: &[ObjectName],
        kind: ObjectKind,
    ) -> Result<Option<Option<Bytes>>, StoreError> {
        if names.iter().all(|name| name.kind != kind) {
            return Ok(Some(None));
        }
        let read = self.store().read(id, names, kind).await?;
        Ok(read.map(Some))
    }

    /// Rebuilds the derived objects of a ready case, or makes the case failed if that is impossible.
    pub(crate) async fn rebuild(&self, id: &CaseId) -> Result<(), StoreError> {
        let Some(case) = self.store().case(id).await? else {
            return Ok(());
        };
        let names = self.store().objects_of(id).await?;
        let rebuilt = match self.source(id, &names).await? {
            Some(mut source) => {
                source.brain = self.extracted(&case, &names).await?;
                self.derive(source, case.parameters).await?
            }
            None => Err(Failure::source_damaged()),
        };
        let rebuilt = rebuilt.and_then(|derived| {
            let method = |facts: &CaseFacts| facts.quality.as_ref().map(|quality| quality.method);
            let before = case.facts.as_ref().and_then(method);
            if before.is_some() && before != method(&derived.facts) {
                return Err(extracted_otherwise());
            }
            Ok(derived)
        });
        match rebuilt {
            Ok(derived) => {
                let framed = frame_all(derived.objects).await?;
                self.store()
                    .publish(Publisher::Ready(id.into()), framed)
                    .await?;
                self.store().signals().count(Count::Rebuild);
                tracing::warn!(
                    case = id.short(),
                    "rebuilt the derived objects of a case from its source"
                );
            }
            Err(failure) => {
                self.store().make_case_failed(id, &failure).await?;
                tracing::error!(
                    case = id.short(),
                    kind = failure.name,
                    "cannot rebuild a case from its source"
                );
            }
        }
        self.store().signals().changed(id);
        Ok(())
    }

    /// The brain mask of a case, if it was extracted or rated. It must not change, even if this server would extract it
    /// differently now; nor must the rating, because another server may have no network.
    async fn extracted(
        &self,
        case: &Case,
        names: &[ObjectName],
    ) -> Result<Option<StoredBrain>, StoreError> {
        let quality = case.facts.as_ref().and_then(|facts| facts.quality.clone());
        let stays = |quality: &Quality| {
            quality.method.is_extraction() || quality.method == MaskMethod::Supplied
        };
        let Some(quality) = quality.filter(stays) else {
            return Ok(None);
        };
        let mask = self.store().read(&case.id, names, ObjectKind::Mask).await?;
        let cuts = case.facts.as_ref().map(|facts| facts.cuts.clone());
        Ok(mask.map(|mask| StoredBrain {
            mask,
            quality,
            cuts: cuts.unwrap_or_default(),
        }))
    }

    async fn derive(
        &self,
        source: Source,
        parameters: Parameters,
    ) -> Result<Result<Derived, Failure>, StoreError> {
        let library = self.clone();
        let memory = self.memory_to_prepare().await;
        let derived = tokio::task::spawn_blocking(move || {
            // Also if nobody waits any more.
            let _until_done = memory;
            let never = AtomicBool::new(false);
            library.prepare(&source, &parameters, &|_| {}, &never)
        });
        Ok(derived.await?)
    }
}

/// The failure of a case that lost its mask: extracting it again would give another one.
fn extracted_otherwise() -> Failure {
    Failure::new(
        FailureKind::Internal,
        "mask-damaged",
        "the stored mask is damaged, and this server would extract the brain with another method; upload the volume again",
    )
}
