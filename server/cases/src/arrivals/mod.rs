//! Series that come from a PACS, image by image, and become cases.
//!
//! An image is durable before it is acknowledged. Once nothing has come for a series for a while, it is read as a whole
//! and becomes a case, or nothing, for a reason that is kept. Late images make a new version of the case.

mod geometry;
mod heads;
mod index;
mod others;
mod patient;
mod rejection;
#[cfg(test)]
pub(crate) mod tests;
mod tiles;

use std::time::Duration;

use case::Failure;
use imaging::dicom::Difference;
use storage::arrivals::{ArrivalSource, Change, NewInstance, OTHER_OBJECTS};
use storage::{ImageStatus, Spooled};

use crate::application::Cases;
use crate::dicom::InstanceIdentity;
use crate::error::Error;

pub use self::heads::Head;
pub(crate) use self::index::SeriesOfUpload;
pub use self::others::{Fitting, Other};
pub(crate) use self::patient::day;
pub use self::patient::{Contradiction, Patient};

/// Which series become cases.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
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

/// What became of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reception {
    /// It is stored, or was there already.
    Stored,
    /// It took the place of one with the same UID and other contents.
    Corrected,
    /// It has the UID of a stored image and cannot be decoded, so that one stays.
    Refused,
    /// The PACS has rejected it, and nothing of it is kept.
    Rejected,
}

impl Cases {
    /// Adds images to their series, and returns what became of each. Afterwards they are durable.
    ///
    /// An image that is known and has other contents takes the place of the one that is stored, and its series is read
    /// again. If its patient, its study or its place has changed, nothing more is made of the cases of the series. A layer of the series is
    /// removed until the series is complete again.
    ///
    /// # Errors
    /// An error of the store, such as [`Error::StorageFull`]; nothing is acknowledged then.
    pub async fn receive(
        &self,
        images: Vec<(InstanceIdentity, Spooled)>,
        source: ArrivalSource,
    ) -> Result<Vec<Reception>, Error> {
        let images = match self.deidentifies() {
            true => self.without_identity(images).await?,
            false => images,
        };
        self.receive_as_is(images, source, false).await
    }

    /// As [`Cases::receive`], whether or not the identity of the patient is removed. With `is_stored`, the objects of the
    /// images are there, and no row names them.
    pub(crate) async fn receive_as_is(
        &self,
        images: Vec<(InstanceIdentity, Spooled)>,
        source: ArrivalSource,
        is_stored: bool,
    ) -> Result<Vec<Reception>, Error> {
        let new = |(identity, file): (InstanceIdentity, Spooled)| {
            let instance = NewInstance {
                uids: identity.uids,
                accession_number: identity.accession_number,
                sop_instance_uid: identity.sop_instance_uid,
                digest: *file.digest(),
                label: identity.label,
                replaces: None,
            };
            (instance, file)
        };
        let images = images.into_iter().map(new).collect();
        let (images, receptions) = self.compare(images, source).await?;
        let received = if is_stored {
            let images: Vec<_> = images.into_iter().map(|(new, _)| new).collect();
            self.store().adopt_images(&images, source).await?
        } else {
            self.store().receive(images, source).await?
        };
        for arrival in received.corrected {
            if let Some(corrected) = self.store().arrival(&arrival).await? {
                self.remove_layers_of(&corrected.uids).await?;
            }
            tracing::warn!(
                arrival,
                "images of a series that are known have come with other contents, which count from now on"
            );
        }
        Ok(receptions)
    }

    /// Notes which images replace others with the same UID. Leaves out those that would and cannot be decoded, and those
    /// that were rejected.
    async fn compare(
        &self,
        images: Vec<(NewInstance, Spooled)>,
        source: ArrivalSource,
    ) -> Result<(Vec<(NewInstance, Spooled)>, Vec<Reception>), Error> {
        let named: Vec<_> = images
            .iter()
            .map(|(new, _)| (new.uids.clone(), new.sop_instance_uid.clone()))
            .collect();
        let known = self.store().known(&named).await?;
        let rejected = self.store().are_rejected(&named).await?;
        let (mut kept, mut receptions) = (Vec::with_capacity(images.len()), Vec::new());
        for (((mut instance, file), known), is_rejected) in
            images.into_iter().zip(known).zip(rejected)
        {
            if is_rejected {
                self.store()
                    .ignore(&instance.uids, source, &rejection::reason())
                    .await?;
                let signals = self.store().signals();
                signals.images_came(source, ImageStatus::Rejected, 1);
                receptions.push(Reception::Rejected);
                continue;
            }
            let stored =
                known.filter(|known| known.is_elsewhere || known.object.digest != instance.digest);
            instance.replaces = match stored {
                None => None,
                Some(stored) => match self.difference(stored.object, &file).await {
                    // The UID of an image has no other study or series.
                    Ok(_) if stored.is_elsewhere => Some(Change::Owner),
                    Ok(Difference::None) => None,
                    Ok(Difference::Pixels) => Some(Change::Pixels),
                    Ok(Difference::Place) => Some(Change::Place),
                    Ok(Difference::Owner) => Some(Change::Owner),
                    Err(Error::Failure(_)) => {
                        receptions.push(Reception::Refused);
                        continue;
                    }
                    Err(error) => return Err(error),
                },
            };
            receptions.push(match instance.replaces {
                Some(_) => Reception::Corrected,
                None => Reception::Stored,
            });
            kept.push((instance, file));
        }
        Ok((kept, receptions))
    }

    /// Counts an object that is no image, and of which nothing is kept. What a rejection note names is withdrawn. Returns whether an image with its
    /// UID is stored, which stays.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub async fn ignore(
        &self,
        identity: InstanceIdentity,
        source: ArrivalSource,
    ) -> Result<bool, Error> {
        let identity = match self.deidentifies() {
            true => identity.deidentified(),
            false => identity,
        };
        let named = (identity.uids.clone(), identity.sop_instance_uid.clone());
        let known = self.store().known(&[named]).await?;
        let is_known = known.iter().any(Option::is_some);
        if is_known {
            tracing::warn!(
                "an image that is known has come again as an object of another class, of which nothing is kept; the image stays"
            );
        }
        let detail = "the series has no MR or CT image, and nothing of it is kept";
        let reason = Failure::unusable(OTHER_OBJECTS, detail);
        let store = self.store();
        store.ignore(&identity.uids, source, &reason).await?;
        store.signals().images_came(source, ImageStatus::Ignored, 1);
        if let Some(rejection) = &identity.rejection {
            self.reject(rejection, source).await?;
        }
        Ok(is_known)
    }

    /// Notes that a rejection note was refused, because its sender, who has this name in the audit record, may not reject images. Nothing is
    /// withdrawn.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub async fn refuse_rejection(
        &self,
        identity: InstanceIdentity,
        source: ArrivalSource,
        by: &str,
    ) -> Result<(), Error> {
        let identity = match self.deidentifies() {
            true => identity.deidentified(),
            false => identity,
        };
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
    pub fn refused(&self, source: ArrivalSource) {
        let signals = self.store().signals();
        signals.images_came(source, ImageStatus::Refused, 1);
    }

    /// The images, with the patient's identity removed from their files and UIDs.
    async fn without_identity(
        &self,
        images: Vec<(InstanceIdentity, Spooled)>,
    ) -> Result<Vec<(InstanceIdentity, Spooled)>, Error> {
        let directory = self.store().spool_directory().await?;
        let mut without = Vec::with_capacity(images.len());
        for (number, (identity, file)) in images.into_iter().enumerate() {
            let output = directory.path().join(number.to_string());
            self.headers.deidentify(&file, &output).await?;
            let file = self.store().spool_file(output).await?;
            without.push((identity.deidentified(), file));
        }
        Ok(without)
    }
}
