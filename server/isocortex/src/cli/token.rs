//! `isocortex token`.

use std::fs::{File, OpenOptions};
use std::io::Write as _;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};

use access::scopes::{Role, Scope};
use clap::builder::PossibleValuesParser;
use clap::builder::TypedValueParser as _;
use clap::{Args, Subcommand};
use jiff::Timestamp;
use jiff::civil::Date;
use jiff::tz::TimeZone;

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
/// PACS does, and with `dicom-reject` also rejection notes; `results` sends results to a node; `metrics` reads the metrics, if they need a token; `admin` does what no other scope permits. A running server reads the file
/// again within seconds. To withdraw a token, delete its entry.
#[derive(Debug, Clone, Args)]
struct NewArgs {
    /// Who will hold it: letters, digits and `.`, `_`, `@`, `-`. It appears in log lines.
    name: String,
    /// The file of the tokens, which is `http.tokens_file` of the server; it is made if it is missing.
    #[arg(long, value_name = "FILE", env = "ISOCORTEX_TOKENS_FILE")]
    file: PathBuf,
    /// What it may be used for, by a role: viewer (read), editor (read, write, results), pacs (dicom-store), admin (all).
    #[arg(long, value_name = "ROLE", value_parser = role(), required_unless_present = "scopes")]
    role: Option<Role>,
    /// What it may be used for: read, write, dicom-store, dicom-reject, results, metrics, admin.
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
    PossibleValuesParser::new(words).try_map(|word| word.parse::<Role>())
}

pub(super) fn run(args: &TokenArgs) -> Result<(), CliError> {
    let TokenCommand::New(args) = &args.command;
    let usage = |why: String| CliError::new(ExitStatus::Usage, why);
    check_token_name(&args.name).map_err(usage)?;
    let unwritable = |error| {
        let why = format!("{} cannot be written: {error}", args.file.display());
        CliError::new(ExitStatus::CannotCreate, why)
    };
    // Nobody else adds a token meanwhile.
    let mut file = opened(&args.file).map_err(unwritable)?;
    let mut config = Config::default();
    config.http.tokens_file = Some(args.file.clone());
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
    append(&mut file, &entry(args, &token)).map_err(unwritable)?;
    println!("{token}");
    eprintln!("Keep this token now: the file has its digest only.");
    let today = Timestamp::now().to_zoned(TimeZone::UTC).date();
    if args.until.is_some_and(|day| day < today) {
        eprintln!("It opens nothing, because `--until` lies in the past.");
    }
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

/// The file of the tokens, locked; it is made if it is missing, for its owner alone.
fn opened(path: &Path) -> std::io::Result<File> {
    let mut options = OpenOptions::new();
    let file = options.append(true).create(true).mode(0o600).open(path)?;
    file.lock()?;
    Ok(file)
}

/// Adds lines by one write. The file keeps its owner, and a link to it stays one. A server that reads half of the lines keeps the
/// tokens that it has, and reads the file again.
fn append(file: &mut File, lines: &str) -> std::io::Result<()> {
    let is_empty = file.metadata()?.len() == 0;
    let lines = if is_empty { lines.trim_start() } else { lines };
    file.write_all(lines.as_bytes())?;
    file.sync_all()
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
