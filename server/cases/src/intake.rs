//! From spooled files to a queued case: checked at once, so that nothing that cannot be prepared gets into the store.
//!
//! What is in the store was checked before. What the check reads of a volume goes on to the worker that prepares it.

#[cfg(test)]
mod tests;

use case::{CaseId, CaseState, Failure, Parameters};
use pipeline::{Source, check};
use storage::{NewMask, Submitted, Upload, Version};
use tokio::sync::OwnedSemaphorePermit;

use crate::application::Cases;
use crate::error::Error;
use crate::handover::Offer;

/// What tells the size of a volume, packed or not.
const START_BYTES: usize = 64 << 10;

impl Cases {
    /// Checks an upload and queues it. A case that is there already is answered as it is; with `keep_name` it keeps its label, too.
    ///
    /// # Errors
    /// [`Error::Failure`] with what is wrong with the upload, [`Error::Busy`] if too much waits, or the store's.
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
    /// As [`Cases::submit`]; [`Error::NoSuchCase`] if the case is gone.
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
        // The same may have been accepted while this one waited.
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

    /// Refuses what cannot be prepared; the parameters with which it will be, and its volume on the way to a worker.
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

/// The volume of a case that is to be prepared waits for a worker.
fn keep_if_queued(offer: Option<Offer>, submitted: &Submitted) {
    if let Some(offer) = offer.filter(|_| submitted.created) {
        offer.keep();
    }
}
