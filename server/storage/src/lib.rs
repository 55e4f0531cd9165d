#![doc = include_str!("../README.md")]

#[cfg(test)]
mod conformance;
mod directory;
mod error;
mod findings;
mod identity;
mod jobs;
mod label;
mod layers;
mod location;
mod manifest;
mod natural;
mod objects;
mod page;
mod pinned;
mod publish;
mod readings;
mod rows;
mod signals;
mod spools;
mod sql;
mod submit;
pub mod tables;
#[cfg(any(test, feature = "testing"))]
pub mod testing;
#[cfg(test)]
mod tests;
pub mod upkeep;
mod watch;

use std::fmt;
use std::path::Path;
use std::sync::{Arc, Mutex, Weak};
use std::time::{Duration, Instant};

use futures_util::StreamExt as _;
use tokio::task::JoinSet;

use self::directory::Directory;
use self::objects::Objects;
use self::rows::{Change, Sweep};
use self::spools::Place;
use self::sql::Rows;
use self::tables::{Connection, Tables};
use case::{Case, CaseId};

pub use self::error::{FailureCounts, STORE_AWAY, StoreError, failures, unless_missing};
pub use self::findings::{FindingsVersion, Replaced, StoredFindings};
pub use self::jobs::{Claim, Job, JobQuery, NewJob, Release};
pub use self::label::{Mismatch, StoreId};
pub use self::layers::{LayerUpload, SubmittedLayer};
pub use self::location::{BadAddress, DatabaseAddress, Location, ObjectsAddress};
pub use self::manifest::{Manifest, Manifested};
pub use self::objects::{
    Framed, ObjectError, ObjectName, Spool, Spooled, Unreadable, frame, keep_private,
    open_to_others,
};
pub use self::page::{CaseQuery, Cursor, Has, Listed, Order, Page, Status, is_id};
pub use self::publish::{Attempt, Publisher, frame_all};
pub use self::readings::{ReadingState, StoredReading, WrittenReading};
pub use self::rows::{LayerName, Made, Owner, Pinned, Published, Submitted};
pub use self::signals::{Count, Signals};
pub use self::spools::Spools;
pub use self::submit::{NewMask, Upload, Version};
pub use self::watch::Watch;

/// The number of objects that a sweep marks and removes at a time.
const REMOVALS_AT_ONCE: usize = 32;

/// The lease of the tombstones of a sweep.
const SWEEP_LEASE: Duration = Duration::from_secs(60);

/// How long a sweep deletes objects: far less than its lease, so that no deletion of its own comes after somebody else
/// has taken the tombstones over and the objects were written again.
const SWEEP_FOR: Duration = Duration::from_secs(30);

/// How long to wait before the next attempt to receive changes.
const LISTEN_AGAIN_AFTER: Duration = Duration::from_secs(1);

/// The options of a store. [`Options::default`] suits one machine.
#[derive(Debug, Clone)]
pub struct Options {
    /// What [`Store::open`] does if there is no store, or if it is the copy of another one.
    pub opening: Opening,
    /// The greatest number of cases that may wait to be prepared.
    pub queue_limit: usize,
    /// Free bytes on the disk below which it counts as full, so that [`Store::check`] fails.
    pub min_free_bytes: u64,
    /// The lease of a preparation; after it, another worker may take the job.
    pub lease: Duration,
    /// The interval at which a worker renews its lease and stores its progress; much less than `lease`.
    pub heartbeat: Duration,
    /// How often a preparation is begun before the case fails: so often that a machine that is switched off again and
    /// again loses nothing, and not for ever, because an input could be what ends the program.
    pub max_attempts: u32,
    /// The time limit of a preparation; then the case fails.
    pub longest_preparation: Duration,
    /// How long to wait before the next attempt if the store failed, not the input.
    pub retry_after: Duration,
    /// The interval for polling changes by other processes.
    pub poll: Duration,
    /// The age at which settled cases are removed, unless they are kept; `None` keeps all.
    pub keep: Option<Duration>,
    /// Whether opening the store removes what nobody needs any more.
    pub sweeps_at_start: bool,
    /// The tables of another crate that the store has.
    pub tables: Arc<dyn Tables>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            opening: Opening::OrMake,
            queue_limit: 64,
            min_free_bytes: 0,
            lease: Duration::from_secs(30),
            heartbeat: Duration::from_secs(1),
            max_attempts: 30,
            longest_preparation: Duration::from_secs(900),
            retry_after: Duration::from_secs(5),
            poll: Duration::from_secs(1),
            keep: None,
            sweeps_at_start: true,
            tables: Arc::new(()),
        }
    }
}

/// The store. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Store {
    inner: Arc<Inner>,
    /// What stands for the client, or nothing.
    client: Arc<str>,
}

/// How a store is opened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Opening {
    /// It must be there.
    Existing,
    /// It is made if there is none.
    OrMake,
    /// It must be there, and gets another id, because it is the copy of one that is still used. Nothing of it is removed.
    WithNewId,
}

type DeletionHook = Box<dyn Fn(&CaseId) + Send + Sync>;

struct Inner {
    rows: Rows,
    objects: Objects,
    spools: Spools,
    options: Options,
    signals: Signals,
    /// Called after a case was deleted. Held only briefly.
    deletion_hooks: Mutex<Vec<DeletionHook>>,
    /// When this process opened it, and how far the clock of tests was ahead then.
    opened_at: (Instant, Duration),
    /// Receives changes by other processes; ends with the store.
    _listener: JoinSet<()>,
}

impl fmt::Debug for Inner {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter
            .debug_struct("Store")
            .field("rows", &self.rows)
            .field("objects", &self.objects)
            .field("spools", &self.spools)
            .finish_non_exhaustive()
    }
}

impl Store {
    /// Opens the store at a location, such as a folder, migrates it, and removes left-over files; makes it if there is none and
    /// [`Options::opening`] says so.
    ///
    /// Several processes may open one folder; files in use by another running process are not touched.
    ///
    /// # Errors
    /// [`StoreError::NoStore`] if there is none, [`StoreError::Mismatch`] if the rows and the objects are not those of one store; nothing is
    /// changed then. Or if the folder, the database or the objects cannot be used.
    pub async fn open(location: impl Into<Location>, options: Options) -> Result<Self, StoreError> {
        let (location, opening) = (&location.into(), options.opening);
        let may_make = opening == Opening::OrMake;
        let has_rows = location.has_rows().await?;
        if !has_rows && !may_make {
            return Err(location.no_rows());
        }
        if let Some(folder) = location.objects_folder()
            && !folder.is_dir()
            && !may_make
        {
            let missing = "the folder of the objects does not exist";
            return Err(StoreError::NoStore(missing));
        }
        let objects = open_objects(location)?;
        if !has_rows {
            let label = objects.label().await?;
            // Another process may have made both meanwhile.
            if label != label::Label::Missing && !location.has_rows().await? {
                return Err(StoreError::Mismatch(Mismatch {
                    rows: None,
                    objects: label,
                }));
            }
        }
        let has_own_rows = location.database.is_none();
        let prepare = async |is_alone| {
            let rows = open_rows(location, Arc::clone(&options.tables)).await?;
            if is_alone && has_own_rows {
                rows.database.check_file().await?;
            }
            let identified = match opening {
                Opening::Existing => identity::compare(&rows, &objects).await,
                Opening::OrMake => identity::compare_or_make(&rows, &objects).await,
                Opening::WithNewId => identity::change(&rows, &objects).await,
            };
            if let Err(error) = identified {
                rows.database.close().await;
                return Err(error);
            }
            rows.complete_store_id().await?;
            if is_alone && has_own_rows {
                rows.forget_holders().await?;
            }
            Ok(rows)
        };
        let (place, rows) = Directory::open(&location.folder, prepare).await?;
        if let Some(ObjectsAddress::Folder(folder)) = &location.objects {
            directory::sweep_shared(folder)?;
        }
        // Before `--adopt`, nothing of a copy may go.
        let sweeps = options.sweeps_at_start && opening != Opening::WithNewId;
        let store = Self::new(rows, objects, Place::Directory(place), options);
        if sweeps {
            store.collect().await?;
        }
        Ok(store)
    }

    /// A new store on any rows and objects; uploads are spooled in the system's temporary directory.
    async fn on(rows: Rows, objects: Objects, options: Options) -> Result<Self, StoreError> {
        let uploads = tempfile::Builder::new().prefix("isocortex-").tempdir();
        let uploads = uploads.map_err(|error| {
            let advice = "set TMPDIR to a folder that exists and can be written";
            std::io::Error::new(error.kind(), format!("{error}; {advice}"))
        })?;
        identity::compare_or_make(&rows, &objects).await?;
        Ok(Self::new(rows, objects, Place::Temporary(uploads), options))
    }

    /// A store in memory, which ends with its last user.
    ///
    /// # Errors
    /// If there is no memory or no temporary directory for it.
    pub async fn in_memory(options: Options) -> Result<Self, StoreError> {
        let objects = Objects::new(Arc::new(object_store::memory::InMemory::new()));
        let rows = Rows::in_memory(Arc::clone(&options.tables)).await?;
        Self::on(rows, objects, options).await
    }

    fn new(rows: Rows, objects: Objects, place: Place, options: Options) -> Self {
        let rows_ahead = rows.ahead();
        let inner = Arc::new_cyclic(|store| {
            let mut listener = JoinSet::new();
            listener.spawn(listen(rows.clone(), Weak::clone(store)));
            Inner {
                rows,
                objects,
                spools: Spools(place),
                options,
                signals: Signals::default(),
                deletion_hooks: Mutex::default(),
                opened_at: (Instant::now(), rows_ahead),
                _listener: listener,
            }
        });
        Self {
            inner,
            client: "".into(),
        }
    }

    /// The same store for a client: the preparations that it queues take turns with those of other clients. An empty text means this
    /// program itself.
    #[must_use]
    pub fn for_client(&self, client: &str) -> Self {
        Self {
            client: client.into(),
            ..self.clone()
        }
    }

    /// Where uploads are spooled.
    pub fn spools(&self) -> &Spools {
        &self.inner.spools
    }

    /// Adds what the rows of a case do not have: newer progress, and when it expires.
    fn completed(&self, mut case: Case) -> Case {
        self.inner.signals.overlay(&mut case);
        let keep = self.options().keep.filter(|_| !case.kept);
        case.expires_at = keep.and_then(|keep| case.uploaded_at.checked_add(keep).ok());
        case
    }

    /// The changes of a case.
    pub fn subscribe(&self, id: &CaseId) -> Watch {
        Watch::new(self.clone(), *id)
    }

    /// Checks that the rows and the objects are reachable and belong to one store, and that the disk has room, for `/readyz`.
    ///
    /// # Errors
    /// If they are unreachable, or do not belong together ([`StoreError::Mismatch`]), or the disk is full ([`StoreError::is_full`]).
    pub async fn check(&self) -> Result<(), StoreError> {
        self.rows().database.check().await?;
        self.id().await?;
        self.spools().check(self.options().min_free_bytes).await
    }

    /// Finishes all work before the process ends. The rows must not be used afterwards.
    pub async fn close(&self) {
        self.rows().database.close().await;
    }

    /// Removes the objects that are no longer needed. The operation completes even if the caller drops the future: a sweep
    /// that stops half-way leaves tombstones, and nobody can write such an object again until their lease ends.
    ///
    /// # Errors
    /// If the rows or the objects cannot be written; what was not removed is found the next time.
    pub async fn collect(&self) -> Result<(), StoreError> {
        let store = self.clone();
        let collect = async move {
            loop {
                let candidates = store.abandoned(REMOVALS_AT_ONCE).await?;
                if candidates.is_empty() {
                    return Ok(());
                }
                store.remove_unneeded(&candidates).await?;
            }
        };
        tokio::spawn(collect).await?
    }

    /// Removes the unneeded ones of the objects. Objects that are not removed are found again after the lease of the
    /// sweep.
    async fn remove_unneeded(&self, candidates: &[ObjectName]) -> Result<(), StoreError> {
        self.id().await?;
        let sweep = Sweep {
            holder: pinned::unique_holder(),
            lease: SWEEP_LEASE,
        };
        let begun = Instant::now();
        let marked = self.mark(candidates, &sweep).await?;
        for name in &marked {
            let left = SWEEP_FOR.saturating_sub(begun.elapsed());
            let deleted = tokio::time::timeout(left, self.inner.objects.delete(name)).await;
            let too_slow = |_| StoreError::Objects("the removal of objects took too long".into());
            deleted.map_err(too_slow)??;
        }
        if marked.is_empty() {
            return Ok(());
        }
        self.remove_tombstones(&sweep.holder).await
    }

    /// Calls `hook` after each deletion by this process and, if the database reports them, by others.
    pub fn on_delete(&self, hook: impl Fn(&CaseId) + Send + Sync + 'static) {
        lock(&self.inner.deletion_hooks).push(Box::new(hook));
    }

    /// A connection on which each statement is a transaction.
    ///
    /// # Errors
    /// If the database cannot be reached.
    pub async fn connect(&self) -> Result<Connection, StoreError> {
        self.rows().connect().await
    }

    /// Begins a writing transaction; with it the time, in microseconds since 1970. There is one at a time in all processes.
    ///
    /// # Errors
    /// If the database cannot be reached.
    pub async fn write(&self) -> Result<(Connection, i64), StoreError> {
        self.rows().write().await
    }

    fn rows(&self) -> &Rows {
        &self.inner.rows
    }

    fn objects(&self) -> &Objects {
        &self.inner.objects
    }

    /// The payload of an object.
    ///
    /// # Errors
    /// If it is missing or damaged, or the store cannot be reached.
    pub async fn object(&self, name: &ObjectName) -> Result<bytes::Bytes, Unreadable> {
        self.objects().get(name).await
    }

    /// Lets time pass on the clock of the database, as this store sees it, and wakes whoever waits for work.
    #[cfg(any(test, feature = "testing"))]
    pub fn pass_time(&self, by: Duration) {
        self.rows().pass_time(by);
        self.signals().queued();
    }

    /// For how long this process has had the store open, on the clock that [`Store::pass_time`] moves.
    pub(crate) fn uptime(&self) -> Duration {
        let (at, ahead) = self.inner.opened_at;
        at.elapsed() + self.rows().ahead().saturating_sub(ahead)
    }

    pub fn options(&self) -> &Options {
        &self.inner.options
    }

    /// The signals within this process.
    pub fn signals(&self) -> &Signals {
        &self.inner.signals
    }
}

impl Inner {
    /// Signals to this process that a case was deleted.
    fn is_deleted(&self, id: &CaseId) {
        self.signals.changed(id);
        for hook in lock(&self.deletion_hooks).iter() {
            hook(id);
        }
    }

    fn has_changed(&self, change: Change) {
        match change {
            Change::Queued => self.signals.queued(),
            Change::Changed(id) => self.signals.changed(&id),
            Change::Deleted(id) => self.is_deleted(&id),
        }
    }
}

/// Passes on changes of the rows by other processes, if the database reports them.
async fn listen(rows: Rows, store: Weak<Inner>) {
    let mut changes = loop {
        match rows.database.changes().await {
            Ok(Some(changes)) => break changes,
            Ok(None) => return,
            Err(error) => {
                tracing::warn!(%error, "changes by other processes are noticed with a delay");
            }
        }
        tokio::time::sleep(LISTEN_AGAIN_AFTER).await;
    };
    while let Some(change) = changes.next().await {
        let Some(store) = store.upgrade() else {
            return;
        };
        store.has_changed(change);
    }
}

async fn open_rows(location: &Location, tables: Arc<dyn Tables>) -> Result<Rows, StoreError> {
    match &location.database {
        None => Rows::sqlite(&rows_file(&location.folder), tables).await,
        Some(DatabaseAddress::Sqlite(file)) => Rows::sqlite(file, tables).await,
        Some(DatabaseAddress::Postgres(options)) => {
            Rows::postgres((**options).clone(), tables).await
        }
    }
}

fn open_objects(location: &Location) -> Result<Objects, StoreError> {
    Ok(match &location.objects {
        None => Objects::in_directory(&location.folder.join("objects"))?,
        Some(ObjectsAddress::Folder(folder)) => {
            let objects = Objects::in_directory(folder)?;
            directory::check_owner_of_objects(folder)?;
            objects
        }
        Some(ObjectsAddress::Bucket { bucket, prefix }) => Objects::in_bucket(bucket, prefix)?,
    })
}

fn rows_file(root: &Path) -> std::path::PathBuf {
    root.join("rows.sqlite")
}

/// Locks a mutex whose data stays valid even if a holder panicked, because each change is one step.
fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex
        .lock()
        .unwrap_or_else(std::sync::PoisonError::into_inner)
}
