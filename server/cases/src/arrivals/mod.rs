//! Series that come from a PACS, image by image, and become cases.
//!
//! An image is durable before it is acknowledged. Once nothing has come for a series for a while, it is read as a whole
//! and becomes a case, or nothing, for a reason that is kept. Late images make a new version of the case.

mod heads;
mod index;
mod reader;
#[cfg(test)]
mod tests;

use std::time::Duration;

use storage::Spooled;
use storage::arrivals::{ArrivalSource, NewInstance};

use crate::application::Cases;
use crate::dicom::InstanceIdentity;
use crate::error::Error;

pub use self::heads::Head;
pub(crate) use self::index::SeriesOfUpload;
pub use self::reader::ArrivalReader;

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
    /// Whether the images of a series that became a case are kept as long as the case.
    pub keep_source: bool,
    /// Which series become cases.
    pub series: SeriesRule,
}

impl Default for ArrivalOptions {
    fn default() -> Self {
        Self {
            stable: Duration::from_secs(20),
            keep: Duration::from_secs(3 * 24 * 3600),
            keep_source: false,
            series: SeriesRule::default(),
        }
    }
}

impl Cases {
    /// Adds images to their series; returns how many are new. Afterwards they are durable.
    ///
    /// # Errors
    /// An error of the store, such as [`Error::StorageFull`]; nothing is acknowledged then.
    pub async fn receive(
        &self,
        images: Vec<(InstanceIdentity, Spooled)>,
        source: ArrivalSource,
    ) -> Result<usize, Error> {
        let images = match self.deidentifies() {
            true => self.without_identity(images).await?,
            false => images,
        };
        let new = |(identity, file): (InstanceIdentity, Spooled)| {
            let instance = NewInstance {
                uids: identity.uids,
                accession_number: identity.accession_number,
                sop_instance_uid: identity.sop_instance_uid,
                digest: *file.digest(),
            };
            (instance, file)
        };
        let images = images.into_iter().map(new).collect();
        Ok(self.store().receive(images, source).await?)
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
