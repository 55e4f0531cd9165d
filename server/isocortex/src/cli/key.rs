//! `isocortex key`.

use std::fs::OpenOptions;
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

/// Replaces a file by one step, for its owner alone; it is durable then. A link to it stays one.
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
    let written = file
        .write_all(text.as_bytes())
        .and_then(|()| file.sync_all())
        .and_then(|()| std::fs::rename(&staged, &path));
    if written.is_err() {
        let _gone = std::fs::remove_file(&staged);
    }
    written
}
