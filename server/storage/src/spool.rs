//! Uploads on their way in: temporary files, hashed as they come.

use std::path::{Path, PathBuf};

use bytes::Bytes;
use tempfile::TempPath;
use tokio::io::{AsyncReadExt, AsyncWriteExt};

use super::StoreError;

/// How much is hashed and written at once.
const BUFFER_LENGTH: usize = 1 << 20;

/// An upload on its way into the store. Dropping it leaves nothing.
#[derive(Debug)]
pub struct Spool {
    file: tokio::io::BufWriter<tokio::fs::File>,
    path: TempPath,
    hasher: blake3::Hasher,
    length: u64,
}

impl Spool {
    pub(super) async fn begin(directory: PathBuf) -> Result<Self, StoreError> {
        let named = tokio::task::spawn_blocking(move || {
            tempfile::Builder::new()
                .prefix("upload-")
                .tempfile_in(directory)
        })
        .await??;
        let (file, path) = named.into_parts();
        let file = tokio::fs::File::from_std(file);
        Ok(Self {
            file: tokio::io::BufWriter::with_capacity(BUFFER_LENGTH, file),
            path,
            hasher: blake3::Hasher::new(),
            length: 0,
        })
    }

    /// Takes the next bytes.
    ///
    /// # Errors
    /// When the disk fails.
    pub async fn write(&mut self, bytes: Bytes) -> Result<(), StoreError> {
        self.hasher.update(&bytes);
        self.length += bytes.len() as u64;
        Ok(self.file.write_all(&bytes).await?)
    }

    /// Bytes so far.
    pub fn len(&self) -> u64 {
        self.length
    }

    /// Whether nothing has come yet.
    pub fn is_empty(&self) -> bool {
        self.length == 0
    }

    /// All bytes have come.
    ///
    /// # Errors
    /// When the disk fails.
    pub async fn finish(mut self) -> Result<Spooled, StoreError> {
        self.file.flush().await?;
        Ok(Spooled {
            path: self.path,
            digest: self.hasher.finalize(),
            length: self.length,
        })
    }
}

/// A whole uploaded file, in a temporary file. Dropping it removes the file.
#[derive(Debug)]
pub struct Spooled {
    path: TempPath,
    digest: blake3::Hash,
    length: u64,
}

impl Spooled {
    /// BLAKE3 of the bytes.
    pub fn digest(&self) -> &blake3::Hash {
        &self.digest
    }

    /// Number of bytes.
    pub fn len(&self) -> u64 {
        self.length
    }

    /// Whether there are no bytes.
    pub fn is_empty(&self) -> bool {
        self.length == 0
    }

    /// The first bytes.
    ///
    /// # Errors
    /// When the disk fails.
    pub async fn head(&self, length: u64) -> Result<Vec<u8>, StoreError> {
        let mut head = Vec::new();
        let file = tokio::fs::File::open(&self.path).await?;
        file.take(length).read_to_end(&mut head).await?;
        Ok(head)
    }

    /// All bytes.
    ///
    /// # Errors
    /// When the disk fails.
    pub async fn read(&self) -> Result<Bytes, StoreError> {
        Ok(tokio::fs::read(&self.path).await?.into())
    }

    /// Where the file is.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

/// The files of an upload.
#[derive(Debug)]
pub struct Upload {
    /// The volume.
    pub volume: Spooled,
    /// The mask of the brain.
    pub mask: Option<Spooled>,
    /// Whose head it is, where the volume was made of DICOM files.
    pub dicom: Option<Spooled>,
}
