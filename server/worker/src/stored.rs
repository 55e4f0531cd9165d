//! Reads the attributes of stored images.

use imaging::dicom::Attributes;
use tempfile::TempDir;

use crate::error::Error;
use crate::memory::READER_BASE_BYTES;
use crate::message::{Order, StoredOrder};
use crate::program::cannot_run;
use crate::reader::{SeriesReader, died, outcome};

/// The largest outcome: the attributes of some thousand images.
const MAX_OUTCOME_BYTES: u64 = 256 << 20;

impl SeriesReader {
    /// The attributes of the files of a directory, named by their numbers from 0. The other directory is empty.
    ///
    /// # Errors
    /// A [`Failure`](case::Failure) that states what is wrong with a file; [`Error::NotRun`].
    pub async fn attributes(
        &self,
        (input, output): (TempDir, TempDir),
        count: usize,
    ) -> Result<Vec<Attributes>, Error> {
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
        let take = move || outcome(status, &output, ("stored images", MAX_OUTCOME_BYTES));
        let read = tokio::task::spawn_blocking(take).await;
        let all: Vec<_> = read.map_err(|_| Error::NotRun)??;
        match all.len() == count {
            true => Ok(all),
            false => Err(died().into()),
        }
    }
}
