//! Reads single files, in a process for each.
//!
//! A process that a file takes over sees no other file. It has the limits of the process that reads a series.

use std::path::Path;
use std::process::Stdio;
use std::time::Duration;

use imaging::dicom::{Identity, MarkedPatient};
use serde::de::DeserializeOwned;
use storage::Spooled;

use crate::error::Error;
use crate::memory::ChildMemory;
use crate::message::{HeaderOrder, Order, Stated};
use crate::program::{Program, cannot_run};
use crate::reader::{check_file, checked_failure, died};

/// The largest DICOM file that is read by itself, in bytes: a multi-frame image of a head has some 100 MB.
pub const MAX_FILE_BYTES: u64 = 512 << 20;

/// The time limit for a file, and for each further 4 MiB: its pixels are decoded.
const LONGEST: Duration = Duration::from_secs(20);

/// The bytes of a file for which it may take as long again.
const BYTES_AT_ONCE: u64 = 4 << 20;

/// Memory for the program itself.
const PROGRAM_BYTES: u64 = 512 << 20;

/// How many times as large as a file its uncompressed pixels may be.
const UNPACKING: u64 = 16;

#[derive(Debug)]
pub struct FileReader {
    program: Program,
    longest: Duration,
    memory: ChildMemory,
}

impl FileReader {
    /// A reader of files of at most [`MAX_FILE_BYTES`].
    pub fn new(program: Program, memory: ChildMemory) -> Self {
        Self {
            program,
            longest: LONGEST,
            memory,
        }
    }

    /// Sets the time limit.
    #[must_use]
    pub fn within(self, longest: Duration) -> Self {
        Self { longest, ..self }
    }

    /// What the header of a file states.
    ///
    /// # Errors
    /// A [`Failure`](case::Failure) that states what is wrong with the file, or that its process died; [`Error::NotRun`], logged, if the
    /// process cannot be started.
    pub async fn identity(&self, file: &Spooled) -> Result<Identity, Error> {
        self.ask(file, None, Order::Header).await
    }

    /// The UIDs of the study and of the series that a file states, which may be damaged after them.
    ///
    /// # Errors
    /// As [`FileReader::identity`].
    pub async fn series_of(&self, file: &Spooled) -> Result<[String; 2], Error> {
        self.ask(file, None, Order::SeriesOf).await
    }

    /// The findings of a measurement report.
    ///
    /// # Errors
    /// As [`FileReader::identity`].
    pub async fn marks(&self, file: &Spooled) -> Result<MarkedPatient, Error> {
        self.ask(file, None, Order::Marks).await
    }

    /// Writes a file without the identity of the patient, as an upload is spooled; returns what the header of the file states.
    ///
    /// # Errors
    /// As [`FileReader::identity`].
    pub async fn deidentify(&self, file: &Spooled, output: &Path) -> Result<Identity, Error> {
        let identity = self.ask(file, Some(output), Order::Header).await?;
        // Pixels that were compressed may be larger than before.
        check_file(output, Spooled::START + MAX_FILE_BYTES * UNPACKING)?;
        Ok(identity)
    }

    async fn ask<T: DeserializeOwned>(
        &self,
        file: &Spooled,
        output: Option<&Path>,
        order: fn(HeaderOrder) -> Order,
    ) -> Result<T, Error> {
        let memory_bytes = PROGRAM_BYTES + (UNPACKING + 4) * file.len();
        let _memory = self.memory.take(memory_bytes).await;
        let longest = self.longest * (1 + u32::try_from(file.len() / BYTES_AT_ONCE).unwrap_or(0));
        let absolute = |path: &Path| std::path::absolute(path).map_err(cannot_run);
        let order = order(HeaderOrder {
            file: absolute(file.path())?,
            start: Spooled::START,
            output: output.map(absolute).transpose()?,
            memory_bytes,
            seconds: longest.as_secs().max(1),
        });
        let mut process = self.program.start(Stdio::piped()).map_err(cannot_run)?;
        let answer = tokio::time::timeout(longest, process.ask(&order)).await;
        // A process that is too slow is ended with its handle.
        let stated = match answer {
            Ok(Some(stated)) => stated,
            Ok(None) if process.was_interrupted().await => return Err(Error::Interrupted),
            Ok(None) | Err(_) => return Err(died().into()),
        };
        match stated {
            Stated::Read(found) => Ok(found),
            Stated::Refused(failure) => Err(checked_failure(failure).into()),
        }
    }
}
