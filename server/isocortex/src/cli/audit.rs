//! `isocortex audit`.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::status::{CliError, ExitStatus};

/// Look at the record of who did what
#[derive(Debug, Clone, Args)]
pub(super) struct AuditArgs {
    #[command(subcommand)]
    command: AuditCommand,
}

#[derive(Debug, Clone, Subcommand)]
enum AuditCommand {
    /// Find lines that were changed, removed or inserted.
    Verify(VerifyArgs),
    /// Print what stands for a UID in the record.
    Digest(DigestArgs),
}

/// Reads all files of the record, prints each place at which it is not as it was written, then the last line of each process:
/// compare these with the lines on the machine that they are shipped to, because whole files or last lines that were removed leave no other trace here. The exit status
/// is 0 if nothing was found, 66 if the folder has no record, otherwise 74. The record may be in use.
#[derive(Debug, Clone, Args)]
struct VerifyArgs {
    /// The folder of the record.
    folder: PathBuf,
}

#[derive(Debug, Clone, Args)]
struct DigestArgs {
    /// The UID of a study.
    uid: String,
}

pub(super) fn run(args: &AuditArgs) -> Result<(), CliError> {
    match &args.command {
        AuditCommand::Verify(args) => verify(args),
        AuditCommand::Digest(args) => {
            println!("{}", access::audit::digest_of_uid(&args.uid));
            Ok(())
        }
    }
}

fn verify(args: &VerifyArgs) -> Result<(), CliError> {
    let verified = access::audit::verify(&args.folder).map_err(|error| {
        let why = format!("{} cannot be read: {error}", args.folder.display());
        CliError::new(ExitStatus::NoInput, why)
    })?;
    for found in &verified.breaks {
        println!("{found}");
    }
    for note in &verified.notes {
        println!("note: {note}");
    }
    for head in &verified.heads {
        println!(
            "last line of {}: {} {}",
            head.process, head.seq, head.digest
        );
    }
    let (lines, files) = (verified.lines, verified.files);
    if files == 0 {
        let why = format!(
            "{} has no file of an audit record: nothing was ever recorded here, or everything was removed",
            args.folder.display()
        );
        return Err(CliError::new(ExitStatus::NoInput, why));
    }
    match verified.breaks.len() {
        0 => {
            println!("{lines} lines in {files} files are as they were written");
            Ok(())
        }
        breaks => {
            let why = format!(
                "the record is not as it was written, at {breaks} places in {lines} lines of {files} files"
            );
            Err(CliError::new(ExitStatus::InputOutput, why))
        }
    }
}
