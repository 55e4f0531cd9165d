//! From an upload to a queued case.

use jiff::{SignedDuration, Timestamp};

use super::rows::{Inserted, NewCase, Pinned};
use super::{ObjectKind, ObjectName, Spooled, Store, StoreError, Upload};
use crate::case::{Case, CaseId, CaseState, Parameters};
use crate::prepare::Source;

/// How long an object may be under way to the store before it may be swept.
const PIN_FOR: SignedDuration = SignedDuration::from_hours(1);

/// How often a lost pin is taken again.
const PIN_ATTEMPTS: usize = 3;

/// What became of an upload.
#[derive(Debug, Clone)]
pub struct Submitted {
    /// The case.
    pub case: Case,
    /// Whether it was not there before.
    pub created: bool,
}

impl Store {
    /// Makes a case of spooled files and queues its preparation.
    ///
    /// A case that is there already stays as it is, but a failed one is queued again. Once begun it is carried through, even
    /// when the caller goes away.
    ///
    /// # Errors
    /// [`StoreError::QueueFull`], or when the store fails; nothing is left behind then. The parameters are not checked here.
    pub async fn submit_upload(
        &self,
        upload: Upload,
        parameters: Parameters,
    ) -> Result<Submitted, StoreError> {
        let store = self.clone();
        tokio::spawn(async move { store.submit_now(&upload, parameters).await }).await?
    }

    /// The same, from memory.
    ///
    /// # Errors
    /// As [`Store::submit_upload`].
    pub async fn submit(
        &self,
        source: Source,
        parameters: Parameters,
    ) -> Result<Submitted, StoreError> {
        let volume = self.spool_all(source.volume).await?;
        let mask = match source.mask {
            Some(bytes) => Some(self.spool_all(bytes).await?),
            None => None,
        };
        let dicom = match source.dicom {
            Some(bytes) => Some(self.spool_all(bytes).await?),
            None => None,
        };
        let upload = Upload {
            volume,
            mask,
            dicom,
        };
        self.submit_upload(upload, parameters).await
    }

    async fn submit_now(
        &self,
        upload: &Upload,
        parameters: Parameters,
    ) -> Result<Submitted, StoreError> {
        let id = upload.case_id(&parameters);
        for _ in 0..PIN_ATTEMPTS {
            if let Some(name) = &parameters.name {
                self.rows().rename(&id, name).await?;
            }
            if let Some(case) = self.case(&id).await?
                && case.state != CaseState::Failed
            {
                return Ok(Submitted {
                    case,
                    created: false,
                });
            }
            if self.waiting().await? >= self.options().queue_limit {
                return Err(StoreError::QueueFull);
            }
            let inserted = self.insert(&id, upload, &parameters).await?;
            if inserted == Inserted::QueueFull {
                return Err(StoreError::QueueFull);
            }
            self.signals().changed(&id);
            self.signals().queued();
            // Where another process deletes the case at this very moment, it is inserted once more.
            if inserted != Inserted::PinLost
                && let Some(case) = self.case(&id).await?
            {
                let created = inserted == Inserted::Created;
                return Ok(Submitted { case, created });
            }
        }
        Err(StoreError::Rows(
            "an object under way was removed again and again".into(),
        ))
    }

    /// Writes the sources and inserts the case; leaves nothing where that fails.
    async fn insert(
        &self,
        id: &CaseId,
        upload: &Upload,
        parameters: &Parameters,
    ) -> Result<Inserted, StoreError> {
        let files = source_files(upload);
        let sources = self.pin(files.iter().map(|(name, _)| *name)).await?;
        let inserted = self.insert_pinned(id, &files, &sources, parameters).await;
        if !matches!(inserted, Ok(Inserted::Created | Inserted::Requeued)) {
            self.abandon(&sources).await;
        }
        inserted
    }

    async fn insert_pinned(
        &self,
        id: &CaseId,
        files: &[(ObjectName, &Spooled)],
        sources: &Pinned,
        parameters: &Parameters,
    ) -> Result<Inserted, StoreError> {
        for (name, file) in files {
            self.inner
                .objects
                .put_file(name, file.path(), file.len())
                .await?;
        }
        let new = NewCase {
            id: *id,
            parameters: parameters.clone(),
            sources: sources.clone(),
            now: self.now(),
            queue_limit: self.options().queue_limit,
        };
        self.rows().insert(&new).await
    }

    /// Pins objects that are about to be written.
    pub(super) async fn pin(
        &self,
        names: impl IntoIterator<Item = ObjectName>,
    ) -> Result<Pinned, StoreError> {
        let pinned = Pinned {
            holder: unique_holder(),
            names: names.into_iter().collect(),
        };
        let until = self.now().checked_add(PIN_FOR).unwrap_or(Timestamp::MAX);
        self.rows().pin(&pinned, until).await?;
        Ok(pinned)
    }

    /// Gives up objects that were pinned. What fails now is done when their pins have expired.
    pub(super) async fn abandon(&self, pinned: &Pinned) {
        let unpinned = self.rows().unpin(pinned, self.now()).await;
        let collected = match unpinned {
            Ok(()) => self.collect().await,
            Err(error) => Err(error),
        };
        if let Err(error) = collected {
            tracing::warn!(%error, "objects that were given up are removed later");
        }
    }
}

fn source_files(upload: &Upload) -> Vec<(ObjectName, &Spooled)> {
    let named = |kind, file| {
        let digest = *Spooled::digest(file);
        (ObjectName { kind, digest }, file)
    };
    let volume = named(ObjectKind::SourceVolume, &upload.volume);
    let mask = upload.mask.as_ref();
    let mask = mask.map(|file| named(ObjectKind::SourceMask, file));
    let dicom = upload.dicom.as_ref();
    let dicom = dicom.map(|file| named(ObjectKind::SourceDicom, file));
    std::iter::once(volume).chain(mask).chain(dicom).collect()
}

/// A name that no other act of writing has, in whichever process.
fn unique_holder() -> String {
    use std::hash::{BuildHasher, RandomState};
    use std::sync::atomic::{AtomicU64, Ordering};
    static ACTS: AtomicU64 = AtomicU64::new(0);
    let act = ACTS.fetch_add(1, Ordering::Relaxed);
    // Each `RandomState` is keyed anew from the system's random numbers.
    let random = [0u8, 1].map(|part| RandomState::new().hash_one((part, act)));
    format!("{:016x}{:016x}-{act}", random[0], random[1])
}
