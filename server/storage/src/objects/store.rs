//! The objects of a store, in a directory or in any object store.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bytes::Bytes;
use futures_util::TryStreamExt as _;
use object_store::local::LocalFileSystem;
use object_store::{MultipartUpload, ObjectStore, ObjectStoreExt, PutMode, PutPayload};

use super::frame::{Framed, plain_header, unframe};
use super::{ObjectError, ObjectName, Spooled, link};
use crate::error::at;
use crate::label::Label;

/// The object with the id of the store.
const LABEL: &str = "store-id";

/// The size of a part when a file is copied into the store; S3 accepts 5 MiB or more.
const PART_LENGTH: usize = 8 << 20;

/// The reason why an object cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum Unreadable {
    /// It is missing.
    #[error("an object is missing")]
    Missing,
    /// It is damaged.
    #[error("an object is damaged: {0}")]
    Damaged(String),
    /// It cannot be reached; it may be intact.
    #[error(transparent)]
    Store(#[from] ObjectError),
}

/// The objects of a store.
#[derive(Debug, Clone)]
pub(crate) struct Objects {
    files: Arc<dyn ObjectStore>,
    /// Their directory, if they are on this machine.
    directory: Option<PathBuf>,
}

/// An object that is there, whether or not it is sound.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Listed {
    pub(crate) name: ObjectName,
    /// As stored.
    pub(crate) bytes: u64,
    /// When it was written, by the clock of the object store, in microseconds since 1970.
    pub(crate) modified_us: i64,
}

impl Objects {
    /// Objects in any object store.
    pub(crate) fn new(files: Arc<dyn ObjectStore>) -> Self {
        Self {
            files,
            directory: None,
        }
    }

    /// Objects in a directory, which is created if missing. An object is on the disk when `put` returns.
    ///
    /// # Errors
    /// If the directory cannot be used.
    pub(crate) fn in_directory(directory: &Path) -> Result<Self, ObjectError> {
        std::fs::create_dir_all(directory).map_err(at(directory))?;
        let files = LocalFileSystem::new_with_prefix(directory)?.with_fsync(true);
        Ok(Self {
            directory: Some(directory.to_owned()),
            ..Self::new(Arc::new(files))
        })
    }

    /// Writes an object, replacing an existing one, which may be damaged. Readers see either the old or the new one,
    /// complete.
    ///
    /// # Errors
    /// If the object store fails.
    pub(crate) async fn put(&self, framed: &Framed) -> Result<(), ObjectError> {
        let header = Bytes::copy_from_slice(&framed.header);
        let payload = PutPayload::from_iter([header, framed.payload.clone()]);
        self.files.put(&framed.name.path(), payload).await?;
        Ok(())
    }

    /// Writes the bytes of an object from another store, replacing an existing one.
    ///
    /// # Errors
    /// If the object store fails.
    pub(crate) async fn put_framed(
        &self,
        name: &ObjectName,
        framed: Bytes,
    ) -> Result<(), ObjectError> {
        self.files.put(&name.path(), framed.into()).await?;
        Ok(())
    }

    /// Makes an object from a spooled file, replacing an existing one. In a directory on the same disk, it becomes the
    /// same file under another name; elsewhere it is copied, with at most one part in memory.
    ///
    /// # Errors
    /// If the object store fails.
    pub(crate) async fn put_file(
        &self,
        name: &ObjectName,
        file: &Spooled,
    ) -> Result<(), ObjectError> {
        let header = plain_header(name, file.len());
        if let Some(directory) = &self.directory {
            let place = directory.join(name.path().as_ref());
            let file = file.path().to_owned();
            let linked = tokio::task::spawn_blocking(move || link::link(&file, &header, &place));
            if linked.await?? {
                return Ok(());
            }
        }
        let file = file.open().await?.into_std().await;
        let content = std::io::Cursor::new(header).chain(file);
        self.copy(name, Box::new(content)).await
    }

    async fn copy(&self, name: &ObjectName, content: Content) -> Result<(), ObjectError> {
        let mut upload = self.files.put_multipart(&name.path()).await?;
        let written = write_parts(&mut *upload, content).await;
        if written.is_err() {
            // Parts of an unfinished object stay in a bucket for ever; if they cannot be aborted either, the rules of
            // the bucket remove them.
            let _given_up = upload.abort().await;
        }
        written
    }

    /// The verified payload of an object.
    ///
    /// # Errors
    /// If it is missing or damaged, or the object store fails.
    pub(crate) async fn get(&self, name: &ObjectName) -> Result<Bytes, Unreadable> {
        self.read(name).await.map(|(_, payload)| payload)
    }

    /// The verified bytes of an object, with its header.
    ///
    /// # Errors
    /// As [`Objects::get`].
    pub(crate) async fn get_framed(&self, name: &ObjectName) -> Result<Bytes, Unreadable> {
        self.read(name).await.map(|(framed, _)| framed)
    }

    /// The bytes of an object and its payload, verified.
    async fn read(&self, name: &ObjectName) -> Result<(Bytes, Bytes), Unreadable> {
        let answer = match self.files.get(&name.path()).await {
            Ok(answer) => answer.bytes().await,
            Err(error) => Err(error),
        };
        let framed = match answer {
            Ok(framed) => framed,
            Err(object_store::Error::NotFound { .. }) => return Err(Unreadable::Missing),
            Err(error) => return Err(ObjectError::from(error).into()),
        };
        let name = *name;
        // Hashing and unpacking take milliseconds.
        let verify = move || match unframe(&name, &framed) {
            Ok(payload) => Ok((framed, payload)),
            Err(fault) => Err(Unreadable::Damaged(fault.to_string())),
        };
        tokio::task::spawn_blocking(verify)
            .await
            .map_err(ObjectError::from)?
    }

    /// The names of all objects. Files with other names are ignored.
    ///
    /// # Errors
    /// If the object store fails.
    pub(crate) async fn list(&self) -> Result<Vec<ObjectName>, ObjectError> {
        let listed = self.list_all().await?.into_iter();
        Ok(listed.map(|listed| listed.name).collect())
    }

    /// All objects, as [`Objects::list`], with their sizes and times.
    ///
    /// # Errors
    /// If the object store fails.
    pub(crate) async fn list_all(&self) -> Result<Vec<Listed>, ObjectError> {
        let found = self.files.list(None).map_ok(|file| {
            let mut parts = file.location.parts();
            let (kind, _prefix, digest) = (parts.next()?, parts.next()?, parts.next()?);
            let name = ObjectName::parse(kind.as_ref(), digest.as_ref())
                .filter(|name| name.path() == file.location)?;
            Some(Listed {
                name,
                bytes: file.size,
                modified_us: file.last_modified.timestamp_micros(),
            })
        });
        let listed: Vec<_> = found.try_collect().await?;
        Ok(listed.into_iter().flatten().collect())
    }

    /// The time by the clock of the object store, in microseconds since 1970: that of an object which is written for this.
    ///
    /// # Errors
    /// If the object store fails.
    pub(crate) async fn now(&self) -> Result<i64, ObjectError> {
        let place = object_store::path::Path::from(format!("clock-{}", uuid::Uuid::now_v7()));
        let written = Bytes::from_static(b"what time is it?");
        self.files.put(&place, written.into()).await?;
        let written = self.files.head(&place).await;
        self.files.delete(&place).await?;
        Ok(written?.last_modified.timestamp_micros())
    }

    /// Whether an object is there, whole or damaged.
    ///
    /// # Errors
    /// If the object store does not answer.
    pub(crate) async fn has(&self, name: &ObjectName) -> Result<bool, ObjectError> {
        match self.files.head(&name.path()).await {
            Ok(_) => Ok(true),
            Err(object_store::Error::NotFound { .. }) => Ok(false),
            Err(error) => Err(error.into()),
        }
    }

    /// Removes an object, if it exists.
    ///
    /// # Errors
    /// If the object store fails.
    pub(crate) async fn delete(&self, name: &ObjectName) -> Result<(), ObjectError> {
        match self.files.delete(&name.path()).await {
            Ok(()) | Err(object_store::Error::NotFound { .. }) => Ok(()),
            Err(error) => Err(error.into()),
        }
    }

    /// The label of the store: what its `store-id` says.
    ///
    /// # Errors
    /// If the object store does not answer.
    pub(crate) async fn label(&self) -> Result<Label, ObjectError> {
        let answer = match self.files.get(&LABEL.into()).await {
            Ok(answer) => answer.bytes().await,
            Err(error) => Err(error),
        };
        match answer {
            Ok(bytes) => Ok(Label::parse(&bytes)),
            Err(object_store::Error::NotFound { .. }) => Ok(Label::Missing),
            Err(error) => Err(error.into()),
        }
    }

    /// Writes the label, unless there is one.
    ///
    /// # Errors
    /// If the object store fails.
    pub(crate) async fn create_label(&self, label: &Label) -> Result<(), ObjectError> {
        let (path, text) = (LABEL.into(), label.text());
        let made = self
            .files
            .put_opts(&path, text.into(), PutMode::Create.into());
        match made.await {
            Ok(_) | Err(object_store::Error::AlreadyExists { .. }) => Ok(()),
            // Some buckets and file systems cannot do this in one step. Whoever wrote another label meanwhile finds it when it is compared.
            Err(_) if self.label().await? == Label::Missing => self.put_label(label).await,
            Err(_) => Ok(()),
        }
    }

    /// Writes the label, whatever there is.
    ///
    /// # Errors
    /// If the object store fails.
    pub(crate) async fn put_label(&self, label: &Label) -> Result<(), ObjectError> {
        self.files.put(&LABEL.into(), label.text().into()).await?;
        Ok(())
    }

    /// Whether there is no file at all.
    ///
    /// # Errors
    /// If the object store fails.
    pub(crate) async fn are_none(&self) -> Result<bool, ObjectError> {
        let first = self.files.list(None).try_next().await?;
        Ok(first.is_none())
    }
}

/// The bytes of an object as they are stored.
type Content = Box<dyn Read + Send>;

/// Writes an object, with at most one part in memory.
async fn write_parts(
    upload: &mut dyn MultipartUpload,
    mut content: Content,
) -> Result<(), ObjectError> {
    loop {
        let read = move || {
            let mut part = Vec::with_capacity(PART_LENGTH);
            content
                .by_ref()
                .take(PART_LENGTH as u64)
                .read_to_end(&mut part)?;
            Ok::<_, std::io::Error>((part, content))
        };
        let part;
        (part, content) = tokio::task::spawn_blocking(read).await??;
        let is_last = part.len() < PART_LENGTH;
        if !part.is_empty() {
            upload.put_part(part.into()).await?;
        }
        if is_last {
            break;
        }
    }
    upload.complete().await?;
    Ok(())
}
