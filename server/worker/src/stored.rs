//! Reads the attributes of stored images.

use std::process::ExitStatus;

use case::Failure;
use imaging::dicom::Attributes;
use tempfile::TempDir;

use crate::error::Error;
use crate::memory::READER_BASE_BYTES;
use crate::message::{OUTCOME, Order, StoredOrder, StoredOutcome};
use crate::program::cannot_run;
use crate::reader::{SeriesReader, checked_failure, died, read_json_of};

/// The largest outcome: the attributes of some thousand images.
const MAX_OUTCOME_BYTES: u64 = 256 << 20;

impl SeriesReader {
    /// The attributes of the files of a directory, named by their numbers from 0. The other directory is empty.
    ///
    /// # Errors
    /// A [`Failure`] that states what is wrong with a file; [`Error::NotRun`].
    pub async fn attributes(
        &self,
        folders: (TempDir, TempDir),
        count: usize,
    ) -> Result<Vec<Attributes>, Error> {
        match self.read_files(folders, count).await? {
            StoredOutcome::Read(all) if all.len() == count => Ok(all),
            _ => Err(died().into()),
        }
    }

    /// Reads so many files of a directory, named by their numbers from 0.
    async fn read_files(
        &self,
        (input, output): (TempDir, TempDir),
        count: usize,
    ) -> Result<StoredOutcome, Error> {
        let absolute = |folder: &TempDir| std::path::absolute(folder.path()).map_err(cannot_run);
        let _memory = self.memory.take(READER_BASE_BYTES).await;
        let order = StoredOrder {
            input: absolute(&input)?,
            count,
            output: absolute(&output)?,
            memory_bytes: READER_BASE_BYTES,
            max_file_bytes: self.max_input_bytes,
            seconds: self.longest.as_secs().max(1),
        };
        let status = self.run(&Order::Stored(order)).await?;
        let take = move || outcome_of(status, &output);
        let read = tokio::task::spawn_blocking(take).await;
        Ok(read.map_err(|_| Error::NotRun)??)
    }
}

/// What the child left in its output directory.
fn outcome_of(status: ExitStatus, output: &TempDir) -> Result<StoredOutcome, Failure> {
    if !status.success() {
        tracing::warn!(%status, "the process that reads stored images died");
        return Err(died());
    }
    match read_json_of(&output.path().join(OUTCOME), MAX_OUTCOME_BYTES)? {
        StoredOutcome::Refused(failure) => Err(checked_failure(failure)),
        outcome => Ok(outcome),
    }
}
