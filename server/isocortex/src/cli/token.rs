//! `isocortex token`.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use clap::builder::PossibleValuesParser;
use clap::builder::TypedValueParser as _;
use clap::{Args, Subcommand};
use http_support::scopes::{Role, Scope};
use jiff::civil::Date;

use super::status::{CliError, ExitStatus};
use crate::config::{Config, check_token_name};

/// What every token begins with, so that programs that search for lost secrets know it.
const PREFIX: &str = "isocortex_";

/// Random bytes of a token.
const RANDOM_BYTES: usize = 32;

/// Make tokens with names and scopes
#[derive(Debug, Clone, Args)]
pub(super) struct TokenArgs {
    #[command(subcommand)]
    command: TokenCommand,
}

#[derive(Debug, Clone, Subcommand)]
enum TokenCommand {
    /// Make a token, add its digest to a file, and print the token once.
    New(NewArgs),
}

/// Scopes: `read` looks at everything, patients' names included; `write` adds, changes and deletes; `dicom-store` stores images as a
/// PACS does; `results` sends results to a node; `metrics` reads the metrics, if they need a token; `admin` does what no other scope permits. A running server reads the file
/// again within seconds. To withdraw a token, delete its entry.
#[derive(Debug, Clone, Args)]
struct NewArgs {
    /// Who will hold it: letters, digits and `.`, `_`, `@`, `-`. It appears in log lines.
    name: String,
    /// The file of the tokens, which is `http.tokens_file` of the server; it is made if it is missing.
    #[arg(long, value_name = "FILE", env = "ISOCORTEX_TOKENS_FILE")]
    file: PathBuf,
    /// What it may be used for, by a role: viewer (read), editor (read, write, results), pacs (read, dicom-store), admin (all).
    #[arg(long, value_name = "ROLE", value_parser = role(), required_unless_present = "scopes")]
    role: Option<Role>,
    /// What it may be used for: read, write, dicom-store, results, metrics, admin.
    #[arg(
        long = "scope",
        value_name = "SCOPE,…",
        value_delimiter = ',',
        conflicts_with = "role"
    )]
    scopes: Vec<Scope>,
    /// The last day on which it opens, in UTC, such as 2027-06-30.
    #[arg(long, value_name = "DATE")]
    until: Option<Date>,
}

fn role() -> impl clap::builder::TypedValueParser<Value = Role> {
    let words = Role::ALL.map(Role::name);
    PossibleValuesParser::new(words).try_map(|word| {
        let found = Role::ALL.into_iter().find(|role| role.name() == word);
        found.ok_or("no such role")
    })
}

pub(super) fn run(args: &TokenArgs) -> Result<(), CliError> {
    let TokenCommand::New(args) = &args.command;
    let usage = |why: String| CliError::new(ExitStatus::Usage, why);
    check_token_name(&args.name).map_err(usage)?;
    let mut config = Config::default();
    config.http.tokens_file = args.file.exists().then(|| args.file.clone());
    let known = config.named_tokens()?;
    if known.iter().any(|token| *token.holder.name == *args.name) {
        let why = format!(
            "{} has a token of this name; delete its entry first",
            args.file.display()
        );
        return Err(usage(why));
    }
    let mut random = [0; RANDOM_BYTES];
    getrandom::fill(&mut random).map_err(|error| CliError::new(ExitStatus::Internal, error))?;
    let token = format!("{PREFIX}{}", hex(&random));
    append(&args.file, &entry(args, &token)).map_err(|error| {
        let why = format!("{} cannot be written: {error}", args.file.display());
        CliError::new(ExitStatus::CannotCreate, why)
    })?;
    println!("{token}");
    eprintln!("Keep this token now: the file has its digest only.");
    Ok(())
}

/// The lines of a token in the file.
fn entry(args: &NewArgs, token: &str) -> String {
    let scopes = match args.role {
        Some(role) => role.scopes(),
        None => &args.scopes,
    };
    let scopes: Vec<_> = scopes.iter().map(|scope| format!("\"{scope}\"")).collect();
    let until = args.until.map(|day| format!("until = \"{day}\"\n"));
    format!(
        "\n[[tokens]]\nname = \"{}\"\nscopes = [{}]\n{}blake3 = \"{}\"\n",
        args.name,
        scopes.join(", "),
        until.unwrap_or_default(),
        blake3::hash(token.as_bytes())
    )
}

/// Adds lines to a file in one piece, so that a server never reads half of them.
fn append(path: &Path, lines: &str) -> std::io::Result<()> {
    let before = match std::fs::read_to_string(path) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => String::new(),
        Err(error) => return Err(error),
    };
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let mut file = tempfile::NamedTempFile::new_in(folder)?;
    file.write_all(before.as_bytes())?;
    file.write_all(
        lines
            .trim_start_matches(if before.is_empty() { "\n" } else { "" })
            .as_bytes(),
    )?;
    if let Ok(metadata) = path.metadata() {
        file.as_file().set_permissions(metadata.permissions())?;
    }
    file.as_file().sync_all()?;
    file.persist(path)?;
    Ok(())
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
