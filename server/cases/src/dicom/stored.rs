//! Reads stored files for clients that retrieve them: their attributes, their frames, and themselves.

use std::process::ExitStatus;

use bytes::Bytes;
use case::Failure;
use imaging::dicom::Difference;
use serde_json::Value;
use storage::{ObjectName, Spooled, Store, StoreError, Unreadable};
use tempfile::TempDir;

use super::message::{OUTCOME, Order, StoredOrder, StoredOutcome, StoredTask};
use super::reader::{BASE_BYTES, cannot_run, checked_failure, died, read_bounded, read_json_of};
use crate::application::Cases;
use crate::error::Error;

/// The largest outcome: the attributes of some thousand images.
const MAX_OUTCOME_BYTES: u64 = 256 << 20;

/// Files as they are sent, in a temporary directory.
#[derive(Debug)]
pub struct StoredFiles {
    folders: Folders,
    /// The transfer syntax of each; `None` if it was written again.
    syntaxes: Vec<Option<String>>,
    limit: u64,
}

impl StoredFiles {
    /// How many there are.
    pub fn count(&self) -> usize {
        self.syntaxes.len()
    }

    /// The transfer syntax and the contents of a file.
    ///
    /// # Errors
    /// If it cannot be read.
    pub async fn file(&self, number: usize) -> Result<(String, Bytes), Error> {
        let stored = self.syntaxes.get(number).ok_or(Error::Internal)?;
        let folder = match stored {
            Some(_) => &self.folders.input,
            None => &self.folders.output,
        };
        let (path, limit) = (folder.path().join(number.to_string()), self.limit);
        let bytes = tokio::task::spawn_blocking(move || read_bounded(&path, limit)).await;
        let bytes = bytes.map_err(|_| Error::Internal)??;
        let syntax = stored.clone().unwrap_or_else(|| EXPLICIT.to_owned());
        Ok((syntax, bytes.into()))
    }
}

/// The plainest transfer syntax.
const EXPLICIT: &str = "1.2.840.10008.1.2.1";

impl Cases {
    /// The attributes of stored images as DICOM JSON; `None` if one is lost.
    ///
    /// # Errors
    /// A [`Failure`] that states what is wrong with an image, [`Error::Busy`] if too many clients wait, or an error of
    /// the store.
    pub async fn stored_metadata(&self, names: &[ObjectName]) -> Result<Option<Vec<Value>>, Error> {
        let Some(read) = self.read_stored(names, StoredTask::Metadata).await? else {
            return Ok(None);
        };
        match read.outcome {
            StoredOutcome::Metadata(all) if all.len() == names.len() => Ok(Some(all)),
            _ => Err(died().into()),
        }
    }

    /// Stored images as files in one of the accepted transfer syntaxes, where `*` stands for all, or in Explicit VR
    /// Little Endian; `None` if one is lost.
    ///
    /// # Errors
    /// As [`Cases::stored_metadata`].
    pub async fn stored_files(
        &self,
        names: &[ObjectName],
        accepted: Vec<String>,
    ) -> Result<Option<StoredFiles>, Error> {
        let Some(read) = self.read_stored(names, StoredTask::Files(accepted)).await? else {
            return Ok(None);
        };
        let StoredOutcome::Files(syntaxes) = read.outcome else {
            return Err(died().into());
        };
        if syntaxes.len() != names.len() || !syntaxes.iter().flatten().all(|uid| is_uid(uid)) {
            return Err(died().into());
        }
        Ok(Some(StoredFiles {
            folders: read.folders,
            syntaxes,
            limit: self.dicom.max_input_bytes,
        }))
    }

    /// Frames of a stored image, by their numbers from 0: uncompressed samples in little endian. `None` in place of one
    /// that it does not have; `None` if the image is lost.
    ///
    /// # Errors
    /// As [`Cases::stored_metadata`].
    pub async fn stored_frames(
        &self,
        name: ObjectName,
        frames: Vec<usize>,
    ) -> Result<Option<Vec<Option<Bytes>>>, Error> {
        let count = frames.len();
        let task = StoredTask::Frames(frames);
        let Some(read) = self.read_stored(&[name], task).await? else {
            return Ok(None);
        };
        let StoredOutcome::Frames(exist) = read.outcome else {
            return Err(died().into());
        };
        if exist.len() != count {
            return Err(died().into());
        }
        let limit = self.dicom.max_input_bytes;
        let take = move || {
            let each = exist.into_iter().enumerate().map(|(number, exists)| {
                let path = read.folders.output.path().join(number.to_string());
                let frame = exists.then(|| read_bounded(&path, limit)).transpose();
                Ok(frame?.map(Bytes::from))
            });
            each.collect::<Result<Vec<_>, Failure>>()
        };
        let frames = tokio::task::spawn_blocking(take).await;
        Ok(Some(frames.map_err(|_| Error::Internal)??))
    }

    /// What is different about a new file of an image that is stored already. One that is lost differs.
    ///
    /// # Errors
    /// A [`Failure`] that states why the new file cannot be decoded, or as [`Cases::stored_metadata`].
    pub(crate) async fn difference(
        &self,
        stored: ObjectName,
        new: &Spooled,
    ) -> Result<Difference, Error> {
        let new = new.read().await.map_err(StoreError::from)?;
        let input = self.store().spool_directory().await?;
        let written = tokio::fs::write(input.path().join("1"), new).await;
        written.map_err(StoreError::Disk)?;
        if !copy_objects(self.store(), &[stored], &input).await? {
            return Ok(Difference::Pixels);
        }
        match self
            .read_files(input, 2, StoredTask::Compare)
            .await?
            .outcome
        {
            StoredOutcome::Compared(difference) => Ok(difference),
            _ => Err(died().into()),
        }
    }

    async fn read_stored(
        &self,
        names: &[ObjectName],
        task: StoredTask,
    ) -> Result<Option<Read>, Error> {
        let input = self.store().spool_directory().await?;
        if !copy_objects(self.store(), names, &input).await? {
            return Ok(None);
        }
        self.read_files(input, names.len(), task).await.map(Some)
    }

    /// Reads so many files of a directory, named by their numbers from 0.
    async fn read_files(
        &self,
        input: TempDir,
        count: usize,
        task: StoredTask,
    ) -> Result<Read, Error> {
        let _turn = self.dicom.limit.turn().await?;
        let output = self.store().spool_directory().await?;
        let absolute = |folder: &TempDir| std::path::absolute(folder.path()).map_err(cannot_run);
        let _memory = self.dicom.memory.take(BASE_BYTES).await;
        let order = StoredOrder {
            input: absolute(&input)?,
            count,
            output: absolute(&output)?,
            task,
            memory_bytes: BASE_BYTES,
            max_file_bytes: self.dicom.max_input_bytes,
            seconds: self.dicom.longest.as_secs().max(1),
        };
        let status = self.dicom.run(&Order::Stored(order)).await?;
        let take = move || Read::take(status, input, output);
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

/// What the child left.
#[derive(Debug)]
struct Read {
    outcome: StoredOutcome,
    folders: Folders,
}

/// The files that it read, and those that it wrote.
#[derive(Debug)]
struct Folders {
    input: TempDir,
    output: TempDir,
}

impl Read {
    fn take(status: ExitStatus, input: TempDir, output: TempDir) -> Result<Self, Failure> {
        if !status.success() {
            tracing::warn!(%status, "the process that reads stored images died");
            return Err(died());
        }
        let outcome = read_json_of(&output.path().join(OUTCOME), MAX_OUTCOME_BYTES)?;
        match outcome {
            StoredOutcome::Refused(failure) => Err(checked_failure(failure)),
            outcome => Ok(Self {
                outcome,
                folders: Folders { input, output },
            }),
        }
    }
}

fn is_uid(text: &str) -> bool {
    storage::arrivals::Uid::parse(text).is_some()
}
