//! The objects of a store, in a directory or in any object store.

use std::collections::HashSet;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use bytes::Bytes;
use futures_util::TryStreamExt as _;
use object_store::local::LocalFileSystem;
use object_store::{MultipartUpload, ObjectStore, ObjectStoreExt, PutPayload};

use super::frame::{Framed, plain_header, unframe};
use super::keys::Key;
use super::sealed::{SEALED_HEADER_LENGTH, SealedHeader, Sealing, sealed_length, unseal};
use super::{KeyId, Keys, ObjectError, ObjectName, Spooled, link};
use crate::lock;

/// The folder of the names of the keys with which objects are encrypted.
const KEYS_FOLDER: &str = "keys";

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
    /// The keys with which they are encrypted.
    keys: Keys,
    /// The keys that are known to be named in the store. Held only briefly.
    named: Arc<Mutex<HashSet<KeyId>>>,
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

/// A verified object.
#[derive(Debug)]
pub(crate) struct Whole {
    pub(crate) payload: Bytes,
    /// Its header and its payload, not encrypted.
    pub(crate) framed: Bytes,
    /// The key with which it is encrypted.
    pub(crate) key: Option<KeyId>,
}

impl Objects {
    /// Objects in any object store.
    pub(crate) fn new(files: Arc<dyn ObjectStore>) -> Self {
        Self {
            files,
            directory: None,
            keys: Keys::default(),
            named: Arc::default(),
        }
    }

    /// The same objects with keys.
    pub(crate) fn with_keys(self, keys: Keys) -> Self {
        Self { keys, ..self }
    }

    pub(crate) fn keys(&self) -> &Keys {
        &self.keys
    }

    /// Objects in a directory, which is created if missing. An object is on the disk when `put` returns.
    ///
    /// # Errors
    /// If the directory cannot be used.
    pub(crate) fn in_directory(directory: &Path) -> Result<Self, ObjectError> {
        std::fs::create_dir_all(directory)?;
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
        let parts = [header, framed.payload.clone()];
        self.put_parts(&framed.name, parts).await
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
        self.put_parts(name, [framed, Bytes::new()]).await
    }

    async fn put_parts(&self, name: &ObjectName, parts: [Bytes; 2]) -> Result<(), ObjectError> {
        let payload = match self.key_for_writing().await? {
            None => PutPayload::from_iter(parts),
            Some(key) => {
                let name = *name;
                let seal = move || {
                    let length = parts.iter().map(|part| part.len() as u64).sum();
                    let [first, second] = &parts;
                    let content = first.chain(&second[..]);
                    let capacity = sealed_length(length).unwrap_or(length);
                    let mut sealed = Vec::with_capacity(capacity as usize);
                    Sealing::new(&key, &name, length, content)?.read_to_end(&mut sealed)?;
                    Ok::<_, std::io::Error>(sealed)
                };
                // Encryption takes milliseconds.
                tokio::task::spawn_blocking(seal).await??.into()
            }
        };
        self.files.put(&name.path(), payload).await?;
        Ok(())
    }

    /// The key for new objects, if they are encrypted. It is named in the store before the first of them is there, so that
    /// nobody opens the store without it.
    async fn key_for_writing(&self) -> Result<Option<Key>, ObjectError> {
        let Some(key) = self.keys.ring().for_writing().cloned() else {
            return Ok(None);
        };
        if !lock(&self.named).contains(&key.id) {
            let text = Bytes::from_static(b"Objects of this store are encrypted with this key.\n");
            self.files.put(&path_of(key.id), text.into()).await?;
            lock(&self.named).insert(key.id);
        }
        Ok(Some(key))
    }

    /// The keys with which objects of this store may be encrypted.
    ///
    /// # Errors
    /// If the object store fails.
    pub(crate) async fn named_keys(&self) -> Result<Vec<KeyId>, ObjectError> {
        let folder = object_store::path::Path::from(KEYS_FOLDER);
        let found = self.files.list(Some(&folder));
        let found = found.map_ok(|file| KeyId::parse(file.location.filename()?));
        let keys: Vec<_> = found.try_collect().await?;
        Ok(keys.into_iter().flatten().collect())
    }

    /// Forgets a key: no object is encrypted with it any more.
    ///
    /// # Errors
    /// If the object store fails.
    pub(crate) async fn forget_key(&self, key: KeyId) -> Result<(), ObjectError> {
        lock(&self.named).remove(&key);
        match self.files.delete(&path_of(key)).await {
            Ok(()) | Err(object_store::Error::NotFound { .. }) => Ok(()),
            Err(error) => Err(error.into()),
        }
    }

    /// The key with which an object is encrypted, from its first bytes alone; `None` if these cannot say it, because the object
    /// is missing or damaged, or the object store fails.
    pub(crate) async fn key_of(&self, name: &ObjectName) -> Option<Option<KeyId>> {
        let start = 0..SEALED_HEADER_LENGTH as u64;
        let start = self.files.get_range(&name.path(), start).await.ok()?;
        let header = SealedHeader::of(&start).ok()?;
        Some(header.map(|header| header.key()))
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
        let key = self.key_for_writing().await?;
        if let Some(directory) = &self.directory
            && key.is_none()
        {
            let place = directory.join(name.path().as_ref());
            let file = file.path().to_owned();
            let linked = tokio::task::spawn_blocking(move || link::link(&file, &header, &place));
            if linked.await?? {
                return Ok(());
            }
        }
        let length = header.len() as u64 + file.len();
        let file = file.open().await?.into_std().await;
        let content = std::io::Cursor::new(header).chain(file);
        let content: Content = match key {
            None => Box::new(content),
            Some(key) => Box::new(Sealing::new(&key, name, length, content)?),
        };
        self.copy(name, content).await
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
        self.read(name).await.map(|whole| whole.payload)
    }

    /// The verified bytes of an object, not encrypted.
    ///
    /// # Errors
    /// As [`Objects::get`].
    pub(crate) async fn get_framed(&self, name: &ObjectName) -> Result<Bytes, Unreadable> {
        self.read(name).await.map(|whole| whole.framed)
    }

    /// An object, verified.
    ///
    /// # Errors
    /// As [`Objects::get`].
    pub(crate) async fn read(&self, name: &ObjectName) -> Result<Whole, Unreadable> {
        let answer = match self.files.get(&name.path()).await {
            Ok(answer) => answer.bytes().await,
            Err(error) => Err(error),
        };
        let stored = match answer {
            Ok(stored) => stored,
            Err(object_store::Error::NotFound { .. }) => return Err(Unreadable::Missing),
            Err(error) => return Err(ObjectError::from(error).into()),
        };
        let (name, keys) = (*name, self.keys.clone());
        // Decrypting, hashing and unpacking take milliseconds.
        tokio::task::spawn_blocking(move || whole(&name, stored, &keys))
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

    /// Whether the object store answers.
    ///
    /// # Errors
    /// If the object store fails.
    pub(crate) async fn check(&self) -> Result<(), ObjectError> {
        let nowhere = object_store::path::Path::from("check");
        // An answer to HEAD has no body, and so no reason of a bucket.
        match self.files.get(&nowhere).await {
            Ok(_) | Err(object_store::Error::NotFound { .. }) => Ok(()),
            Err(error) => Err(error.into()),
        }
    }
}

/// The bytes of an object as they are stored.
type Content = Box<dyn Read + Send>;

/// The name of a key in the store.
fn path_of(key: KeyId) -> object_store::path::Path {
    object_store::path::Path::from_iter([KEYS_FOLDER, &key.to_string()])
}

/// Decrypts an object if it is encrypted, verifies it against its name and unpacks it.
fn whole(name: &ObjectName, stored: Bytes, keys: &Keys) -> Result<Whole, Unreadable> {
    fn damaged(fault: impl std::fmt::Display) -> Unreadable {
        Unreadable::Damaged(fault.to_string())
    }
    let header = SealedHeader::of(&stored).map_err(damaged)?;
    let framed = match &header {
        None => stored,
        Some(header) => {
            let ring = keys.ring();
            let key = ring.find(header.key());
            let key = key.ok_or(ObjectError::NoKey(header.key()))?;
            unseal(header, key, name, stored).map_err(damaged)?
        }
    };
    let payload = unframe(name, &framed).map_err(damaged)?;
    Ok(Whole {
        payload,
        framed,
        key: header.map(|header| header.key()),
    })
}

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
