//! Cases on disk: immutable objects, and rows that say which of them belong to which case.

use std::path::Path;

use bytes::Bytes;

use crate::case::{Case, CaseId, Parameters};
use crate::prepare::{Limits, Source};

/// Why the store could not do what was asked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StoreError {
    /// As many cases wait as may wait; try again later.
    #[error("too many cases are waiting to be prepared")]
    QueueFull,
    /// The rows cannot be read or written.
    #[error("the database of the store failed")]
    Rows(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// The objects cannot be read or written.
    #[error("the object store failed")]
    Objects(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// The disk failed.
    #[error("the disk of the store failed")]
    Disk(#[source] std::io::Error),
}

/// How a store behaves. [`Options::default`] suits one machine.
#[derive(Debug, Clone)]
pub struct Options {
    /// How many cases may wait to be prepared.
    pub queue_limit: usize,
    /// What uploads may ask for.
    pub limits: Limits,
}

/// Where a listing goes on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cursor(String);

/// A part of the list of cases.
#[derive(Debug, Clone)]
pub struct Page {
    /// Newest first.
    pub cases: Vec<Case>,
    /// Where the next page begins; `None` on the last one.
    pub next: Option<Cursor>,
}

/// What became of an upload.
#[derive(Debug, Clone)]
pub struct Submitted {
    /// The case.
    pub case: Case,
    /// Whether it was not there before.
    pub created: bool,
}

/// An upload on its way into the store: written to a temporary file and hashed as it comes. Dropping it leaves nothing.
#[derive(Debug)]
pub struct Spool {}

impl Spool {
    /// Takes the next bytes.
    ///
    /// # Errors
    /// When the disk fails.
    pub async fn write(&mut self, bytes: Bytes) -> Result<(), StoreError> {
        let _ = bytes;
        todo!()
    }

    /// Bytes so far.
    pub fn len(&self) -> u64 {
        todo!()
    }

    /// Whether nothing has come yet.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// All bytes have come.
    ///
    /// # Errors
    /// When the disk fails.
    pub async fn finish(self) -> Result<Spooled, StoreError> {
        todo!()
    }
}

/// A whole uploaded file, in a temporary file. Dropping it removes the file.
#[derive(Debug)]
pub struct Spooled {}

/// The files of an upload.
#[derive(Debug)]
pub struct Upload {
    /// The volume.
    pub volume: Spooled,
    /// The mask of the brain.
    pub mask: Option<Spooled>,
}

/// The changes of one case, as they come.
#[derive(Debug)]
pub struct Watch {}

impl Watch {
    /// The case now, at the first call; then whenever it has changed. `None` once it is gone.
    ///
    /// Never returns again the same after a final state but goes on waiting; the caller stops at [`CaseState::is_final`](crate::case::CaseState::is_final).
    ///
    /// # Errors
    /// When the rows cannot be read.
    pub async fn next(&mut self) -> Result<Option<Case>, StoreError> {
        todo!()
    }
}

/// The store. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Store {}

impl Store {
    /// Opens the store in a directory with default [`Options`]; creates it, migrates it, sweeps leftovers.
    ///
    /// # Errors
    /// When the directory or its database cannot be used.
    pub async fn open(directory: &Path) -> Result<Self, StoreError> {
        let _ = directory;
        todo!()
    }

    /// The same, with options.
    ///
    /// # Errors
    /// When the directory or its database cannot be used.
    pub async fn open_with(directory: &Path, options: Options) -> Result<Self, StoreError> {
        let _ = (directory, options);
        todo!()
    }

    /// Begins an upload.
    ///
    /// # Errors
    /// When the disk fails.
    pub async fn spool(&self) -> Result<Spool, StoreError> {
        todo!()
    }

    /// Makes a case of spooled files and queues its preparation. A case that is there already stays as it is, but a failed one is queued again.
    ///
    /// # Errors
    /// [`StoreError::QueueFull`], or when the store fails. The parameters are not checked here.
    pub async fn submit_upload(
        &self,
        upload: Upload,
        parameters: Parameters,
    ) -> Result<Submitted, StoreError> {
        let _ = (upload, parameters);
        todo!()
    }

    /// The same, from memory.
    ///
    /// # Errors
    /// As [`Store::submit_upload`].
    pub async fn submit(
        &self,
        source: Source,
        parameters: Parameters,
    ) -> Result<Submitted, StoreError> {
        let _ = (source, parameters);
        todo!()
    }

    /// One case.
    ///
    /// # Errors
    /// When the rows cannot be read.
    pub async fn case(&self, id: &CaseId) -> Result<Option<Case>, StoreError> {
        let _ = id;
        todo!()
    }

    /// At most `limit` cases after a cursor, newest first.
    ///
    /// # Errors
    /// When the rows cannot be read.
    pub async fn cases(&self, after: Option<Cursor>, limit: usize) -> Result<Page, StoreError> {
        let _ = (after, limit);
        todo!()
    }

    /// Removes a case and what no other case needs; `false` where there was none. A preparation under way is cancelled.
    ///
    /// # Errors
    /// When the rows cannot be written.
    pub async fn delete(&self, id: &CaseId) -> Result<bool, StoreError> {
        let _ = id;
        todo!()
    }

    /// The changes of a case.
    pub fn subscribe(&self, id: &CaseId) -> Watch {
        let _ = id;
        todo!()
    }

    /// Whether the rows and the objects can be reached: what `/readyz` asks.
    ///
    /// # Errors
    /// When they cannot.
    pub async fn check(&self) -> Result<(), StoreError> {
        todo!()
    }
}

impl Cursor {
    /// The cursor in a query.
    pub fn parse(text: &str) -> Option<Self> {
        let _ = text;
        todo!()
    }
}

impl std::fmt::Display for Cursor {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str(&self.0)
    }
}
