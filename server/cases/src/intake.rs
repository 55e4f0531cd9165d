//! Makes a queued case from spooled files. The files are checked at once, so that the store contains only usable
//! uploads.
//!
//! Files from the store were checked before. A volume that was decoded for the check is handed to the worker that
//! prepares it.

#[cfg(test)]
mod tests;

use case::{CaseId, CaseState, Failure, Parameters};
use pipeline::{Source, check};
use storage::{NewMask, Submitted, Upload, Version};
use tokio::sync::OwnedSemaphorePermit;

use crate::application::Cases;
use crate::error::Error;
use crate::handover::Offer;

/// The number of bytes that contain the size of a volume, gzipped or not.
const START_BYTES: usize = 64 << 10;

impl Cases {
    /// Checks an upload and queues it. A case that is there already is answered as it is; with `keep_name` it keeps its
    /// label, too.
    ///
    /// # Errors
    /// [`Error::Failure`] that states what is wrong with the upload, [`Error::Busy`] if too much is waiting, or an
    /// error of the store.
    pub async fn submit(
        &self,
        upload: Upload,
        mut parameters: Parameters,
        keep_name: bool,
    ) -> Result<Submitted, Error> {
        parameters.check()?;
        let id = upload.case_id(&parameters);
        if keep_name && self.store().case(&id).await?.is_some() {
            parameters.name = None;
        }
        let (parameters, offer) = self.check_upload(&upload, parameters).await?;
        let submitted = self.store().submit_upload(upload, parameters).await?;
        keep_if_queued(offer, &submitted);
        Ok(submitted)
    }

    /// Checks a version of a case and queues it, as [`Cases::submit`].
    ///
    /// # Errors
    /// As [`Cases::submit`]; [`Error::NoSuchCase`] if the case was deleted.
    pub async fn submit_version(&self, mut version: Version) -> Result<Submitted, Error> {
        let offer;
        (version.parameters, offer) = self.check_version(&version).await?;
        let submitted = self.store().submit_version(version).await?;
        let submitted = submitted.ok_or(Error::NoSuchCase)?;
        keep_if_queued(offer, &submitted);
        Ok(submitted)
    }

    async fn check_upload(
        &self,
        upload: &Upload,
        parameters: Parameters,
    ) -> Result<(Parameters, Option<Offer>), Error> {
        let id = upload.case_id(&parameters);
        if self.is_accepted(&id).await? {
            return Ok((parameters, None));
        }
        let start = upload.volume.head(START_BYTES as u64).await?;
        let room = self.checks.enter(&start).await?;
        // An equal upload may have been accepted meanwhile.
        if self.is_accepted(&id).await? {
            return Ok((parameters, None));
        }
        let mask = match &upload.mask {
            Some(mask) => Some(mask.read().await?),
            None => None,
        };
        let source = Source {
            volume: upload.volume.read().await?,
            mask,
            ..Source::default()
        };
        let id = |parameters: &Parameters| Some(upload.case_id(parameters));
        self.check(source, parameters, room, id).await
    }

    async fn check_version(&self, version: &Version) -> Result<(Parameters, Option<Offer>), Error> {
        let names = self.store().rows().objects(&version.of).await?;
        let id = version.id(&names).ok_or(Error::NoSuchCase)?;
        let parameters = version.parameters.clone();
        if self.is_accepted(&id).await? {
            return Ok((parameters, None));
        }
        let source = self.library.source(&version.of, &names).await?;
        let mut source = source.ok_or_else(Failure::source_damaged)?;
        match &version.mask {
            NewMask::Supplied(file) => source.mask = Some(file.read().await?),
            NewMask::None => source.mask = None,
            NewMask::Kept => {}
        }
        let start = source.volume.slice(..source.volume.len().min(START_BYTES));
        let room = self.checks.enter(&start).await?;
        let id = |parameters: &Parameters| version.id_with(&names, parameters);
        self.check(source, parameters, room, id).await
    }

    /// Whether a case was accepted before.
    async fn is_accepted(&self, id: &CaseId) -> Result<bool, Error> {
        let known = self.store().case(id).await?;
        Ok(known.is_some_and(|case| case.state != CaseState::Failed))
    }

    /// Rejects unusable uploads; returns the parameters for the preparation, and offers the volume to a worker.
    async fn check(
        &self,
        source: Source,
        parameters: Parameters,
        room: OwnedSemaphorePermit,
        id: impl Fn(&Parameters) -> Option<CaseId>,
    ) -> Result<(Parameters, Option<Offer>), Error> {
        let (limits, has_network) = (self.library.limits(), self.library.has_network());
        let check = move || check(&source, parameters, &limits, has_network);
        let checked = self.queue.run(check).await??;
        let handover = self.library.handover();
        let offer = id(&checked.parameters).map(|id| handover.offer(id, checked.read, room));
        Ok((checked.parameters, offer))
    }
}

/// Keeps the volume of a queued case for a worker.
fn keep_if_queued(offer: Option<Offer>, submitted: &Submitted) {
    if let Some(offer) = offer.filter(|_| submitted.created) {
        offer.keep();
    }
}
