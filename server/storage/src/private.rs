//! Files that only their owner may read.

use std::path::Path;

/// The bits of a mode that let others read, write or enter.
#[cfg(unix)]
const OTHERS: u32 = 0o077;

/// Removes the permissions of others from a file or folder, and logs it; `what` names it in the log.
///
/// If the mode cannot be changed (a mounted secret, a folder with another owner), the log reports that.
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
        Err(error) => tracing::warn!(
            kind = %error.kind(),
            "others can read {what}; its mode is {before:04o} and cannot be changed"
        ),
    }
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
}
