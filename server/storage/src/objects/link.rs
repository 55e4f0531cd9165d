//! Makes a spooled file an object of a directory: the same file under another name.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Write as _};
use std::path::{Path, PathBuf};

use uuid::Uuid;

/// Writes `header` into the room at the beginning of a file, and makes the file durable under the name `place`,
/// replacing any file there. Readers see either the old or the new file, complete. `false` if the file system does not
/// support hard links.
///
/// The file keeps its first name, so that a failed attempt can be repeated.
pub(crate) fn link(file: &Path, header: &[u8], place: &Path) -> io::Result<bool> {
    let mut object = File::options().write(true).open(file)?;
    object.write_all(header)?;
    object.sync_all()?;
    let folder = place.parent().ok_or(ErrorKind::InvalidInput)?;
    create_durable(folder)?;
    let staged = staged(place);
    match fs::hard_link(file, &staged) {
        Ok(()) => {}
        Err(error) if is_impossible(&error) => return Ok(false),
        Err(error) => return Err(error),
    }
    let renamed = fs::rename(&staged, place);
    // If both names already belong to one file, nothing is renamed; a failure leaves nothing.
    match fs::remove_file(&staged) {
        Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
        _ => renamed?,
    }
    sync(folder)?;
    Ok(true)
}

/// A temporary name that is removed if it is left over, like those of `object_store`: `address#something`.
fn staged(place: &Path) -> PathBuf {
    let mut name = place.as_os_str().to_owned();
    name.push(format!("#{}", Uuid::now_v7()));
    name.into()
}

/// Whether the two names cannot be on one disk, or the disk does not support hard links.
fn is_impossible(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::CrossesDevices
            | ErrorKind::PermissionDenied
            | ErrorKind::TooManyLinks
            | ErrorKind::Unsupported
    )
}

/// Creates a folder and its missing parents, each durable.
fn create_durable(folder: &Path) -> io::Result<()> {
    let above = folder.parent().ok_or(ErrorKind::InvalidInput)?;
    match fs::create_dir(folder) {
        Ok(()) => sync(above),
        Err(error) if error.kind() == ErrorKind::AlreadyExists => Ok(()),
        Err(error) if error.kind() == ErrorKind::NotFound => {
            create_durable(above)?;
            create_durable(folder)
        }
        Err(error) => Err(error),
    }
}

/// Makes the names in a folder durable.
fn sync(folder: &Path) -> io::Result<()> {
    File::open(folder)?.sync_all()
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &[u8] = b"header";

    /// A directory with a spooled file, and the place of its object.
    fn spooled() -> (tempfile::TempDir, PathBuf, PathBuf) {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("upload");
        fs::write(&file, b"\0\0\0\0\0\0payload").unwrap();
        let place = directory.path().join("objects/kind/ab/abcd");
        fs::create_dir(directory.path().join("objects")).unwrap();
        (directory, file, place)
    }

    fn names_beside(place: &Path) -> usize {
        fs::read_dir(place.parent().unwrap()).unwrap().count()
    }

    #[test]
    fn the_object_is_the_file_and_outlives_its_first_name() {
        let (_directory, file, place) = spooled();
        assert!(link(&file, HEADER, &place).unwrap());
        fs::remove_file(&file).unwrap();
        assert_eq!(fs::read(&place).unwrap(), b"headerpayload");
        assert_eq!(names_beside(&place), 1);
    }

    #[test]
    fn it_is_done_again_and_replaces_what_is_damaged() {
        let (_directory, file, place) = spooled();
        for before in [None, Some(&b"damaged"[..])] {
            if let Some(bytes) = before {
                fs::remove_file(&place).unwrap();
                fs::write(&place, bytes).unwrap();
            }
            for _ in 0..2 {
                assert!(link(&file, HEADER, &place).unwrap());
                assert_eq!(fs::read(&place).unwrap(), b"headerpayload");
                assert_eq!(names_beside(&place), 1, "no staged name is left");
            }
        }
    }

    #[test]
    fn a_file_that_is_gone_is_an_error_and_leaves_nothing() {
        let (_directory, file, place) = spooled();
        fs::remove_file(&file).unwrap();
        assert!(link(&file, HEADER, &place).is_err());
        assert!(!place.exists());
    }

    #[test]
    fn a_place_that_cannot_be_written_is_an_error_and_leaves_the_file() {
        let (directory, file, place) = spooled();
        // A folder has the name of the object.
        fs::create_dir_all(&place).unwrap();
        assert!(link(&file, HEADER, &place).is_err());
        assert_eq!(names_beside(&place), 1, "no staged name is left");
        // A file has the name of its folder.
        let taken = directory.path().join("objects/mask");
        fs::write(&taken, b"a file").unwrap();
        assert!(link(&file, HEADER, &taken.join("ab/abcd")).is_err());
        assert_eq!(
            fs::read(&file).unwrap(),
            b"headerpayload",
            "for the next attempt"
        );
    }

    #[test]
    fn only_what_hard_links_cannot_do_is_left_to_a_copy() {
        for (kind, expected) in [
            (ErrorKind::CrossesDevices, true),
            (ErrorKind::PermissionDenied, true),
            (ErrorKind::TooManyLinks, true),
            (ErrorKind::Unsupported, true),
            (ErrorKind::StorageFull, false),
            (ErrorKind::NotFound, false),
        ] {
            assert_eq!(is_impossible(&kind.into()), expected, "{kind:?}");
        }
    }
}
