//! What is read of a series, and the result.

use std::io;
use std::path::{Path, PathBuf};

use bytes::Bytes;
use case::images::Image;
use imaging::dicom::{SeriesSummary, UnreadFile};
use serde::Serialize;
use storage::Spooled;
use tempfile::TempDir;

use crate::message::VOLUME;

/// The files to read.
#[derive(Debug, Clone, Copy)]
pub enum Input<'a> {
    /// The files below a directory, or one file: DICOM, or a zip of it.
    Path(&'a Path),
    /// The files below a directory that was made for this reading.
    Directory(&'a TempDir),
    Spooled(&'a Spooled),
}

/// A series as a volume.
#[derive(Debug)]
pub struct Reading {
    /// The file of the volume.
    pub(crate) output: TempDir,
    /// The identifying attributes, as the stored JSON.
    pub attributes: Bytes,
    /// The images that it was made of.
    pub images: Vec<Image>,
    /// The choice among the files.
    pub choice: Choice,
}

impl Reading {
    /// The file of the volume, gzipped NIfTI-1, after [`Spooled::START`] bytes of room as in a spooled file.
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

/// The choice among the files of an upload.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = DicomChoice))]
pub struct Choice {
    /// The chosen series.
    pub series: SeriesSummary,
    /// The other series of the upload.
    pub others: Vec<SeriesSummary>,
    /// The number of files that are not MR, CT or PET images, or cannot be read.
    pub ignored_files: usize,
    /// The images among them that cannot be read, at most 100. None of them belongs to the chosen series.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub unread: Vec<UnreadFile>,
    /// Numbers (from 1) of the missing slices that are interpolated because of `allow_gaps`.
    pub interpolated_slices: Vec<usize>,
    /// Whether names or timing indicate that the chosen series is T1-weighted.
    #[serde(skip)]
    pub is_t1: bool,
}
