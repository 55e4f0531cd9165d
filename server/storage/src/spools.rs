//! Where the uploads of a store are spooled.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use tempfile::TempDir;

use crate::directory::Directory;
use crate::{Spool, Spooled, StoreError};

/// The directory of spooled uploads, which ends with the store if it is temporary.
#[derive(Debug)]
pub struct Spools(pub(crate) Place);

#[derive(Debug)]
pub(crate) enum Place {
    Directory(Directory),
    Temporary(TempDir),
}

impl Spools {
    /// Begins an upload.
    ///
    /// # Errors
    /// If the disk fails.
    pub async fn begin(&self) -> Result<Spool, StoreError> {
        Ok(Spool::begin(self.path()).await?)
    }

    /// The directory for temporary files; files of a killed process are removed from it.
    pub fn path(&self) -> PathBuf {
        match &self.0 {
            Place::Directory(directory) => directory.uploads(),
            Place::Temporary(directory) => directory.path().to_owned(),
        }
    }

    /// Spools bytes in memory.
    ///
    /// # Errors
    /// If the disk fails.
    pub async fn of(&self, bytes: bytes::Bytes) -> Result<Spooled, StoreError> {
        let mut spool = self.begin().await?;
        spool.write(bytes).await?;
        Ok(spool.finish().await?)
    }

    /// Takes over a file in [`Spools::path`] that another process has written, with [`Spooled::START`] bytes of room
    /// before its contents.
    ///
    /// # Errors
    /// If the disk fails.
    pub async fn take(&self, file: PathBuf) -> Result<Spooled, StoreError> {
        let path = self.path();
        let taken = tokio::task::spawn_blocking(move || Spooled::take(&file, &path));
        Ok(taken.await??)
    }

    /// A directory for the files of an upload, which is removed with its handle.
    ///
    /// # Errors
    /// If the disk fails.
    pub async fn directory(&self) -> Result<TempDir, StoreError> {
        let path = self.path();
        let made = tokio::task::spawn_blocking(move || {
            tempfile::Builder::new().prefix("upload-").tempdir_in(path)
        });
        Ok(made.await??)
    }

    /// Free bytes for an unprivileged process on its disk, for metrics.
    ///
    /// # Errors
    /// If the disk fails.
    pub async fn free_bytes(&self) -> Result<u64, StoreError> {
        let path = self.path();
        let disk = tokio::task::spawn_blocking(move || rustix::fs::statvfs(&path));
        let disk = disk.await?.map_err(std::io::Error::from)?;
        Ok(disk.f_bavail.saturating_mul(disk.f_frsize))
    }

    /// Checks that this number of bytes is free.
    pub(crate) async fn check(&self, wanted: u64) -> Result<(), StoreError> {
        let path = self.path();
        tokio::task::spawn_blocking(move || check_disk(&path, wanted)).await??;
        Ok(())
    }
}

/// Whether this number of bytes is free on the disk of a directory for an unprivileged process, and a file can be made
/// durable there.
fn check_disk(directory: &Path, wanted: u64) -> std::io::Result<()> {
    let disk = rustix::fs::statvfs(directory)?;
    if disk.f_bavail.saturating_mul(disk.f_frsize) < wanted {
        return Err(std::io::ErrorKind::StorageFull.into());
    }
    let mut probe = tempfile::Builder::new()
        .prefix("check-")
        .tempfile_in(directory)?;
    probe.write_all(b"check")?;
    probe.as_file().sync_data()
}
