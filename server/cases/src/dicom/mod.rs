//! Reads DICOM files, surfaces or the folder of a subject into volumes, in confined processes, of which a bounded number run at a time.

mod headers;
mod stored;

use std::path::Path;
use std::time::Duration;

use imaging::Limits;
use worker::{
    ChildMemory, Confinement, Reading, SeriesReader, SurfaceReading, Surfaces, at_a_time,
};

use crate::error::Error;
use crate::limit::ConcurrencyLimit;

pub use self::headers::HeaderReader;
pub use self::stored::copy_objects;
pub use imaging::dicom::{Attributes, Options, Purpose, SeriesName, SeriesSummary};
pub use imaging::nifti::Form;
pub use imaging::surface::{Drawing, Space};
pub use worker::{Choice, Input, MAX_FILE_BYTES, Program, READER_DIED, SubjectReading, flat_name};

/// Series that may wait.
const WAITING: usize = 16;

/// Reads series of DICOM files. If many wait, the clients ([`for_client`](crate::for_client)) take turns.
#[derive(Debug)]
pub struct DicomReader {
    reader: SeriesReader,
    limit: ConcurrencyLimit,
}

impl DicomReader {
    /// A reader of volumes within `limits`, from files of at most `max_input_bytes` altogether, unpacked.
    pub fn new(program: Program, limits: Limits, max_input_bytes: u64) -> Self {
        Self {
            reader: SeriesReader::new(program, limits, max_input_bytes),
            limit: ConcurrencyLimit::new(at_a_time(), WAITING),
        }
    }

    /// The same with memory that others share.
    #[must_use]
    pub(crate) fn with_memory(self, memory: ChildMemory) -> Self {
        Self {
            reader: self.reader.with_memory(memory),
            ..self
        }
    }

    /// Sets the time limit.
    #[must_use]
    pub fn within(self, longest: Duration) -> Self {
        Self {
            reader: self.reader.within(longest),
            ..self
        }
    }

    /// As [`SeriesReader::read`].
    ///
    /// # Errors
    /// A [`Failure`](case::Failure) that states what is wrong with the files, or how the process died; [`Error::Busy`] if too many
    /// wait; [`Error::Internal`], logged, if the process cannot be started.
    pub async fn read(
        &self,
        input: Input<'_>,
        options: &Options,
        scratch: &Path,
    ) -> Result<Reading, Error> {
        let _turn = self.limit.turn().await?;
        Ok(self.reader.read(input, options, scratch).await?)
    }

    /// As [`SeriesReader::read_surfaces`].
    ///
    /// # Errors
    /// As [`DicomReader::read`].
    pub async fn read_surfaces(
        &self,
        surfaces: Surfaces<'_>,
        scratch: &Path,
    ) -> Result<SurfaceReading, Error> {
        let _turn = self.limit.turn().await?;
        Ok(self.reader.read_surfaces(surfaces, scratch).await?)
    }

    /// As [`SeriesReader::read_subject`].
    ///
    /// # Errors
    /// As [`DicomReader::read`].
    pub async fn read_subject(
        &self,
        input: Input<'_>,
        scratch: &Path,
    ) -> Result<Option<SubjectReading>, Error> {
        let _turn = self.limit.turn().await?;
        Ok(self.reader.read_subject(input, scratch).await?)
    }

    /// As [`SeriesReader::confinement`].
    ///
    /// # Errors
    /// [`Error::Internal`], logged, if the process cannot be started, or does not answer.
    pub async fn confinement(&self) -> Result<Confinement, Error> {
        Ok(self.reader.confinement().await?)
    }
}
