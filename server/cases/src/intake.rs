//! Makes a queued case from spooled files. DICOM files become a volume first. The files are checked at once, so that
//! the store contains only usable uploads.
//!
//! Files from the store were checked before.

#[cfg(test)]
mod tests;

use bytes::Bytes;
use case::{CaseId, CaseState, Failure, Parameters};
use imaging::{START_BYTES, sniff};
use pipeline::{Source, check};
use storage::{NewMask, Spooled, Store, Submitted, Upload, Version};
use tempfile::TempDir;

use crate::application::Cases;
use crate::client::{in_store, this_client};
use crate::dicom::{Attributes, Choice, Form, Input, Options};
use crate::error::Error;
use crate::series::series_of_stored;

/// The received files of a volume.
#[derive(Debug)]
pub enum VolumeFiles {
    /// One file, of any kind.
    One(Spooled),
    /// DICOM files in a directory.
    Dicom(TempDir),
}

impl Cases {
    /// Makes an upload of received files. DICOM files, recognised by content, become a volume; the choice among them is
    /// returned, too. It is `None` if the file is not DICOM, and `options` is not used then.
    ///
    /// # Errors
    /// As [`DicomReader::read`](crate::dicom::DicomReader::read), or an error of the store.
    pub async fn upload(
        &self,
        volume: VolumeFiles,
        mask: Option<Spooled>,
        options: &Options,
    ) -> Result<(Upload, Option<Choice>), Error> {
        let is_removed = self.deidentifies();
        self.read_upload(volume, mask, options, is_removed).await
    }

    /// As [`Cases::upload`], whether or not the identity of the patient is removed.
    ///
    /// # Errors
    /// As [`Cases::upload`].
    pub async fn read_upload(
        &self,
        volume: VolumeFiles,
        mask: Option<Spooled>,
        options: &Options,
        is_identity_removed: bool,
    ) -> Result<(Upload, Option<Choice>), Error> {
        let (store, scratch) = (self.store(), self.store().spools().path());
        let mask = match (mask, options.form) {
            (Some(mask), Some(form)) => Some(self.keeping_form(mask, form).await?),
            (mask, _) => mask,
        };
        let options = Options {
            deidentifies: is_identity_removed,
            ..options.clone()
        };
        let read = async |input| self.dicom.read(input, &options, &scratch).await;
        let reading = match volume {
            VolumeFiles::Dicom(directory) => read(Input::Directory(&directory)).await?,
            VolumeFiles::One(volume) => {
                if !sniff(&volume.head(START_BYTES).await?).may_be_dicom() {
                    let volume = match options.form {
                        Some(form) => self.keeping_form(volume, form).await?,
                        None => volume,
                    };
                    let upload = Upload {
                        volume,
                        mask,
                        dicom: None,
                        images: Vec::new(),
                        series: None,
                    };
                    return Ok((upload, None));
                }
                read(Input::Spooled(&volume)).await?
            }
        };
        let attributes = match is_identity_removed {
            true => without_identity(&reading.attributes)?,
            false => reading.attributes.clone(),
        };
        let upload = Upload {
            volume: store.spools().take(reading.file()).await?,
            mask,
            series: series_of_stored(&attributes),
            dicom: Some(store.spools().of(attributes).await?),
            images: reading.images,
        };
        Ok((upload, Some(reading.choice)))
    }

    /// A NIfTI file with one of the two forms of its header alone, so that whoever reads it later needs to know of no choice.
    ///
    /// # Errors
    /// [`Error::Failure`] if the file cannot be read or does not have the form; or an error of the store.
    pub async fn keeping_form(&self, file: Spooled, form: Form) -> Result<Spooled, Error> {
        let (bytes, limits) = (file.read().await?, self.library.limits());
        let kept = self
            .queue
            .run(move || pipeline::keeping_form(&bytes, form, &limits))
            .await??;
        Ok(self.store().spools().of(kept.into()).await?)
    }

    /// Checks an upload and queues it. A case that is there already is answered as it is; it keeps its label, if it has one and the
    /// upload does not rename it. A new case of DICOM files without a label is named after its series.
    ///
    /// # Errors
    /// [`Error::Failure`] that states what is wrong with the upload, [`Error::Busy`] if too much is waiting, or an
    /// error of the store.
    pub async fn submit(
        &self,
        upload: Upload,
        parameters: Parameters,
        renames: bool,
    ) -> Result<Submitted, Error> {
        parameters.check()?;
        let submitted = self.accept(upload, parameters, None, renames).await?;
        let case = submitted.case.id.short();
        tracing::info!(case, is_new = submitted.created, "an upload was accepted");
        Ok(submitted)
    }

    /// Checks an upload and queues it as a version of another case, if there is one.
    ///
    /// # Errors
    /// As [`Cases::submit`].
    pub async fn submit_after(
        &self,
        upload: Upload,
        parameters: Parameters,
        previous: Option<CaseId>,
    ) -> Result<Submitted, Error> {
        self.accept(upload, parameters, previous, true).await
    }

    async fn accept(
        &self,
        upload: Upload,
        parameters: Parameters,
        previous: Option<CaseId>,
        renames: bool,
    ) -> Result<Submitted, Error> {
        let mut parameters = self.check_upload(&upload, parameters).await?;
        let renames = renames && parameters.name.is_some();
        if parameters.name.is_none()
            && let Some(stored) = &upload.dicom
        {
            parameters.name = self.label_of(&pipeline::attributes(&stored.read().await?)?);
        }
        let store = self.store_of_client();
        Ok(store.submit(upload, parameters, previous, renames).await?)
    }

    /// The store for the client of this request.
    pub(crate) fn store_of_client(&self) -> Store {
        self.store().for_client(&in_store(this_client()))
    }

    /// The label of a series; `None` if identities are not kept, which a name of a series may be.
    pub(crate) fn label_of(&self, attributes: &Attributes) -> Option<String> {
        let label = attributes.label().filter(|_| !self.deidentifies());
        label.filter(|label| Parameters::check_name(label).is_ok())
    }

    /// Checks a version of a case and queues it, as [`Cases::submit`].
    ///
    /// # Errors
    /// As [`Cases::submit`]; [`Error::NoSuchCase`] if the case was deleted.
    pub async fn submit_version(&self, mut version: Version) -> Result<Submitted, Error> {
        let of = version.of;
        version.parameters = self.check_version(&version).await?;
        let store = self.store_of_client();
        let submitted = store.submit_version(version).await?;
        let submitted = submitted.ok_or(Error::NoSuchCase)?;
        tracing::info!(
            case = submitted.case.id.short(),
            of = of.short(),
            is_new = submitted.created,
            "a version of a case was accepted"
        );
        Ok(submitted)
    }

    async fn check_upload(
        &self,
        upload: &Upload,
        parameters: Parameters,
    ) -> Result<Parameters, Error> {
        if self.is_accepted(&upload.case_id(&parameters)).await? {
            return Ok(parameters);
        }
        let start = upload.volume.head(START_BYTES).await?;
        let _room = self.checks.enter(&start).await?;
        let mask = match &upload.mask {
            Some(mask) => Some(mask.read().await?),
            None => None,
        };
        let source = Source {
            volume: upload.volume.read().await?,
            mask,
            ..Source::default()
        };
        self.check(source, parameters).await
    }

    async fn check_version(&self, version: &Version) -> Result<Parameters, Error> {
        let names = self.store().objects_of(&version.of).await?;
        let id = version.id(&names).ok_or(Error::NoSuchCase)?;
        let parameters = version.parameters.clone();
        if self.is_accepted(&id).await? {
            return Ok(parameters);
        }
        let source = self.library.source(&version.of, &names).await?;
        let mut source = source.ok_or_else(Failure::source_damaged)?;
        match &version.mask {
            NewMask::Supplied(file) => source.mask = Some(file.read().await?),
            NewMask::None => source.mask = None,
            NewMask::Kept => {}
        }
        let start = source
            .volume
            .slice(..source.volume.len().min(START_BYTES as usize));
        let _room = self.checks.enter(&start).await?;
        self.check(source, parameters).await
    }

    /// Whether a case was accepted before.
    async fn is_accepted(&self, id: &CaseId) -> Result<bool, Error> {
        let known = self.store().case(id).await?;
        Ok(known.is_some_and(|case| case.state != CaseState::Failed))
    }

    /// Rejects unusable uploads; returns the parameters for the preparation.
    async fn check(&self, source: Source, parameters: Parameters) -> Result<Parameters, Error> {
        let (limits, has_network) = (self.library.limits(), self.library.has_network());
        let check = move || check(&source, parameters, &limits, has_network);
        Ok(self.queue.run(check).await??)
    }
}

/// Stored attributes without the identity of the patient.
fn without_identity(stored: &Bytes) -> Result<Bytes, Error> {
    let attributes = pipeline::attributes(stored)?.deidentified();
    let stored = serde_json::to_vec(&attributes).map_err(|_| Error::Internal)?;
    Ok(stored.into())
}
