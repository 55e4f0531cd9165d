//! Reads the attributes of stored images.

use std::process::ExitStatus;

use case::Failure;
use serde_json::Value;
use storage::{ObjectName, Store, StoreError, Unreadable};
use tempfile::TempDir;

use super::message::{OUTCOME, Order, StoredOrder, StoredOutcome};
use super::reader::{BASE_BYTES, cannot_run, checked_failure, died, read_json_of};
use crate::application::Cases;
use crate::error::Error;

/// The largest outcome: the attributes of some thousand images.
const MAX_OUTCOME_BYTES: u64 = 256 << 20;

impl Cases {
    /// The attributes of stored images as DICOM JSON; `None` if one is lost.
    ///
    /// # Errors
    /// A [`Failure`] that states what is wrong with an image, [`Error::Busy`] if too many clients wait, or an error of
    /// the store.
    pub(crate) async fn stored_metadata(
        &self,
        names: &[ObjectName],
    ) -> Result<Option<Vec<Value>>, Error> {
        let input = self.store().spool_directory().await?;
        if !copy_objects(self.store(), names, &input).await? {
            return Ok(None);
        }
        let count = names.len();
        match self.read_files(input, count).await? {
            StoredOutcome::Metadata(all) if all.len() == count => Ok(Some(all)),
            _ => Err(died().into()),
        }
    }

    /// Reads so many files of a directory, named by their numbers from 0.
    async fn read_files(&self, input: TempDir, count: usize) -> Result<StoredOutcome, Error> {
        let _turn = self.dicom.limit.turn().await?;
        let output = self.store().spool_directory().await?;
        let absolute = |folder: &TempDir| std::path::absolute(folder.path()).map_err(cannot_run);
        let _memory = self.dicom.memory.take(BASE_BYTES).await;
        let order = StoredOrder {
            input: absolute(&input)?,
            count,
            output: absolute(&output)?,
            memory_bytes: BASE_BYTES,
            max_file_bytes: self.dicom.max_input_bytes,
            seconds: self.dicom.longest.as_secs().max(1),
        };
        let status = self.dicom.run(&Order::Stored(order)).await?;
        let take = move || outcome_of(status, &output);
        let read = tokio::task::spawn_blocking(take).await;
        Ok(read.map_err(|_| Error::Internal)??)
    }
}

/// Copies objects into a directory, under their places in the list; `false` if one is lost.
pub(crate) async fn copy_objects(
    store: &Store,
    names: &[ObjectName],
    directory: &TempDir,
) -> Result<bool, Error> {
    for (number, name) in names.iter().enumerate() {
        let object = match store.object(name).await {
            Ok(object) => object,
            Err(Unreadable::Store(error)) => return Err(error.into()),
            Err(_) => return Ok(false),
        };
        let path = directory.path().join(number.to_string());
        let written = tokio::fs::write(path, object).await;
        written.map_err(StoreError::Disk)?;
    }
    Ok(true)
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
