//! From an upload to a queued case.

use std::time::{Duration, Instant};

use super::rows::{Inserted, NewCase, Pinned};
use super::{ObjectName, Spooled, Store, StoreError, Upload};
use case::{Case, CaseId, CaseState, ObjectKind, Parameters};

/// How long an object may be under way to the store before it may be swept.
const PIN_FOR: Duration = Duration::from_secs(3600);

/// How long to wait for an object that is being removed: longer than the lease of a sweep that was killed.
const REMOVAL_PATIENCE: Duration = Duration::from_secs(90);

/// How often to look whether it is gone.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// How often a lost pin is taken again.
const PIN_ATTEMPTS: usize = 3;

/// What became of an upload.
#[derive(Debug, Clone)]
pub struct Submitted {
    /// The case.
    pub case: Case,
    /// Whether its preparation was queued: it was not there before, or had failed.
    pub created: bool,
}

/// A version of a case: its volume, with another mask or other parameters.
#[derive(Debug)]
pub struct Version {
    /// The case.
    pub of: CaseId,
    /// Its mask.
    pub mask: NewMask,
    /// How it is to be prepared.
    pub parameters: Parameters,
}

/// The mask of a version.
#[derive(Debug)]
pub enum NewMask {
    /// It is supplied.
    Supplied(Spooled),
    /// What was supplied with the case, if anything was.
    Kept,
    /// None is supplied.
    None,
}

impl Version {
    /// The files from which the version is prepared, given the objects of the case; those that are stored already come
    /// without a file.
    fn sources(&self, of: &[ObjectName]) -> Vec<(ObjectName, Option<&Spooled>)> {
        let keeps_mask = matches!(self.mask, NewMask::Kept);
        let kept = of.iter().filter(|name| {
            name.kind.is_source() && (keeps_mask || name.kind != ObjectKind::SourceMask)
        });
        let mut sources: Vec<_> = kept.map(|&name| (name, None)).collect();
        if let NewMask::Supplied(file) = &self.mask {
            let digest = *file.digest();
            let kind = ObjectKind::SourceMask;
            sources.push((ObjectName { kind, digest }, Some(file)));
        }
        sources
    }

    /// The name of the version, given the objects of the case; `None` where there is no volume among them.
    pub fn id(&self, of: &[ObjectName]) -> Option<CaseId> {
        self.id_with(of, &self.parameters)
    }

    /// Its name with other parameters.
    pub fn id_with(&self, of: &[ObjectName], parameters: &Parameters) -> Option<CaseId> {
        id_of(&self.sources(of), parameters)
    }
}

fn id_of(sources: &[(ObjectName, Option<&Spooled>)], parameters: &Parameters) -> Option<CaseId> {
    let digest = |kind| {
        let source = sources.iter().find(|(name, _)| name.kind == kind);
        source.map(|(name, _)| name.digest)
    };
    let mask = digest(ObjectKind::SourceMask);
    let volume = digest(ObjectKind::SourceVolume)?;
    // The same picture of somebody else is another case.
    let volume = digest(ObjectKind::SourceDicom).map_or(volume, |dicom| {
        blake3::Hasher::new()
            .update(b"isocortex dicom")
            .update(volume.as_bytes())
            .update(dicom.as_bytes())
            .finalize()
    });
    Some(CaseId::of(&volume, mask.as_ref(), parameters))
}

impl Upload {
    /// The name of the case that this is.
    pub fn case_id(&self, parameters: &Parameters) -> CaseId {
        id_of(&source_files(self), parameters).expect("an upload has a volume")
    }
}

/// What a case is made of.
struct Inputs<'a> {
    id: CaseId,
    /// The files; those that are stored already, as objects of `previous`, come without one.
    sources: Vec<(ObjectName, Option<&'a Spooled>)>,
    previous: Option<CaseId>,
    parameters: Parameters,
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
        let submit = async move {
            let inputs = Inputs {
                id: upload.case_id(&parameters),
                sources: source_files(&upload),
                previous: None,
                parameters,
            };
            if let Some(name) = &inputs.parameters.name {
                store.rows().rename(&inputs.id, name).await?;
            }
            let submitted = store.submit_now(inputs).await?;
            submitted.ok_or_else(|| StoreError::Rows("an upload lacks its own files".into()))
        };
        tokio::spawn(submit).await?
    }

    /// Makes a version of a case and queues its preparation; `None` where there is no such case (any more).
    ///
    /// It carries the label of the case. Where the same volume, mask and parameters are a case already, that stays as it is,
    /// but a failed one is queued again. Once begun it is carried through, even when the caller goes away.
    ///
    /// # Errors
    /// As [`Store::submit_upload`].
    pub async fn submit_version(&self, version: Version) -> Result<Option<Submitted>, StoreError> {
        let store = self.clone();
        let submit = async move {
            let Some(case) = store.rows().case(&version.of).await? else {
                return Ok(None);
            };
            let sources = version.sources(&store.rows().objects(&version.of).await?);
            let parameters = Parameters {
                name: case.parameters.name,
                ..version.parameters.clone()
            };
            let Some(id) = id_of(&sources, &parameters) else {
                return Ok(None);
            };
            let inputs = Inputs {
                id,
                sources,
                previous: Some(version.of),
                parameters,
            };
            store.submit_now(inputs).await
        };
        tokio::spawn(submit).await?
    }

    /// `None` where a stored source has gone.
    async fn submit_now(&self, inputs: Inputs<'_>) -> Result<Option<Submitted>, StoreError> {
        let id = &inputs.id;
        for _ in 0..PIN_ATTEMPTS {
            if let Some(case) = self.case(id).await?
                && case.state != CaseState::Failed
            {
                return Ok(Some(Submitted {
                    case,
                    created: false,
                }));
            }
            if self.waiting().await? >= self.options().queue_limit {
                return Err(StoreError::QueueFull);
            }
            let Some(inserted) = self.insert(&inputs).await? else {
                return Ok(None);
            };
            if inserted == Inserted::QueueFull {
                return Err(StoreError::QueueFull);
            }
            self.signals().changed(id);
            self.signals().queued();
            // Where another process deletes the case at this very moment, it is inserted once more.
            if inserted != Inserted::PinLost
                && let Some(case) = self.case(id).await?
            {
                let created = matches!(inserted, Inserted::Created | Inserted::Requeued);
                return Ok(Some(Submitted { case, created }));
            }
        }
        Err(StoreError::Rows(
            "an object under way was removed again and again".into(),
        ))
    }

    /// Writes the sources and inserts the case; leaves nothing where that fails. `None` where a stored source has gone.
    async fn insert(&self, inputs: &Inputs<'_>) -> Result<Option<Inserted>, StoreError> {
        let sources = self
            .pin(inputs.sources.iter().map(|(name, _)| *name))
            .await?;
        let inserted = self.insert_pinned(inputs, &sources).await;
        if !matches!(inserted, Ok(Some(Inserted::Created | Inserted::Requeued))) {
            self.abandon(&sources).await;
        }
        inserted
    }

    async fn insert_pinned(
        &self,
        inputs: &Inputs<'_>,
        sources: &Pinned,
    ) -> Result<Option<Inserted>, StoreError> {
        // Now that they are pinned: what the other case still needs will stay.
        let stored = match &inputs.previous {
            Some(previous) => self.rows().objects(previous).await?,
            None => Vec::new(),
        };
        for (name, file) in &inputs.sources {
            match file {
                Some(file) => {
                    self.inner.objects.put_file(name, file).await?;
                }
                None if stored.contains(name) => {}
                None => return Ok(None),
            }
        }
        let new = NewCase {
            id: inputs.id,
            parameters: inputs.parameters.clone(),
            previous: inputs.previous,
            sources: sources.clone(),
            queue_limit: self.options().queue_limit,
        };
        self.rows().insert(&new).await.map(Some)
    }

    /// Pins objects that are about to be written. Waits for those that are being removed.
    ///
    /// # Errors
    /// When the rows cannot be written.
    pub async fn pin(
        &self,
        names: impl IntoIterator<Item = ObjectName>,
    ) -> Result<Pinned, StoreError> {
        let pinned = Pinned {
            holder: unique_holder(),
            names: names.into_iter().collect(),
        };
        let begun = Instant::now();
        while !self.rows().pin(&pinned, PIN_FOR).await? {
            if begun.elapsed() > REMOVAL_PATIENCE {
                return Err(StoreError::Objects(
                    "an object is being removed for too long".into(),
                ));
            }
            tokio::time::sleep(LOOK_EVERY).await;
            // If its remover was killed, nobody but us may finish its work.
            self.collect().await?;
        }
        Ok(pinned)
    }

    /// Gives up objects that were pinned. What fails now is done when their pins have expired.
    pub(super) async fn abandon(&self, pinned: &Pinned) {
        let unpinned = self.rows().unpin(pinned).await;
        let collected = match unpinned {
            Ok(()) => self.collect().await,
            Err(error) => Err(error),
        };
        if let Err(error) = collected {
            tracing::warn!(%error, "objects that were given up are removed later");
        }
    }
}

fn source_files(upload: &Upload) -> Vec<(ObjectName, Option<&Spooled>)> {
    let named = |kind, file| {
        let digest = *Spooled::digest(file);
        (ObjectName { kind, digest }, Some(file))
    };
    let volume = named(ObjectKind::SourceVolume, &upload.volume);
    let mask = upload.mask.as_ref();
    let mask = mask.map(|file| named(ObjectKind::SourceMask, file));
    let dicom = upload.dicom.as_ref();
    let dicom = dicom.map(|file| named(ObjectKind::SourceDicom, file));
    std::iter::once(volume).chain(mask).chain(dicom).collect()
}

/// A name that no other act of writing or removing has, in whichever process.
pub(super) fn unique_holder() -> String {
    uuid::Uuid::now_v7().to_string()
}
