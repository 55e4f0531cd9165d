//! Files that only their owner may read.

#[cfg(unix)]
use std::io::{Error, ErrorKind};
use std::path::Path;

/// The bits of a mode that let others read, write or enter.
#[cfg(unix)]
const OTHERS: u32 = 0o077;

/// The bits of a mode that let others write.
#[cfg(unix)]
const OTHERS_WRITE: u32 = 0o022;

/// Removes the permissions of others from a file or folder, and logs it; `what` names it in the log.
///
/// If the mode cannot be changed (a folder with another owner), the log warns of that. A secret that is mounted read-only, as in
/// containers, has the mode that its user needs; whoever mounts it keeps others out.
#[cfg(unix)]
pub fn keep_private(path: &Path, what: &str) {
    use std::os::unix::fs::PermissionsExt as _;
    let Ok(mode) = std::fs::metadata(path).map(|metadata| metadata.permissions().mode()) else {
        return;
    };
    if mode & OTHERS == 0 {
        return;
    }
    let (before, after) = (mode & 0o7777, mode & 0o7777 & !OTHERS);
    match std::fs::set_permissions(path, std::fs::Permissions::from_mode(after)) {
        Ok(()) => tracing::warn!(
            "others could read {what}; its mode was {before:04o} and is now {after:04o}"
        ),
        Err(error) if is_mounted_secret(&error, before) => {
            tracing::debug!("{what} is mounted read-only with mode {before:04o}");
        }
        Err(error) => tracing::warn!(
            kind = %error.kind(),
            "others can read {what}; its mode is {before:04o} and cannot be changed"
        ),
    }
}

/// Whether the mode of a file cannot be changed because the file is mounted read-only, and nobody but its owner may write to it.
#[cfg(unix)]
fn is_mounted_secret(error: &Error, mode: u32) -> bool {
    error.kind() == ErrorKind::ReadOnlyFilesystem && mode & OTHERS_WRITE == 0
}

/// Other systems have no modes.
#[cfg(not(unix))]
pub fn keep_private(_path: &Path, _what: &str) {}

#[cfg(all(test, unix))]
mod tests {
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    #[test]
    fn what_others_could_read_they_cannot_any_more() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::set_permissions(folder.path(), std::fs::Permissions::from_mode(0o755)).unwrap();
        keep_private(folder.path(), "the folder");
        let mode = folder.path().metadata().unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o700);
    }

    #[test]
    fn only_a_secret_on_a_read_only_mount_is_as_it_should_be() {
        for (kind, mode, expected) in [
            (ErrorKind::ReadOnlyFilesystem, 0o444, true),
            (ErrorKind::ReadOnlyFilesystem, 0o440, true),
            (ErrorKind::ReadOnlyFilesystem, 0o666, false),
            (ErrorKind::ReadOnlyFilesystem, 0o464, false),
            (ErrorKind::PermissionDenied, 0o444, false),
        ] {
            assert_eq!(
                is_mounted_secret(&kind.into(), mode),
                expected,
                "{kind:?} {mode:o}"
            );
        }
    }

    #[test]
    fn what_the_owner_may_do_stays_and_what_is_not_there_does_no_harm() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("key");
        keep_private(&file, "a file that is not there");
        std::fs::write(&file, b"secret").unwrap();
        for (before, after) in [
            (0o400, 0o400),
            (0o600, 0o600),
            (0o640, 0o600),
            (0o777, 0o700),
        ] {
            std::fs::set_permissions(&file, std::fs::Permissions::from_mode(before)).unwrap();
            keep_private(&file, "the file");
            let mode = file.metadata().unwrap().permissions().mode();
            assert_eq!(mode & 0o777, after, "{before:o}");
        }
    }
}
