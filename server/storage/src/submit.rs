//! Makes a queued case from an upload.

use super::pinned::Writing;
use super::rows::{Made, NewCase, Pinned, Referred, Relabel, Submitted};
use super::tables::made;
use super::{Manifest, ObjectName, Spooled, Store, StoreError};
use case::images::Image;
use case::series::CaseSeries;
use case::{CaseId, JobKind, ObjectKind, Parameters};

/// The files of an upload.
#[derive(Debug)]
pub struct Upload {
    pub volume: Spooled,
    /// The mask of the brain.
    pub mask: Option<Spooled>,
    /// The identifying attributes, if the volume comes from DICOM.
    pub dicom: Option<Spooled>,
    /// The images that the volume is made of, if it comes from DICOM.
    pub images: Vec<Image>,
    /// Its series, if the volume comes from DICOM.
    pub series: Option<CaseSeries>,
}

/// A version of a case: its volume, with another mask or other parameters.
#[derive(Debug)]
pub struct Version {
    /// The case.
    pub of: CaseId,
    pub mask: NewMask,
    /// The parameters of its preparation.
    pub parameters: Parameters,
}

/// The mask of a version.
#[derive(Debug)]
pub enum NewMask {
    /// A supplied mask.
    Supplied(Spooled),
    /// The supplied mask of the case, if any.
    Kept,
    /// No supplied mask.
    None,
}

impl Version {
    /// The source files of the version, given the objects of the case; files that are stored already have no path.
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

    /// The name of the version, given the objects of the case; `None` if there is no volume among them.
    pub fn id(&self, of: &[ObjectName]) -> Option<CaseId> {
        id_of(&self.sources(of), &self.parameters)
    }
}

fn id_of(sources: &[(ObjectName, Option<&Spooled>)], parameters: &Parameters) -> Option<CaseId> {
    let digest = |kind| {
        let source = sources.iter().find(|(name, _)| name.kind == kind);
        source.map(|(name, _)| name.digest)
    };
    let mask = digest(ObjectKind::SourceMask);
    let volume = digest(ObjectKind::SourceVolume)?;
    // The same volume of another patient is another case.
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
    /// The id of the case of this upload.
    pub fn case_id(&self, parameters: &Parameters) -> CaseId {
        id_of(&source_files(self), parameters).expect("an upload has a volume")
    }
}

/// A case and its sources.
struct Inputs<'a> {
    /// The case; nothing of it is pinned yet.
    new: NewCase,
    /// The files; files that are stored already, as objects of the previous case, have no path.
    sources: Vec<(ObjectName, Option<&'a Spooled>)>,
}

impl Store {
    /// Makes a case from spooled files and queues its preparation; as a version of another case, if there is one: the upload has more
    /// images of the same series.
    ///
    /// An existing case is unchanged, but a failed one is queued again, and one without a label gets that of the parameters; with
    /// `renames`, any gets it. The operation completes even if the caller drops the future.
    ///
    /// # Errors
    /// [`StoreError::QueueFull`], or another error if the store fails; nothing is left behind then. The parameters are
    /// not checked here.
    pub async fn submit(
        &self,
        upload: Upload,
        parameters: Parameters,
        previous: Option<CaseId>,
        renames: bool,
    ) -> Result<Submitted, StoreError> {
        let store = self.clone();
        let submit = async move {
            let new = NewCase {
                id: upload.case_id(&parameters),
                parameters,
                previous,
                images: Some(upload.images.clone()),
                series: upload.series.clone(),
                relabel: match renames {
                    true => Relabel::Any,
                    false => Relabel::Unlabelled,
                },
                sources: Pinned::new([]),
                queue_limit: store.options().queue_limit,
                client: store.client.to_string(),
            };
            let sources = source_files(&upload);
            let submitted = store.submit_now(Inputs { new, sources }).await?;
            submitted.ok_or_else(|| StoreError::Rows("an upload lacks its own files".into()))
        };
        tokio::spawn(submit).await?
    }

    /// Makes a version of a case and queues its preparation; `None` if there is no such case (any more).
    ///
    /// It has the label of the case. If the same volume, mask and parameters are a case already, that case is
    /// unchanged, but a failed one is queued again. The operation completes even if the caller drops the future.
    ///
    /// # Errors
    /// As [`Store::submit`].
    pub async fn submit_version(&self, version: Version) -> Result<Option<Submitted>, StoreError> {
        let store = self.clone();
        let submit = async move {
            let Some(case) = store.case(&version.of).await? else {
                return Ok(None);
            };
            let sources = version.sources(&store.objects_of(&version.of).await?);
            let parameters = Parameters {
                name: case.parameters.name,
                ..version.parameters.clone()
            };
            let Some(id) = id_of(&sources, &parameters) else {
                return Ok(None);
            };
            let new = NewCase {
                id,
                parameters,
                previous: Some(version.of),
                images: None,
                series: None,
                relabel: Relabel::None,
                sources: Pinned::new([]),
                queue_limit: store.options().queue_limit,
                client: store.client.to_string(),
            };
            store.submit_now(Inputs { new, sources }).await
        };
        tokio::spawn(submit).await?
    }

    /// `None` if a stored source has gone.
    async fn submit_now(&self, inputs: Inputs<'_>) -> Result<Option<Submitted>, StoreError> {
        let submitted = loop {
            match self.try_to_submit(&inputs).await {
                Err(StoreError::DamagedFacts(id)) => self.make_facts_again(&id).await?,
                tried => break tried?,
            }
        };
        if submitted
            .as_ref()
            .is_some_and(|submitted| submitted.created)
        {
            self.signals().changed(&inputs.new.id);
            self.signals().queued();
        }
        Ok(submitted.map(|Submitted { case, created }| Submitted {
            case: self.completed(case),
            created,
        }))
    }

    async fn try_to_submit(&self, inputs: &Inputs<'_>) -> Result<Option<Submitted>, StoreError> {
        if self.has_files(inputs).await?
            && let Some(known) = self.uploaded_again(&inputs.new).await?
        {
            return Ok(Some(known));
        }
        self.check_room(JobKind::PREPARE).await?;
        self.insert(inputs).await
    }

    /// Whether the files that are uploaded are stored: one that is lost is written again.
    async fn has_files(&self, inputs: &Inputs<'_>) -> Result<bool, StoreError> {
        for (name, file) in &inputs.sources {
            if file.is_some() && !self.objects().has(name).await? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Writes the sources and the manifest, and inserts the case. `None` if a stored source has gone.
    async fn insert(&self, inputs: &Inputs<'_>) -> Result<Option<Submitted>, StoreError> {
        let new = &inputs.new;
        let names = inputs.sources.iter().map(|(name, _)| *name);
        let images = match (&new.images, &new.previous) {
            (Some(images), _) => images.clone(),
            (None, Some(previous)) => {
                made::of(&mut self.connect().await?, &Made::case(previous)).await?
            }
            (None, None) => Vec::new(),
        };
        let manifest = Manifest::of_case(new.id, names, &new.parameters, new.previous, images);
        let manifest = manifest.framed()?;
        let sources = inputs.sources.iter().map(|(name, file)| match file {
            Some(file) => Writing::File(*name, file),
            None => Writing::Stored(*name),
        });
        let objects: Vec<_> = sources.chain([Writing::Framed(&manifest)]).collect();
        let insert = |sources: Pinned| async move {
            // After they are pinned, the objects of the other case will stay.
            let stored = match &new.previous {
                Some(previous) => self.objects_of(previous).await?,
                None => Vec::new(),
            };
            let is_gone = |(name, file): &(ObjectName, Option<&Spooled>)| {
                file.is_none() && !stored.contains(name)
            };
            if inputs.sources.iter().any(is_gone) {
                return Ok(Referred::Unneeded(None));
            }
            let new = NewCase {
                sources,
                ..new.clone()
            };
            Ok(match self.insert_case(&new).await? {
                Referred::Done(submitted) => Referred::Done(Some(submitted)),
                Referred::Unneeded(known) => Referred::Unneeded(Some(known)),
                Referred::PinLost => Referred::PinLost,
            })
        };
        self.with_pinned(&objects, insert).await
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
