//! The directory of a process: `uploads/` and `lock`, and `rows.sqlite` and `objects/` unless these have other places.
//!
//! Every process that uses it holds a shared lock on `lock`, which the kernel releases when the process ends for any
//! reason. A process that gets the lock exclusively knows that no other one is running, so every unfinished file is
//! left over.

use std::fs::{File, OpenOptions};
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use crate::error::at;
use crate::{StoreError, keep_private};

/// While other processes run, an unfinished file is left over after this time without a write.
const STALE_AFTER: Duration = Duration::from_secs(24 * 60 * 60);

/// An open directory of a store.
#[derive(Debug)]
pub(super) struct Directory {
    root: PathBuf,
    _shared_lock: File,
}

impl Directory {
    /// Creates missing folders, removes left-over files, and takes the shared lock. Fails with [`StoreError::OtherUser`] if this process has another user than the
    /// one that made the directory, who could not read what it writes.
    ///
    /// `prepare` runs before anything is removed; what it makes is returned. It learns whether no other process uses the directory; then no other one can start before it
    /// has ended.
    pub(super) async fn open<T>(
        root: &Path,
        prepare: impl AsyncFnOnce(bool) -> Result<T, StoreError>,
    ) -> Result<(Self, T), StoreError> {
        create_private(root).map_err(at(root))?;
        keep_private(root, "the folder of the store");
        std::fs::create_dir_all(root.join("uploads")).map_err(at(root))?;
        let lock = OpenOptions::new()
            .create(true)
            .truncate(false)
            .write(true)
            .open(root.join("lock"))?;
        check_owner(&lock.metadata()?, &root.join("uploads"))?;
        let (lock, prepared) = if lock.try_lock().is_ok() {
            let prepared = prepare(true).await?;
            sweep(root, Duration::ZERO)?;
            lock.unlock()?;
            (take_shared(lock).await?, prepared)
        } else {
            // Whoever is alone may be making the tables.
            let lock = take_shared(lock).await?;
            let prepared = prepare(false).await?;
            sweep(root, STALE_AFTER)?;
            (lock, prepared)
        };
        let directory = Self {
            root: root.to_owned(),
            _shared_lock: lock,
        };
        Ok((directory, prepared))
    }

    pub(super) fn uploads(&self) -> PathBuf {
        self.root.join("uploads")
    }
}

/// Checks that what this process writes into `folder` gets the owner of a file that is there. Otherwise the server could not read what a command
/// of root has written. Some file systems give every file the same owner; there, anybody may write.
fn check_owner(there: &std::fs::Metadata, folder: &Path) -> Result<(), StoreError> {
    use std::os::unix::fs::MetadataExt as _;
    let written = tempfile::tempfile_in(folder).and_then(|file| file.metadata());
    match written {
        Ok(written) if written.uid() != there.uid() => Err(StoreError::OtherUser(there.uid())),
        // If nothing can be written, that shows later.
        Ok(_) | Err(_) => Ok(()),
    }
}

/// Checks the same for objects in a folder of their own. An empty one belongs to anybody.
pub(super) fn check_owner_of_objects(objects: &Path) -> Result<(), StoreError> {
    // The id may have been written by hand.
    let there = match subdirectories(objects)?.first() {
        Some(kind) => Some(std::fs::metadata(kind)?),
        None => std::fs::metadata(objects.join("store-id")).ok(),
    };
    there.map_or(Ok(()), |there| check_owner(&there, objects))
}

/// Removes the files of unfinished objects after a long time without a write; files that other machines are writing
/// stay.
pub(super) fn sweep_shared(objects: &Path) -> io::Result<()> {
    sweep_staged(objects, STALE_AFTER)
}

/// Creates a directory that only its owner may enter, because it will contain images of patients.
fn create_private(root: &Path) -> io::Result<()> {
    let mut builder = std::fs::DirBuilder::new();
    builder.recursive(true);
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    builder.create(root)
}

/// Waits for the lock: another process may be sweeping, which takes moments.
async fn take_shared(lock: File) -> io::Result<File> {
    tokio::task::spawn_blocking(move || {
        lock.lock_shared()?;
        Ok(lock)
    })
    .await
    .map_err(io::Error::other)?
}

/// Removes unfinished files without a write for `age`.
fn sweep(root: &Path, age: Duration) -> io::Result<()> {
    for entry in std::fs::read_dir(root.join("uploads"))? {
        remove_if_older(&entry?.path(), age)?;
    }
    let objects = root.join("objects");
    match objects.is_dir() {
        true => sweep_staged(&objects, age),
        false => Ok(()),
    }
}

/// Removes the files of unfinished objects without a write for `age`.
fn sweep_staged(objects: &Path, age: Duration) -> io::Result<()> {
    for kind in subdirectories(objects)? {
        for prefix in subdirectories(&kind)? {
            for entry in std::fs::read_dir(prefix)? {
                let path = entry?.path();
                if is_staged(&path) {
                    remove_if_older(&path, age)?;
                }
            }
        }
    }
    Ok(())
}

/// Whether this is an unfinished object of `object_store`, which names it `address#number` until it is complete.
fn is_staged(path: &Path) -> bool {
    path.file_name()
        .is_some_and(|name| name.to_string_lossy().contains('#'))
}

fn subdirectories(directory: &Path) -> io::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(directory)? {
        let entry = entry?;
        if entry.file_type()?.is_dir() {
            found.push(entry.path());
        }
    }
    Ok(found)
}

fn remove_if_older(path: &Path, age: Duration) -> io::Result<()> {
    let gone_is_fine = |error: io::Error| match error.kind() {
        io::ErrorKind::NotFound => Ok(()),
        _ => Err(error),
    };
    let metadata = match std::fs::symlink_metadata(path) {
        Ok(metadata) => metadata,
        Err(error) => return gone_is_fine(error),
    };
    let written = metadata.modified()?;
    let since = SystemTime::now()
        .duration_since(written)
        .unwrap_or_default();
    if since < age {
        return Ok(());
    }
    let removed = if metadata.is_dir() {
        std::fs::remove_dir_all(path)
    } else {
        std::fs::remove_file(path)
    };
    removed.or_else(gone_is_fine)
}

#[cfg(test)]
mod tests {
    use super::*;

    async fn open(root: &Path) -> (Directory, bool) {
        let opened = Directory::open(root, async |is_alone| Ok(is_alone));
        opened.await.unwrap()
    }

    fn leftovers(root: &Path) -> [PathBuf; 2] {
        let staged = root.join("objects/volume/ab");
        std::fs::create_dir_all(&staged).unwrap();
        let files = [root.join("uploads/upload-x"), staged.join("abcd#1")];
        for file in &files {
            std::fs::write(file, b"half").unwrap();
        }
        files
    }

    #[tokio::test]
    async fn who_comes_first_or_after_all_have_gone_sweeps() {
        let root = tempfile::tempdir().unwrap();
        assert!(open(root.path()).await.1);
        let left = leftovers(root.path());
        let whole = root.path().join("objects/volume/ab/abcd");
        std::fs::write(&whole, b"whole").unwrap();
        assert!(open(root.path()).await.1);
        assert!(left.iter().all(|file| !file.exists()));
        assert!(whole.exists());
    }

    #[tokio::test]
    async fn who_joins_sweeps_only_what_is_stale() {
        let root = tempfile::tempdir().unwrap();
        let (_first, _) = open(root.path()).await;
        let [fresh, stale] = leftovers(root.path());
        let long_ago = SystemTime::now() - STALE_AFTER - Duration::from_secs(1);
        File::options()
            .write(true)
            .open(&stale)
            .unwrap()
            .set_modified(long_ago)
            .unwrap();
        let (_second, alone) = open(root.path()).await;
        assert!(!alone && fresh.exists() && !stale.exists());
    }

    // Only root can give files away, and only root meets a directory of somebody else that it may write to.
    #[tokio::test]
    async fn a_directory_of_another_user_is_not_written_to() {
        if !rustix::process::geteuid().is_root() {
            return;
        }
        let root = tempfile::tempdir().unwrap();
        drop(open(root.path()).await);
        std::os::unix::fs::chown(root.path().join("lock"), Some(4321), None).unwrap();
        let [left, _] = leftovers(root.path());
        let refused = Directory::open(root.path(), async |_| Ok(())).await;
        match refused {
            Err(StoreError::OtherUser(user)) => assert_eq!(user, 4321),
            other => panic!("{other:?}"),
        }
        assert!(left.exists(), "nothing was removed");
    }

    #[test]
    fn objects_of_another_user_are_not_written_to() {
        let objects = tempfile::tempdir().unwrap();
        let check = || check_owner_of_objects(objects.path());
        assert!(check().is_ok(), "an empty folder");
        let kind = objects.path().join("volume");
        std::fs::create_dir(&kind).unwrap();
        assert!(check().is_ok(), "our own");
        if !rustix::process::geteuid().is_root() {
            return;
        }
        std::os::unix::fs::chown(&kind, Some(4321), None).unwrap();
        match check() {
            Err(StoreError::OtherUser(user)) => assert_eq!(user, 4321),
            other => panic!("{other:?}"),
        }
    }
}
