//! DICOM files to a volume, in a process of their own.
//!
//! Parsers and decoders of strangers' files can be made to run for ever, to ask for all memory, or to abort, which nothing
//! in the same process survives. So the program starts itself again, as `isocortex read-dicom`, for each upload: a process
//! with limits on memory, time and open files, without environment, that reads what was spooled and writes two files. What it
//! writes is taken for as untrusted as what it read. When it dies, the upload is refused and the server goes on.

mod child;
mod files;
mod message;
mod reader;

use std::io;
use std::path::{Path, PathBuf};

use bytes::Bytes;
use serde::Serialize;
use storage::Spooled;
use tempfile::TempDir;

use self::message::VOLUME;

pub use self::child::run as run_child;
pub use self::reader::{DicomReader, Program};
pub use imaging::dicom::{Attributes, Options, SeriesName, SeriesSummary};

/// The name of the child's subcommand.
pub const SUBCOMMAND: &str = "read-dicom";

/// The files that are read.
#[derive(Debug, Clone, Copy)]
pub enum Input<'a> {
    /// Those below a directory, or one file: DICOM, or a zip of it.
    Path(&'a Path),
    /// One file that was spooled.
    Spooled(&'a Spooled),
}

/// A series as a volume.
#[derive(Debug)]
pub struct Reading {
    /// Where the volume was written.
    output: TempDir,
    /// Whose head it is, as the JSON that is stored.
    pub attributes: Bytes,
    /// What was chosen among the files.
    pub choice: Choice,
}

impl Reading {
    /// The file of the volume, packed NIfTI-1, as a spooled one has it: behind [`Spooled::START`] bytes of room.
    pub fn file(&self) -> PathBuf {
        self.output.path().join(VOLUME)
    }

    /// The volume in memory.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub async fn volume(&self) -> io::Result<Bytes> {
        let file = Bytes::from(tokio::fs::read(self.file()).await?);
        Ok(file.slice(file.len().min(Spooled::START as usize)..))
    }
}

/// What was chosen among the files of an upload.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = DicomChoice))]
pub struct Choice {
    /// The series that was taken.
    pub series: SeriesView,
    /// The others that came with it.
    pub others: Vec<SeriesView>,
    /// How many files were no MR or CT images.
    pub ignored_files: usize,
    /// Numbers of the slices, from 1, that were missing and are interpolated, as `allow_gaps` asks for.
    pub interpolated_slices: Vec<usize>,
}

/// A series, told so that nothing says whose it is.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = DicomSeries))]
pub struct SeriesView {
    /// The scanner's number of the series.
    pub number: Option<i64>,
    /// `MR` or `CT`.
    pub modality: String,
    /// Pixels of a row, rows, and slices.
    pub size: [usize; 3],
    /// Names the series in `series`.
    pub token: String,
}

impl From<SeriesSummary> for SeriesView {
    fn from(summary: SeriesSummary) -> Self {
        Self {
            number: summary.number,
            modality: summary.modality,
            size: summary.size,
            token: summary.token,
        }
    }
}
