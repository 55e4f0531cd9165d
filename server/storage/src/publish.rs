//! Derived objects: written when a case is prepared, read when it is shown.

use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use crate::{Framed, Unreadable, frame};
use bytes::Bytes;
use case::{CaseFacts, CaseId, CaseState, JobKind, LayerFacts, ObjectKind};

use super::jobs::{Claim, NewJob, Release};
use super::pinned::Writing;
use super::rows::{Owner, Pinned, Published};
use super::signals::Count;
use super::{ObjectName, Store, StoreError};

/// How often to check whether another process has finished its rebuild.
const LOOK_EVERY: Duration = Duration::from_millis(200);

/// Who publishes derived objects.
#[derive(Debug, Clone)]
pub enum Publisher {
    /// The preparation of a case, which then has these facts, and these kinds of jobs next.
    Case(Claim, Box<CaseFacts>, &'static [JobKind]),
    /// The preparation of a layer.
    Layer(Claim, Box<LayerFacts>),
    /// Whoever computes objects of a case or a layer that is ready, for the first time or again.
    Ready(Owner),
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
        let case = self.case(id).await?;
        let Some(facts) = case
            .filter(|case| case.state == CaseState::Ready)
            .and_then(|case| case.facts)
        else {
            return Ok(Attempt::NoCase);
        };
        let names = self.objects_of(id).await?;
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

    /// The payload of one of the objects of a case or a layer; `None`, reported, if it is damaged, or missing and derived.
    ///
    /// # Errors
    /// [`StoreError::SourceMissing`] if it was uploaded and is missing, or if the store cannot be reached.
    pub async fn read(
        &self,
        owner: impl Into<Owner>,
        names: &[ObjectName],
        kind: ObjectKind,
    ) -> Result<Option<Bytes>, StoreError> {
        let Some(name) = names.iter().find(|name| name.kind == kind) else {
            return Ok(None);
        };
        let owner = owner.into();
        match self.object(name).await {
            Ok(payload) => Ok(Some(payload)),
            Err(Unreadable::Store(error)) => Err(error.into()),
            Err(fault) => {
                // One that is missing because its owner was deleted a moment ago is no fault.
                if self.objects_of(owner).await?.contains(name) {
                    self.report_unreadable(kind, &fault)?;
                }
                Ok(None)
            }
        }
    }

    /// Reports an object that is missing or damaged.
    ///
    /// # Errors
    /// [`StoreError::SourceMissing`] for a source that is missing: an answer, and never the end of a case.
    fn report_unreadable(&self, kind: ObjectKind, fault: &Unreadable) -> Result<(), StoreError> {
        self.report_bad(kind, &fault.to_string());
        if kind.is_source() && matches!(fault, Unreadable::Missing) {
            self.signals().count(Count::MissingSource);
            return Err(StoreError::SourceMissing);
        }
        Ok(())
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
    /// [`StoreError::SourceMissing`], or if the store cannot be reached or what was stored is damaged.
    pub async fn source_dicom(&self, id: &CaseId) -> Result<Option<Bytes>, StoreError> {
        let names = self.objects_of(id).await?;
        if !names
            .iter()
            .any(|name| name.kind == ObjectKind::SourceDicom)
        {
            return Ok(None);
        }
        let stored = self.read(id, &names, ObjectKind::SourceDicom).await?;
        stored
            .map(Some)
            .ok_or_else(|| StoreError::Objects("the DICOM attributes of a case are damaged".into()))
    }

    /// Runs a rebuild of a case as its job, while no other process runs one; `None` if there is no such case, or it
    /// failed.
    ///
    /// A client waits for the object, perhaps where no worker runs, so its request does the job. Lease, heartbeat and number of attempts are
    /// those of all jobs; three things differ from what their runner does. The client gets the error of a rebuild that fails, and the job can
    /// be claimed again at once, because the next client needs the object. Such an attempt counts only if the rebuild was interrupted, because a
    /// store that fails says nothing about the case. There is no time limit: if the client does not wait any longer, the lease ends, and a
    /// worker takes the job.
    ///
    /// # Errors
    /// Those of the rebuild, or when the rows cannot be written.
    pub async fn rebuild_alone<T>(
        &self,
        id: &CaseId,
        rebuild: impl Future<Output = Result<T, StoreError>>,
    ) -> Result<Option<T>, StoreError> {
        let Some(claim) = self.claim_rebuild(id).await? else {
            return Ok(None);
        };
        let rebuilt = tokio::select! {
            rebuilt = rebuild => rebuilt,
            never = self.keep_lease(&claim) => match never {},
        };
        match &rebuilt {
            // Nothing waits for a source in the name of a client: whoever needs the object asks again.
            Ok(_) | Err(StoreError::SourceMissing) => self.finish(&claim, Ok(())).await?,
            Err(error) => {
                // Whoever needs it tries again, or a worker does. A store that fails says nothing about the case.
                let again = Release {
                    after: Duration::ZERO,
                    counts: matches!(error, StoreError::Stopped(_)),
                    failure: None,
                };
                self.release(&claim, &again).await?
            }
        };
        rebuilt.map(Some)
    }

    /// Renews a lease for ever. It runs beside the work and not between its steps: a step may hold the connection that the renewal waits for.
    async fn keep_lease(&self, claim: &Claim) -> Infallible {
        let mut heartbeat = tokio::time::interval(self.options().heartbeat);
        loop {
            heartbeat.tick().await;
            // Where it is lost somebody else does the same, which does no harm.
            let _kept = self.renew(claim, None).await;
        }
    }

    /// Waits until the rebuild of a case is ours; `None` if it is not ready any more.
    async fn claim_rebuild(&self, id: &CaseId) -> Result<Option<Claim>, StoreError> {
        let (kind, most) = (JobKind::REBUILD, self.options().max_attempts);
        loop {
            let case = self.case(id).await?;
            if case.is_none_or(|case| case.state != CaseState::Ready) {
                return Ok(None);
            }
            let job = NewJob::about(kind, id);
            if let Some(claim) = self.enqueue_and_claim(&job, most).await? {
                return Ok(Some(claim));
            }
            tokio::time::sleep(LOOK_EVERY).await;
        }
    }

    /// Makes derived objects durable, then publishes them in one transaction, which ends the job that made them. Leaves nothing behind if
    /// that fails. The operation completes even if the caller drops the future: a worker does so when its case is deleted.
    ///
    /// # Errors
    /// If the store cannot be reached.
    pub async fn publish(
        &self,
        publisher: Publisher,
        derived: Vec<Framed>,
    ) -> Result<Published, StoreError> {
        let store = self.clone();
        tokio::spawn(async move { store.publish_now(&publisher, &derived).await }).await?
    }

    async fn publish_now(
        &self,
        publisher: &Publisher,
        derived: &[Framed],
    ) -> Result<Published, StoreError> {
        let objects: Vec<_> = derived.iter().map(Writing::Framed).collect();
        let publish = |pinned: Pinned| async move {
            match publisher {
                Publisher::Case(claim, facts, next) => {
                    self.make_case_ready(claim, &pinned, facts, next).await
                }
                Publisher::Layer(claim, facts) => {
                    self.make_layer_ready(claim, &pinned, facts).await
                }
                Publisher::Ready(owner) => self.refer(*owner, &pinned, true).await,
            }
        };
        let published = self.with_pinned(&objects, publish).await?;
        if let Publisher::Case(claim, ..) | Publisher::Layer(claim, _) = publisher {
            self.job_changed(claim);
            self.signals().queued();
        }
        Ok(published)
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
