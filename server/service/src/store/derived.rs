//! Derived objects: written when a case is prepared, read when it is shown, made again when they cannot be read.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use bytes::Bytes;

use super::frame::{Framed, frame};
use super::objects::Unreadable;
use super::rows::{Claim, Pinned, Published};
use super::signals::Count;
use super::{ObjectKind, ObjectName, Store, StoreError};
use crate::case::{Case, CaseFacts, CaseId, CaseState, Failure, Parameters};
use crate::prepare::{Derived, Source, StoredBrain};

/// How often derived objects are written again because a pin was lost.
const PUBLISH_ATTEMPTS: usize = 3;

/// On whose behalf derived objects are published.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Publisher<'a> {
    /// A worker's, with its lease.
    Worker(&'a Claim),
    /// A ready case's, whose objects were made again.
    Rebuild(&'a CaseId),
}

/// An attempt to read derived objects.
enum Attempt<T> {
    Read(T),
    /// The case is not there, or not ready.
    NoCase,
    /// An object is missing or damaged.
    Bad,
}

impl Store {
    /// Reads derived objects of a ready case; `None` where it is not there or not ready.
    ///
    /// `decode` gets the payloads in the order of `kinds`, on a blocking thread. Where an object is missing or damaged, or
    /// `decode` gives `None`, that is logged, and all are made again from the source. Where the source is lost too the case
    /// becomes failed.
    ///
    /// # Errors
    /// When the store cannot be reached.
    pub(crate) async fn load<T: Send + 'static>(
        &self,
        id: &CaseId,
        kinds: &'static [ObjectKind],
        decode: impl Fn(&CaseFacts, &[Bytes]) -> Option<T> + Send + Sync + 'static,
    ) -> Result<Option<T>, StoreError> {
        let decode = Arc::new(decode);
        match self.try_load(id, kinds, &decode).await? {
            Attempt::Read(value) => return Ok(Some(value)),
            Attempt::NoCase => return Ok(None),
            Attempt::Bad => {}
        }
        let _one_at_a_time = self.inner.rebuilding.lock().await;
        // Somebody else may have done it meanwhile.
        if let Attempt::Read(value) = self.try_load(id, kinds, &decode).await? {
            return Ok(Some(value));
        }
        self.rebuild(id).await?;
        match self.try_load(id, kinds, &decode).await? {
            Attempt::Read(value) => Ok(Some(value)),
            Attempt::NoCase => Ok(None),
            Attempt::Bad => Err(StoreError::Objects(
                "derived objects cannot be read right after they were written".into(),
            )),
        }
    }

    async fn try_load<T: Send + 'static>(
        &self,
        id: &CaseId,
        kinds: &'static [ObjectKind],
        decode: &Arc<impl Fn(&CaseFacts, &[Bytes]) -> Option<T> + Send + Sync + 'static>,
    ) -> Result<Attempt<T>, StoreError> {
        let case = self.rows().case(id).await?;
        let Some(facts) = case
            .filter(|case| case.state == CaseState::Ready)
            .and_then(|case| case.facts)
        else {
            return Ok(Attempt::NoCase);
        };
        let names = self.rows().objects(id).await?;
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
                self.report_bad(id, kinds[0], "its contents cannot be decoded");
                Attempt::Bad
            }
        })
    }

    /// The payload of a case's object; `None`, reported, where it is missing or damaged.
    async fn read(
        &self,
        id: &CaseId,
        names: &[ObjectName],
        kind: ObjectKind,
    ) -> Result<Option<Bytes>, StoreError> {
        let Some(name) = names.iter().find(|name| name.kind == kind) else {
            tracing::info!(case = %id, object = kind.name(), "a case of an earlier version lacks an object");
            return Ok(None);
        };
        let read = self.inner.objects.get(name).await;
        match read {
            Ok(payload) => Ok(Some(payload)),
            Err(Unreadable::Store(error)) => Err(error),
            Err(fault) => {
                self.report_bad(id, kind, &fault.to_string());
                Ok(None)
            }
        }
    }

    fn report_bad(&self, case: &CaseId, kind: ObjectKind, fault: &str) {
        self.signals().count(Count::BadObject);
        tracing::error!(%case, object = kind.name(), fault, "a stored object cannot be used");
    }

    /// The uploaded files of a case; `None`, reported, where one is missing or damaged.
    pub(crate) async fn source(
        &self,
        id: &CaseId,
        names: &[ObjectName],
    ) -> Result<Option<Source>, StoreError> {
        let Some(volume) = self.read(id, names, ObjectKind::SourceVolume).await? else {
            return Ok(None);
        };
        let mut source = Source {
            volume,
            ..Source::default()
        };
        if names.iter().any(|name| name.kind == ObjectKind::SourceMask) {
            source.mask = self.read(id, names, ObjectKind::SourceMask).await?;
            if source.mask.is_none() {
                return Ok(None);
            }
        }
        Ok(Some(source))
    }

    /// Makes the derived objects of a ready case again, or makes the case failed where that is impossible.
    async fn rebuild(&self, id: &CaseId) -> Result<(), StoreError> {
        let Some(case) = self.rows().case(id).await? else {
            return Ok(());
        };
        let names = self.rows().objects(id).await?;
        let rebuilt = match self.source(id, &names).await? {
            Some(mut source) => {
                source.brain = self.extracted(&case, &names).await?;
                self.derive(source, case.parameters).await?
            }
            None => Err(source_damaged()),
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
                self.publish(Publisher::Rebuild(id), &framed, &derived.facts)
                    .await?;
                self.signals().count(Count::Rebuild);
                tracing::warn!(case = %id, "the derived objects of a case were made again from its source");
            }
            Err(failure) => {
                self.rows().condemn(id, &failure).await?;
                tracing::error!(case = %id, kind = failure.kind, "a case cannot be made again from its source");
            }
        }
        self.signals().changed(id);
        Ok(())
    }

    /// The brain mask of a case, where it was extracted: it stays what it was, whichever way this server would extract it now.
    async fn extracted(
        &self,
        case: &Case,
        names: &[ObjectName],
    ) -> Result<Option<StoredBrain>, StoreError> {
        let quality = case.facts.as_ref().and_then(|facts| facts.quality.clone());
        let Some(quality) = quality.filter(|quality| quality.method.is_extraction()) else {
            return Ok(None);
        };
        let mask = self.read(&case.id, names, ObjectKind::Mask).await?;
        Ok(mask.map(|mask| StoredBrain { mask, quality }))
    }

    async fn derive(
        &self,
        source: Source,
        parameters: Parameters,
    ) -> Result<Result<Derived, Failure>, StoreError> {
        let preparation = self.options().preparation.clone();
        let limits = self.options().limits;
        let derived = tokio::task::spawn_blocking(move || {
            let never = AtomicBool::new(false);
            preparation.run(&source, &parameters, &limits, &|_| {}, &never)
        });
        Ok(derived.await?)
    }

    /// Makes derived objects durable, then publishes them in one transaction. Leaves nothing where that fails.
    pub(crate) async fn publish(
        &self,
        publisher: Publisher<'_>,
        derived: &[Framed],
        facts: &CaseFacts,
    ) -> Result<Published, StoreError> {
        for _ in 0..PUBLISH_ATTEMPTS {
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
            "an object under way was removed again and again".into(),
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
        let now = self.now();
        match publisher {
            Publisher::Worker(claim) => self.rows().publish(claim, pinned, facts, now).await,
            Publisher::Rebuild(id) => self.rows().replace(id, pinned, now).await,
        }
    }
}

/// Packs and frames derived objects on a blocking thread.
pub(crate) async fn frame_all(
    objects: Vec<(ObjectKind, Bytes)>,
) -> Result<Vec<Framed>, StoreError> {
    let framed = tokio::task::spawn_blocking(move || {
        let framed = objects.into_iter().map(|(kind, plain)| frame(kind, plain));
        framed.collect()
    });
    Ok(framed.await?)
}

/// What a case fails with when its mask was lost and would become another one.
fn extracted_otherwise() -> Failure {
    Failure {
        kind: "mask-damaged".to_owned(),
        detail: "the stored mask is damaged, and this server would extract the brain in another way; upload the volume again"
            .to_owned(),
        status: 500,
    }
}

/// What a case fails with when the uploaded files themselves cannot be read back.
pub(crate) fn source_damaged() -> Failure {
    Failure {
        kind: "source-damaged".to_owned(),
        detail: "the stored upload is damaged; upload the volume again".to_owned(),
        status: 500,
    }
}
