//! Series that come from a PACS, image by image, and become cases.
//!
//! Once nothing has come for a series for a while, it is read as a whole and becomes a case, or nothing, for a reason that is kept. Late
//! images make a new version of the case.

mod becomes;
mod contradiction;
mod heads;
mod matches;
mod read;
#[cfg(test)]
mod tests;

use std::sync::Arc;
use std::time::Duration;

use case::series::SeriesUids;
use case::{Failure, ObjectKind};
use cases::{Cases, Error, Patient};
use quick_cache::sync::Cache;
use serde::Deserialize;
use storage::{ObjectName, Spooled, upkeep};

use crate::identity::{InstanceIdentity, Rejection, replaced_series};
use crate::refusal::{Refusal, Status};
use crate::store::{ImageStatus, PacsStore};
use crate::values::{ArrivalSource, NewInstance, OTHER_OBJECTS, Reception};

pub(crate) use self::contradiction::SEVERAL_PATIENTS;
pub(crate) use self::heads::Head;
pub(crate) use self::matches::{Matches, SeriesWithoutCase};
pub use self::read::start_series_reader;

/// The most images whose patients are remembered.
const REMEMBERED_PATIENTS: usize = 4096;

/// Which series become cases.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SeriesRule {
    /// Series that are T1-weighted by their name or their timing.
    #[default]
    T1,
    /// All that make a volume.
    Any,
}

/// How series become cases.
#[derive(Debug, Clone, Copy)]
pub struct ArrivalOptions {
    /// How long nothing may have come for a series before it is read.
    pub stable: Duration,
    /// How long series and their images are kept after that, for late images.
    pub keep: Duration,
    /// Which series become cases.
    pub series: SeriesRule,
}

impl Default for ArrivalOptions {
    fn default() -> Self {
        Self {
            stable: Duration::from_secs(20),
            keep: Duration::from_secs(3 * 24 * 3600),
            series: SeriesRule::default(),
        }
    }
}

/// What comes from a PACS, and the cases that are made of it. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Arrivals {
    pub(crate) cases: Cases,
    store: PacsStore,
    /// The patients of stored images, which never change.
    patients: Arc<Cache<ObjectName, Patient>>,
}

/// An image, as its headers tell, with its file.
fn new_instance(identity: InstanceIdentity, file: &Spooled) -> NewInstance {
    NewInstance {
        uids: identity.uids,
        accession_number: identity.accession_number,
        sop_instance_uid: identity.sop_instance_uid,
        digest: *file.digest(),
        label: identity.label,
        fingerprint: identity.fingerprint,
    }
}

impl Arrivals {
    /// On an application, whose store has [`PacsTables`](crate::PacsTables).
    pub fn new(cases: Cases) -> Self {
        let store = PacsStore::new(cases.store().clone());
        let patients = Arc::new(Cache::new(REMEMBERED_PATIENTS));
        Self {
            cases,
            store,
            patients,
        }
    }

    /// The store with the rows of the PACS.
    pub fn store(&self) -> &PacsStore {
        &self.store
    }

    /// Adds images to their series, and returns what became of each. Afterwards they are durable.
    ///
    /// Of the images with one UID, the last one counts. What was made of another one before it is closed.
    ///
    /// # Errors
    /// An error of the store, such as a full disk; nothing is acknowledged then.
    pub(crate) async fn receive(
        &self,
        images: Vec<(InstanceIdentity, Spooled)>,
        source: ArrivalSource,
    ) -> Result<Vec<Reception>, Error> {
        let images = match self.cases.deidentifies() {
            true => self.without_identity(images).await?,
            false => images,
        };
        let uids: Vec<_> = images.iter().map(|(of, _)| of.uids.clone()).collect();
        let images = images
            .into_iter()
            .map(|(identity, file)| (new_instance(identity, &file), file));
        let received = self.store().receive(images.collect(), source).await?;
        let refused = uids.into_iter().zip(&received);
        let refused = refused
            .filter(|(_, became)| **became == Reception::Refused)
            .map(|(uids, _)| (uids, Refusal::NOT_BETTER));
        self.count_refused(refused.collect(), source).await;
        Ok(received)
    }

    /// Notes an object that is no image, and of which nothing is kept. What a rejection note names is rejected if its sender may reject;
    /// `by` is the sender's name in the audit record. Otherwise the note is refused. An image with its UID that has come stays.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub(crate) async fn note(
        &self,
        identity: InstanceIdentity,
        (source, by): (ArrivalSource, &str),
        may_reject: bool,
    ) -> Result<Result<Status, Refusal>, Error> {
        let identity = match self.cases.deidentifies() {
            true => identity.deidentified(),
            false => identity,
        };
        if identity.rejection.is_some() && !may_reject {
            self.refuse_rejection(&identity, source, by).await?;
            return Ok(Err(Refusal::MAY_NOT_REJECT));
        }
        let is_known = self.store().has_come(&identity.sop_instance_uid).await?;
        if is_known {
            tracing::warn!(
                "an image that is known has come again as an object of another class, of which nothing is kept; the image stays"
            );
        }
        let detail = "the series has no MR or CT image, and nothing of it is kept";
        let reason = Failure::unusable(OTHER_OBJECTS, detail);
        let store = self.store();
        store.ignore(&identity.uids, source, &reason).await?;
        store.images_came(source, ImageStatus::Ignored, 1);
        if let Some(rejection) = &identity.rejection {
            self.reject(rejection, source, by).await?;
        }
        Ok(Ok(match is_known {
            true => Status::Corrected,
            false => Status::Success,
        }))
    }

    async fn reject(
        &self,
        rejection: &Rejection,
        source: ArrivalSource,
        by: &str,
    ) -> Result<(), Error> {
        let images = self.store().reject(rejection, source, by).await?;
        tracing::warn!(
            images,
            "a rejection note came; what was made of the images that it names is closed"
        );
        Ok(())
    }

    /// Notes that a rejection note was refused, because its sender may not reject images. Nothing is withdrawn.
    async fn refuse_rejection(
        &self,
        identity: &InstanceIdentity,
        source: ArrivalSource,
        by: &str,
    ) -> Result<(), Error> {
        let detail = "the sender of this rejection note may not reject images, so it withdraws nothing; see the scope `dicom-reject` and `may_reject`";
        let reason = Failure::unusable("rejection-not-permitted", detail);
        self.store().ignore(&identity.uids, source, &reason).await?;
        tracing::warn!(
            by,
            source = source.name(),
            "a rejection note was refused, because its sender may not reject images; to permit it, give the token the scope `dicom-reject`, or the peer `may_reject`"
        );
        Ok(())
    }

    /// Counts an image that is refused, for metrics.
    pub(crate) fn refused(&self, source: ArrivalSource) {
        self.store().images_came(source, ImageStatus::Refused, 1);
    }

    /// Counts objects that are refused, of the series as they are sent, in the arrivals of their series. If that fails, the answer stays.
    pub(crate) async fn refuse(
        &self,
        mut refused: Vec<(SeriesUids, Refusal)>,
        source: ArrivalSource,
    ) {
        if self.cases.deidentifies() {
            for (uids, _) in &mut refused {
                *uids = replaced_series(uids);
            }
        }
        self.count_refused(refused, source).await;
    }

    async fn count_refused(&self, refused: Vec<(SeriesUids, Refusal)>, source: ArrivalSource) {
        if let Err(error) = self.store().refuse(&refused, source).await {
            tracing::warn!(%error, "objects were refused, and could not be counted in the list of what came");
        }
    }

    /// Receives the images again that no row names, after the rows were restored from an older backup: how many, and those that stay as they
    /// are, because they are damaged or none. Run again, it finds nothing more.
    ///
    /// # Errors
    /// If the store cannot be reached.
    pub async fn adopt(&self) -> Result<(usize, Vec<ObjectName>), Error> {
        let (mut images, mut left) = (0, Vec::new());
        for name in upkeep::unreferenced_of(self.cases.store(), ObjectKind::Instance).await? {
            match self.receive_again(&name).await? {
                true => images += 1,
                false => left.push(name),
            }
        }
        Ok((images, left))
    }

    /// Whether an image could be received.
    async fn receive_again(&self, name: &ObjectName) -> Result<bool, Error> {
        let Some(file): Option<Spooled> = upkeep::spool_object(self.cases.store(), name).await?
        else {
            return Ok(false);
        };
        let identity = match InstanceIdentity::read(&self.cases, &file).await {
            Ok(identity) => identity,
            Err(Error::Failure(_)) => return Ok(false),
            Err(error) => return Err(error),
        };
        // The file has lost the identity of its patient before it was stored, if it was to.
        let image = [new_instance(identity, &file)];
        let received = self.store().adopt_images(&image, ArrivalSource::Retrieval);
        Ok(!received.await?.contains(&Reception::Refused))
    }

    /// The images, with the patient's identity removed from their files and UIDs.
    async fn without_identity(
        &self,
        images: Vec<(InstanceIdentity, Spooled)>,
    ) -> Result<Vec<(InstanceIdentity, Spooled)>, Error> {
        let directory = self.cases.store().spools().directory().await?;
        let mut without = Vec::with_capacity(images.len());
        for (number, (identity, file)) in images.into_iter().enumerate() {
            let output = directory.path().join(number.to_string());
            let stated = self.cases.headers.deidentify(&file, &output).await?;
            let file = self.cases.store().spools().take(output).await?;
            let identity = InstanceIdentity {
                fingerprint: InstanceIdentity::checked(stated)?.fingerprint,
                ..identity.deidentified()
            };
            without.push((identity, file));
        }
        Ok(without)
    }
}
