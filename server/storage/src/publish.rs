//! Derived objects: written when a case is prepared, read when it is shown.

use std::sync::Arc;
use std::time::Duration;

use crate::{Framed, Unreadable, frame};
use bytes::Bytes;
use case::{CaseFacts, CaseId, CaseState, ObjectKind};

use super::rows::{Claim, Pinned, Published};
use super::signals::Count;
use super::submit::unique_holder;
use super::{ObjectName, PIN_ATTEMPTS, Store, StoreError};

/// The lease of a rebuild.
const REBUILD_LEASE: Duration = Duration::from_secs(30);

/// How often to check whether another process has finished its rebuild.
const LOOK_EVERY: Duration = Duration::from_millis(200);

/// The origin of derived objects.
#[derive(Debug, Clone, Copy)]
pub enum Publisher<'a> {
    /// A worker with its lease.
    Worker(&'a Claim),
    /// A rebuild of a ready case.
    Rebuild(&'a CaseId),
}

/// An attempt to read derived objects.
#[derive(Debug)]
pub enum Attempt<T> {
    /// They were read.
    Read(T),
    /// The case does not exist or is not ready.
    NoCase,
    /// An object is missing or damaged.
    Bad,
}

impl Store {
    /// Reads derived objects of a ready case.
    ///
    /// `decode` gets the payloads in the order of `kinds`, on a blocking thread. If an object is missing or damaged, or
    /// `decode` returns `None`, that is logged and counted.
    ///
    /// # Errors
    /// If the store cannot be reached.
    pub async fn read_derived<T: Send + 'static>(
        &self,
        id: &CaseId,
        kinds: &'static [ObjectKind],
        decode: &Arc<impl Fn(&CaseFacts, &[Bytes]) -> Option<T> + Send + Sync + 'static>,
    ) -> Result<Attempt<T>, StoreError> {
        let case = self.case_row(id).await?;
        let Some(facts) = case
            .filter(|case| case.state == CaseState::Ready)
            .and_then(|case| case.facts)
        else {
            return Ok(Attempt::NoCase);
        };
        let names = self.case_objects(id).await?;
        let mut payloads = Vec::with_capacity(kinds.len());
        for &kind in kinds {
            match self.read(id, &names, kind).await? {
                Some(payload) => payloads.push(payload),
                None => return Ok(Attempt::Bad),
            }
        }
        let decode = Arc::clone(decode);
        let decoded = tokio::task::spawn_blocking(move || decode(&facts, &payloads)).await?;
        Ok(match decoded {
            Some(value) => Attempt::Read(value),
            None => {
                self.report_bad(kinds[0], "its contents cannot be decoded");
                Attempt::Bad
            }
        })
    }

    /// The payload of a case's object; `None`, reported, if it is missing or damaged.
    ///
    /// # Errors
    /// If the store cannot be reached.
    pub async fn read(
        &self,
        id: &CaseId,
        names: &[ObjectName],
        kind: ObjectKind,
    ) -> Result<Option<Bytes>, StoreError> {
        let Some(name) = names.iter().find(|name| name.kind == kind) else {
            return Ok(None);
        };
        let read = self.inner.objects.get(name).await;
        match read {
            Ok(payload) => Ok(Some(payload)),
            Err(Unreadable::Store(error)) => Err(error.into()),
            Err(fault) => {
                // One that is missing because the case was deleted a moment ago is no fault.
                if self.case_objects(id).await?.contains(name) {
                    self.report_bad(kind, &fault.to_string());
                }
                Ok(None)
            }
        }
    }

    pub(super) fn report_bad(&self, kind: ObjectKind, fault: &str) {
        self.signals().count(Count::BadObject);
        tracing::error!(
            object = kind.name(),
            fault,
            "a stored object cannot be used"
        );
    }

    /// The stored identifying attributes of a case; `None` if it does not come from DICOM.
    ///
    /// # Errors
    /// If the store cannot be reached, or what was stored is lost.
    pub async fn source_dicom(&self, id: &CaseId) -> Result<Option<Bytes>, StoreError> {
        let names = self.case_objects(id).await?;
        if !names
            .iter()
            .any(|name| name.kind == ObjectKind::SourceDicom)
        {
            return Ok(None);
        }
        let stored = self.read(id, &names, ObjectKind::SourceDicom).await?;
        stored.map(Some).ok_or_else(|| {
            StoreError::Objects("the DICOM attributes of a case are missing or damaged".into())
        })
    }

    /// Runs a rebuild of a case while no other process runs one; `None` if there is no such case.
    ///
    /// # Errors
    /// Those of the rebuild, or when the rows cannot be written.
    pub async fn rebuild_alone<T>(
        &self,
        id: &CaseId,
        rebuild: impl Future<Output = Result<T, StoreError>>,
    ) -> Result<Option<T>, StoreError> {
        let holder = unique_holder();
        while !self.begin_rebuild(id, &holder, REBUILD_LEASE).await? {
            if self.case_row(id).await?.is_none() {
                return Ok(None);
            }
            tokio::time::sleep(LOOK_EVERY).await;
        }
        let mut rebuild = std::pin::pin!(rebuild);
        let mut heartbeat = tokio::time::interval(REBUILD_LEASE / 3);
        let rebuilt = loop {
            tokio::select! {
                rebuilt = &mut rebuild => break rebuilt,
                _ = heartbeat.tick() => {
                    // Where it is lost somebody else does the same, which does no harm.
                    let _kept = self.begin_rebuild(id, &holder, REBUILD_LEASE).await;
                }
            }
        };
        self.end_rebuild(id, &holder).await?;
        rebuilt.map(Some)
    }

    /// Makes derived objects durable, then publishes them in one transaction. Leaves nothing behind if that fails.
    ///
    /// # Errors
    /// If the store cannot be reached.
    pub async fn publish(
        &self,
        publisher: Publisher<'_>,
        derived: &[Framed],
        facts: &CaseFacts,
    ) -> Result<Published, StoreError> {
        for _ in 0..PIN_ATTEMPTS {
            let pinned = self.pin(derived.iter().map(|framed| framed.name)).await?;
            let published = self
                .publish_pinned(publisher, derived, &pinned, facts)
                .await;
            if !matches!(published, Ok(Published::Done)) {
                self.abandon(&pinned).await;
            }
            match published? {
                Published::PinLost => {}
                settled => return Ok(settled),
            }
        }
        Err(StoreError::Rows(
            "an object was removed repeatedly while it was written".into(),
        ))
    }

    async fn publish_pinned(
        &self,
        publisher: Publisher<'_>,
        derived: &[Framed],
        pinned: &Pinned,
        facts: &CaseFacts,
    ) -> Result<Published, StoreError> {
        for framed in derived {
            self.inner.objects.put(framed).await?;
        }
        match publisher {
            Publisher::Worker(claim) => self.make_case_ready(claim, pinned, facts).await,
            Publisher::Rebuild(id) => self.replace_objects(id, pinned).await,
        }
    }
}

/// Packs and frames derived objects on a blocking thread.
///
/// # Errors
/// If the process is stopping.
pub async fn frame_all(objects: Vec<(ObjectKind, Bytes)>) -> Result<Vec<Framed>, StoreError> {
    let framed = tokio::task::spawn_blocking(move || {
        let framed = objects.into_iter().map(|(kind, plain)| frame(kind, plain));
        framed.collect()
    });
    Ok(framed.await?)
}
