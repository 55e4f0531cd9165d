//! Files that only their owner may read.

use std::path::Path;

/// The bits of a mode that let others read, write or enter.
const OTHERS: u32 = 0o077;

/// The bit of a mode that lets the group read.
const GROUP_READS: u32 = 0o040;

/// The bits of a mode that let others write.
const OTHERS_WRITE: u32 = 0o022;

/// The mode of a file or folder that others can read or change; `None` if they cannot. A secret that is mounted read-only, as in containers, has
/// the mode that its user needs; whoever mounts it keeps others out.
pub fn open_to_others(path: &Path) -> Option<u32> {
    use std::os::unix::fs::MetadataExt as _;
    let metadata = std::fs::metadata(path).ok()?;
    let mode = metadata.mode() & 0o7777;
    let is_open = mode & others(&metadata) != 0;
    (is_open && !is_mounted_secret(is_on_read_only_mount(path), mode)).then_some(mode)
}

/// The bits of a mode that others have. They do not have the reading of a group if somebody has chosen that group: a file of another user can only be read by
/// it, and root has a reason to give a file to a group that is not its own.
fn others(metadata: &std::fs::Metadata) -> u32 {
    use std::os::unix::fs::MetadataExt as _;
    let user = rustix::process::geteuid();
    let is_of_another = metadata.uid() != user.as_raw();
    let is_given = user.is_root() && metadata.gid() != rustix::process::getegid().as_raw();
    match metadata.is_file() && (is_of_another || is_given) {
        true => OTHERS & !GROUP_READS,
        false => OTHERS,
    }
}

/// Removes the permissions of others from a file or folder, and logs it; `what` names it in the log.
///
/// If the mode cannot be changed (a file of another owner), the log warns of that.
pub fn keep_private(path: &Path, what: &str) {
    use std::os::unix::fs::PermissionsExt as _;
    let Some(before) = open_to_others(path) else {
        return;
    };
    let Ok(metadata) = std::fs::metadata(path) else {
        return;
    };
    let after = before & !others(&metadata);
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

fn is_on_read_only_mount(path: &Path) -> bool {
    let mount = rustix::fs::statvfs(path);
    mount.is_ok_and(|mount| mount.f_flag.contains(rustix::fs::StatVfsMountFlags::RDONLY))
}

/// Whether a file is mounted read-only, and nobody but its owner may write to it.
fn is_mounted_secret(is_on_read_only_mount: bool, mode: u32) -> bool {
    is_on_read_only_mount && mode & OTHERS_WRITE == 0
}

#[cfg(test)]
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
        for (is_on_read_only_mount, mode, expected) in [
            (true, 0o444, true),
            (true, 0o440, true),
            (true, 0o666, false),
            (true, 0o464, false),
            (false, 0o444, false),
        ] {
            let is_one = is_mounted_secret(is_on_read_only_mount, mode);
            assert_eq!(is_one, expected, "{is_on_read_only_mount} {mode:o}");
        }
        assert!(!is_on_read_only_mount(&std::env::temp_dir()));
    }

    // Only root can give a file to any group.
    #[test]
    fn a_group_that_root_has_chosen_may_read() {
        if !rustix::process::geteuid().is_root() {
            return;
        }
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("key");
        std::fs::write(&file, b"secret").unwrap();
        std::os::unix::fs::chown(&file, None, Some(4321)).unwrap();
        for (before, after) in [(0o640, 0o640), (0o644, 0o640), (0o660, 0o640)] {
            std::fs::set_permissions(&file, std::fs::Permissions::from_mode(before)).unwrap();
            assert_eq!(open_to_others(&file), (before != after).then_some(before));
            keep_private(&file, "the file");
            let mode = file.metadata().unwrap().permissions().mode();
            assert_eq!(mode & 0o777, after, "{before:o}");
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
