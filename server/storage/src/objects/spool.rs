//! Uploads in progress: temporary files, hashed as they arrive.
//!
//! Each begins with room for the header of an object, so that the file becomes an object by another name; an upload is
//! written only once ([`Objects::put_file`](super::Objects::put_file)).

use std::io::{self, Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};

use bytes::Bytes;
use tempfile::TempPath;
use tokio::io::{AsyncReadExt, AsyncSeekExt as _, AsyncWriteExt};

use super::ObjectError;
use super::frame::HEADER_LENGTH;

/// The number of bytes to hash and write at once.
const BUFFER_LENGTH: usize = 1 << 20;

/// An upload in progress. Dropping it removes the file.
#[derive(Debug)]
pub struct Spool {
    file: tokio::io::BufWriter<tokio::fs::File>,
    path: TempPath,
    hasher: blake3::Hasher,
    length: u64,
}

impl Spool {
    /// Begins an upload in a directory.
    ///
    /// # Errors
    /// If the disk fails.
    pub async fn begin(directory: PathBuf) -> Result<Self, ObjectError> {
        let named = tokio::task::spawn_blocking(move || {
            tempfile::Builder::new()
                .prefix("upload-")
                .tempfile_in(directory)
        })
        .await??;
        let (file, path) = named.into_parts();
        let file = tokio::fs::File::from_std(file);
        let mut file = tokio::io::BufWriter::with_capacity(BUFFER_LENGTH, file);
        file.write_all(&[0; HEADER_LENGTH]).await?;
        Ok(Self {
            file,
            path,
            hasher: blake3::Hasher::new(),
            length: 0,
        })
    }

    /// Writes the next bytes.
    ///
    /// # Errors
    /// If the disk fails.
    pub async fn write(&mut self, bytes: Bytes) -> Result<(), ObjectError> {
        self.hasher.update(&bytes);
        self.length += bytes.len() as u64;
        Ok(self.file.write_all(&bytes).await?)
    }

    /// Bytes so far.
    pub fn len(&self) -> u64 {
        self.length
    }

    /// Whether no byte has arrived yet.
    pub fn is_empty(&self) -> bool {
        self.length == 0
    }

    /// Ends the upload after its last byte.
    ///
    /// # Errors
    /// If the disk fails.
    pub async fn finish(mut self) -> Result<Spooled, ObjectError> {
        self.file.flush().await?;
        Ok(Spooled {
            path: self.path,
            digest: self.hasher.finalize(),
            length: self.length,
        })
    }
}

/// A complete upload, in a temporary file. Dropping it removes the file.
#[derive(Debug)]
pub struct Spooled {
    path: TempPath,
    digest: blake3::Hash,
    length: u64,
}

impl Spooled {
    /// The offset of the uploaded bytes in the file.
    pub const START: u64 = HEADER_LENGTH as u64;

    /// Takes over a file that was written elsewhere, with the same room before its bytes. It is moved into `directory`.
    ///
    /// The bytes are hashed here. If another process still writes to the file, it damages the object; that is detected
    /// when the object is read.
    ///
    /// # Errors
    /// If the disk fails or the file is shorter than the room.
    pub fn take(file: &Path, directory: &Path) -> io::Result<Self> {
        let path = tempfile::Builder::new()
            .prefix("upload-")
            .make_in(directory, |path| std::fs::rename(file, path))?
            .into_temp_path();
        let mut file = std::fs::File::open(&path)?;
        let length = file.metadata()?.len().checked_sub(Self::START);
        let length = length.ok_or(io::ErrorKind::UnexpectedEof)?;
        file.seek(SeekFrom::Start(Self::START))?;
        let mut hasher = blake3::Hasher::new();
        hasher.update_reader(file.take(length))?;
        Ok(Self {
            path,
            digest: hasher.finalize(),
            length,
        })
    }

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
    /// If the disk fails.
    pub async fn head(&self, length: u64) -> Result<Vec<u8>, ObjectError> {
        let mut head = Vec::new();
        let file = self.open().await?;
        file.take(length).read_to_end(&mut head).await?;
        Ok(head)
    }

    /// The file, at the beginning of the uploaded bytes.
    pub(crate) async fn open(&self) -> Result<tokio::fs::File, ObjectError> {
        let mut file = tokio::fs::File::open(&self.path).await?;
        file.seek(SeekFrom::Start(Self::START)).await?;
        Ok(file)
    }

    /// All bytes.
    ///
    /// # Errors
    /// If the disk fails.
    pub async fn read(&self) -> Result<Bytes, ObjectError> {
        let file = Bytes::from(tokio::fs::read(&self.path).await?);
        if file.len() < HEADER_LENGTH {
            return Err(io::Error::from(io::ErrorKind::UnexpectedEof).into());
        }
        Ok(file.slice(HEADER_LENGTH..))
    }

    /// The path of the file. The uploaded bytes begin at [`Spooled::START`].
    pub fn path(&self) -> &Path {
        &self.path
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn an_upload_has_room_before_it_and_is_hashed_as_it_comes() {
        let directory = tempfile::tempdir().unwrap();
        for (pieces, whole) in [
            (&[][..], ""),
            (&["a"], "a"),
            (&["one ", "", "and another"], "one and another"),
        ] {
            let mut spool = Spool::begin(directory.path().to_owned()).await.unwrap();
            for piece in pieces {
                spool
                    .write(Bytes::from_static(piece.as_bytes()))
                    .await
                    .unwrap();
            }
            assert_eq!(
                (spool.len(), spool.is_empty()),
                (whole.len() as u64, whole.is_empty())
            );
            let spooled = spool.finish().await.unwrap();
            assert_eq!(
                (spooled.len(), spooled.is_empty()),
                (whole.len() as u64, whole.is_empty())
            );
            assert_eq!(spooled.digest(), &blake3::hash(whole.as_bytes()));
            assert_eq!(spooled.read().await.unwrap(), whole);
            assert_eq!(
                spooled.head(3).await.unwrap(),
                &whole.as_bytes()[..whole.len().min(3)]
            );
            let file = std::fs::read(spooled.path()).unwrap();
            assert_eq!(file, [&[0; HEADER_LENGTH], whole.as_bytes()].concat());
        }
        assert_eq!(
            std::fs::read_dir(directory.path()).unwrap().count(),
            0,
            "all are dropped"
        );
    }

    #[tokio::test]
    async fn a_file_that_another_process_wrote_is_moved_and_hashed() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("elsewhere");
        std::fs::write(&file, [&[0; HEADER_LENGTH][..], b"volume"].concat()).unwrap();
        let taken = Spooled::take(&file, directory.path()).unwrap();
        assert!(!file.exists());
        assert_eq!(taken.digest(), &blake3::hash(b"volume"));
        assert_eq!(taken.read().await.unwrap(), "volume");
        drop(taken);
        for bytes in [&b""[..], &[0; HEADER_LENGTH - 1]] {
            std::fs::write(&file, bytes).unwrap();
            assert!(
                Spooled::take(&file, directory.path()).is_err(),
                "it has no room"
            );
        }
        assert!(
            Spooled::take(&file, directory.path()).is_err(),
            "there is none"
        );
        assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 0);
    }

    #[tokio::test]
    async fn an_upload_that_is_dropped_or_damaged_is_no_upload() {
        let directory = tempfile::tempdir().unwrap();
        let mut half = Spool::begin(directory.path().to_owned()).await.unwrap();
        half.write(Bytes::from_static(b"half")).await.unwrap();
        drop(half);
        let count = || std::fs::read_dir(directory.path()).unwrap().count();
        assert_eq!(count(), 0);
        let whole = Spool::begin(directory.path().to_owned()).await.unwrap();
        let whole = whole.finish().await.unwrap();
        std::fs::write(whole.path(), [0; HEADER_LENGTH - 1]).unwrap();
        assert!(matches!(whole.read().await, Err(ObjectError::Disk(_))));
        std::fs::remove_file(whole.path()).unwrap();
        for lost in [whole.read().await.map(drop), whole.head(1).await.map(drop)] {
            assert!(matches!(lost, Err(ObjectError::Disk(_))), "{lost:?}");
        }
        let nowhere = directory.path().join("nowhere");
        assert!(Spool::begin(nowhere).await.is_err());
    }
}
