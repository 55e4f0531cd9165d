//! `isocortex key`.

use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Write as _};
use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use storage::Keys;

use super::status::{CliError, ExitStatus};
use crate::config::keys;

/// The beginning of a new file.
const HEADER: &str = "\
# The keys of the objects of an Isocortex store. The first line encrypts new objects, all lines decrypt.
# Without this file nobody can read the store and its backups: keep a copy apart from both.
";

/// Make keys that encrypt the objects of a store
#[derive(Debug, Clone, Args)]
pub(super) struct KeyCommandArgs {
    #[command(subcommand)]
    command: KeyCommand,
}

#[derive(Debug, Clone, Subcommand)]
enum KeyCommand {
    /// Make a key, put it first in a file, and print its id.
    New(NewArgs),
}

/// The keys that are in the file stay, to read what they have encrypted. Running servers and workers read the file again when they
/// write the next object. Give each machine the same file, then run `isocortex rekey`, and remove the other keys from the file when that is done.
#[derive(Debug, Clone, Args)]
struct NewArgs {
    /// The file, which is `storage.key_file` of the server; it is made if it is missing.
    #[arg(long = "file", value_name = "FILE", env = "ISOCORTEX_KEY_FILE")]
    key_file: PathBuf,
}

pub(super) fn run(args: &KeyCommandArgs) -> Result<(), CliError> {
    let KeyCommand::New(args) = &args.command;
    super::keep_files_private();
    let before = match std::fs::read_to_string(&args.key_file) {
        Ok(text) => {
            keys(Some(&args.key_file))?;
            text
        }
        Err(error) if error.kind() == ErrorKind::NotFound => String::new(),
        Err(error) => return Err(unwritable(&args.key_file, &error)),
    };
    let (line, id) =
        Keys::new_line().map_err(|error| CliError::new(ExitStatus::Internal, error))?;
    let before = before.strip_prefix(HEADER).unwrap_or(&before);
    replace(&args.key_file, &format!("{HEADER}{line}{before}"))
        .map_err(|error| unwritable(&args.key_file, &error))?;
    println!("{id}");
    eprintln!(
        "Without {} nobody can read the store and its backups: keep a copy apart from both.",
        args.key_file.display()
    );
    Ok(())
}

fn unwritable(path: &Path, error: &std::io::Error) -> CliError {
    let why = format!("{} cannot be written: {error}", path.display());
    CliError::new(ExitStatus::CannotCreate, why)
}

/// Replaces a file by one step; it is durable then. A link to it stays one. The file keeps its owner, its group and its mode, so that
/// the server can read it whoever makes the key; a new file is for its owner alone.
fn replace(path: &Path, text: &str) -> std::io::Result<()> {
    let path = std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let mut staged = path.clone().into_os_string();
    staged.push(".new");
    let staged = PathBuf::from(staged);
    // If somebody else replaces it at the same time, one of them fails.
    let mut file = OpenOptions::new()
        .write(true)
        .create_new(true)
        .open(&staged)?;
    let written = keep_owner(&path, &file)
        .and_then(|()| file.write_all(text.as_bytes()))
        .and_then(|()| file.sync_all())
        .and_then(|()| std::fs::rename(&staged, &path));
    if written.is_err() {
        let _gone = std::fs::remove_file(&staged);
    }
    written
}

/// Gives a file the owner, the group and the mode of the one that it will replace.
#[cfg(unix)]
fn keep_owner(replaced: &Path, file: &File) -> std::io::Result<()> {
    use std::os::unix::fs::MetadataExt as _;
    let before = match std::fs::metadata(replaced) {
        Ok(metadata) => metadata,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(error),
    };
    let now = file.metadata()?;
    if (now.uid(), now.gid()) != (before.uid(), before.gid()) {
        std::os::unix::fs::fchown(file, Some(before.uid()), Some(before.gid()))?;
    }
    file.set_permissions(before.permissions())
}

/// Other systems have no owners.
#[cfg(not(unix))]
fn keep_owner(_replaced: &Path, _file: &File) -> std::io::Result<()> {
    Ok(())
}

#[cfg(all(test, unix))]
mod tests {
    use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _};

    use super::*;

    #[test]
    fn a_file_of_keys_keeps_its_owner_its_group_and_its_mode() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("keys");
        std::fs::write(&path, "old").unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o640)).unwrap();
        // Only root can give files away.
        let is_root = rustix::process::geteuid().is_root();
        if is_root {
            std::os::unix::fs::chown(&path, Some(4321), Some(8765)).unwrap();
        }
        let before = path.metadata().unwrap();
        replace(&path, "new").unwrap();
        let after = path.metadata().unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "new");
        assert_eq!((after.uid(), after.gid()), (before.uid(), before.gid()));
        assert_eq!(after.mode() & 0o7777, 0o640);
        assert!(!is_root || after.uid() == 4321);
    }
}
