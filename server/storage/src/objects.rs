//! Objects: immutable files, addressed by what is in them, behind the `object_store` crate.

use std::path::Path;
use std::sync::Arc;

use bytes::Bytes;
use futures_util::TryStreamExt as _;
use object_store::local::LocalFileSystem;
use object_store::{MultipartUpload, ObjectStore, ObjectStoreExt, PutPayload};
use tokio::io::AsyncReadExt;

use super::frame::{FrameError, Framed, HEADER_LENGTH, plain_header, unframe};
use super::{ObjectName, StoreError};

/// Files are copied into the store in parts of this size, which S3 accepts too (5 MiB at least).
const PART_LENGTH: usize = 8 << 20;

/// An object that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum Unreadable {
    /// It is not there.
    #[error("an object is missing")]
    Missing,
    /// It is not as it was written.
    #[error("an object is damaged: {0}")]
    Damaged(String),
    /// It cannot be reached, and may well be sound.
    #[error(transparent)]
    Store(#[from] StoreError),
}

/// The objects of a store.
#[derive(Debug, Clone)]
pub struct Objects {
    files: Arc<dyn ObjectStore>,
}

impl Objects {
    /// Objects in any object store.
    pub fn new(files: Arc<dyn ObjectStore>) -> Self {
        Self { files }
    }

    /// Objects in a directory, made where it is missing. What was put is on the disk when the call returns.
    ///
    /// # Errors
    /// When the directory cannot be used.
    pub fn in_directory(directory: &Path) -> Result<Self, StoreError> {
        std::fs::create_dir_all(directory)?;
        let files = LocalFileSystem::new_with_prefix(directory)?.with_fsync(true);
        Ok(Self::new(Arc::new(files)))
    }

    /// Writes an object, over one that is there: it may be damaged. Readers see the old one or the new one, whole.
    ///
    /// # Errors
    /// When the object store fails.
    pub async fn put(&self, framed: &Framed) -> Result<(), StoreError> {
        let header = Bytes::copy_from_slice(&framed.header);
        let payload = PutPayload::from_iter([header, framed.payload.clone()]);
        self.files.put(&framed.name.path(), payload).await?;
        Ok(())
    }

    /// Writes an object from a file, of which at most a part is in memory.
    ///
    /// # Errors
    /// When the object store fails.
    pub async fn put_file(
        &self,
        name: &ObjectName,
        file: &Path,
        length: u64,
    ) -> Result<(), StoreError> {
        let mut upload = self.files.put_multipart(&name.path()).await?;
        let written = write_parts(&mut *upload, plain_header(name, length), file).await;
        if written.is_err() {
            // Parts of an object that nobody finishes stay in a bucket for ever; what cannot be taken back either is its owner's rule.
            let _given_up = upload.abort().await;
        }
        written
    }

    /// The payload of an object, checked.
    ///
    /// # Errors
    /// When it is missing or damaged, or the object store fails.
    pub async fn get(&self, name: &ObjectName) -> Result<Bytes, Unreadable> {
        self.read(name).await.map(|(payload, _framed)| payload)
    }

    /// The bytes of an object as it is stored, checked.
    ///
    /// # Errors
    /// As [`Objects::get`].
    pub async fn get_framed(&self, name: &ObjectName) -> Result<Bytes, Unreadable> {
        self.read(name).await.map(|(_payload, framed)| framed)
    }

    /// Writes the bytes of an object of another store, over one that is there.
    ///
    /// # Errors
    /// When the object store fails.
    pub async fn put_framed(&self, name: &ObjectName, framed: Bytes) -> Result<(), StoreError> {
        self.files.put(&name.path(), framed.into()).await?;
        Ok(())
    }

    async fn read(&self, name: &ObjectName) -> Result<(Bytes, Bytes), Unreadable> {
        let answer = match self.files.get(&name.path()).await {
            Ok(answer) => answer.bytes().await,
            Err(error) => Err(error),
        };
        let framed = match answer {
            Ok(framed) => framed,
            Err(object_store::Error::NotFound { .. }) => return Err(Unreadable::Missing),
            Err(error) => return Err(StoreError::from(error).into()),
        };
        let name = *name;
        // Hashing and unpacking take milliseconds.
        tokio::task::spawn_blocking(move || Ok((unframe(&name, &framed)?, framed)))
            .await
            .map_err(StoreError::from)?
            .map_err(|fault: FrameError| Unreadable::Damaged(fault.to_string()))
    }

    /// The names of all objects. What is called otherwise is none of them, and is left out.
    ///
    /// # Errors
    /// When the object store fails.
    pub async fn list(&self) -> Result<Vec<ObjectName>, StoreError> {
        let found = self.files.list(None).map_ok(|file| {
            let mut parts = file.location.parts();
            let (kind, _prefix, digest) = (parts.next()?, parts.next()?, parts.next()?);
            ObjectName::parse(kind.as_ref(), digest.as_ref())
                .filter(|name| name.path() == file.location)
        });
        let names: Vec<_> = found.try_collect().await?;
        Ok(names.into_iter().flatten().collect())
    }

    /// Removes an object; one that is not there is removed.
    ///
    /// # Errors
    /// When the object store fails.
    pub async fn delete(&self, name: &ObjectName) -> Result<(), StoreError> {
        match self.files.delete(&name.path()).await {
            Ok(()) | Err(object_store::Error::NotFound { .. }) => Ok(()),
            Err(error) => Err(error.into()),
        }
    }

    /// Whether the object store answers.
    ///
    /// # Errors
    /// When the object store fails.
    pub async fn check(&self) -> Result<(), StoreError> {
        let nowhere = object_store::path::Path::from("check");
        match self.files.head(&nowhere).await {
            Ok(_) | Err(object_store::Error::NotFound { .. }) => Ok(()),
            Err(error) => Err(error.into()),
        }
    }
}

/// Writes a header and a file, of which at most a part is in memory.
async fn write_parts(
    upload: &mut dyn MultipartUpload,
    header: [u8; HEADER_LENGTH],
    file: &Path,
) -> Result<(), StoreError> {
    let mut file = tokio::fs::File::open(file).await?;
    let mut part = header.to_vec();
    loop {
        part.reserve_exact(PART_LENGTH - part.len());
        while part.len() < PART_LENGTH && file.read_buf(&mut part).await? > 0 {}
        let last = part.len() < PART_LENGTH;
        if !part.is_empty() {
            upload.put_part(std::mem::take(&mut part).into()).await?;
        }
        if last {
            break;
        }
    }
    upload.complete().await?;
    Ok(())
}
