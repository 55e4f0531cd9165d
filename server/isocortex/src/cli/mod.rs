//! The command line.

mod audit;
mod before_patients;
mod bids;
mod check_config;
mod check_store;
mod choices;
mod common;
mod demo;
mod doctor;
mod init_store;
mod layers;
mod manual;
mod migrate_store;
mod prepare;
mod process;
mod progress;
mod reload;
mod remove_expired;
mod render;
mod serve;
mod status;
mod test_node;
mod token;
mod voxels;
mod waiting;
mod work;

use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::CommandFactory as _;
use clap::{Args, Parser, Subcommand};

use self::status::{CliError, ExitStatus};
use crate::config::Config;
use case::{MaskKind, MaskSource, Parameters};
use cases::dicom::{Form, SeriesName};
use imaging::START_BYTES;
use pipeline::{Extractor, Pipeline};

/// The limit for unpacked DICOM files, in bytes.
const MAX_DICOM_BYTES: u64 = 16 << 30;

/// The end of `--help`, before the notice.
const EXAMPLES: &str = "\
Examples:
  isocortex demo                                    serve a sample head and print the address to open
  isocortex init-store --data /srv/isocortex        make a store, once
  isocortex serve --data /srv/isocortex             serve the cases of a directory on 127.0.0.1:8640
  isocortex serve --workers 0 --database postgres://isocortex@db/isocortex --objects s3://heads
  isocortex work --database postgres://isocortex@db/isocortex --objects s3://heads
  isocortex prepare head.nii.gz --mask brain.nii.gz --data /srv/isocortex
  isocortex prepare head.nii.gz --layer flair.nii.gz --data /srv/isocortex
  isocortex prepare dicom-folder --mask brain.nii.gz --series 3
  isocortex render head.nii.gz --mask brain.nii.gz --depth 8 --view left --output left.png
  isocortex bids /data /data/derivatives/isocortex participant

Exit status:
   0  done
   2  invalid command line
  65  unusable input (not NIfTI, MGH or DICOM, damaged, a mask is missing …); of `bids`: not all heads are done
  66  the input does not exist or cannot be read
  69  the address is taken, or the store is busy
  70  internal error
  73  the output cannot be written
  74  the store or its disk failed
  78  invalid configuration, or there is no store at the address, or the objects of another one, or its bucket denies access";

/// What `isocortex` alone prints.
const FIRST_WORDS: &str = "\
Isocortex shows the cortex of the brain as curved cuts at any depth below the dura. For research use only.
  isocortex demo                                                  a sample head in the browser, without a network
  isocortex serve --create --data DIR                             the server for your own heads
  isocortex render head.nii.gz --depth 8 --view left -o left.png  a picture without a server
  isocortex help                                                  all commands; `isocortex doctor` reports what is missing";

/// The version, and what it was built from if the build states it: `0.1.0 (0123abcd 2026-01-31)`.
fn version() -> String {
    let build = option_env!("ISOCORTEX_BUILD").filter(|build| !build.is_empty());
    let build = build.map(|build| format!(" ({build})"));
    format!("{}{}", env!("CARGO_PKG_VERSION"), build.unwrap_or_default())
}

/// The cortex of the brain as curved cuts at any depth below the dura.
///
/// Isocortex prepares an MR volume once, and then shows the cut at any depth in milliseconds: in the browser, over
/// HTTP, or as PNG.
#[derive(Debug, Parser)]
#[command(name = "isocortex", version = version(), after_help = format!("{EXAMPLES}\n\n{}", ::render::RESEARCH_USE_NOTICE))]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Serve the cases of a store over HTTP.
    Serve(serve::ServeArgs),
    /// Prepare the cases of a store that other processes serve.
    Work(work::WorkArgs),
    /// Prepare and serve a sample head, and print the address to open.
    Demo(demo::DemoArgs),
    /// Report what is here, what is missing, and the command that mends it.
    Doctor(doctor::DoctorArgs),
    /// Check a configuration without starting anything.
    CheckConfig(check_config::CheckConfigArgs),
    /// Make tokens with names and scopes.
    Token(token::TokenArgs),
    /// Look at the record of who did what.
    Audit(audit::AuditArgs),
    /// Ask a node of the PACS whether it answers.
    TestNode(test_node::TestNodeArgs),
    /// Make a new store.
    InitStore(init_store::InitStoreArgs),
    /// Give the copy of a store an id of its own.
    NewStoreId(init_store::NewStoreIdArgs),
    /// Read everything in a store, and report or repair what is wrong.
    CheckStore(check_store::CheckStoreArgs),
    /// Remove the cases that are older than a number of days, or list them.
    RemoveExpired(remove_expired::RemoveExpiredArgs),
    /// Copy every case of a store into another one.
    MigrateStore(migrate_store::MigrateStoreArgs),
    /// Prepare a volume into the store.
    Prepare(prepare::PrepareArgs),
    /// Draw the cut of a case or a volume as PNG.
    Render(render::RenderArgs),
    /// Derive depths, maps, places and reports from the heads of a BIDS folder.
    Bids(bids::BidsArgs),
    /// Write the man pages and the completions of shells, for a package.
    #[command(hide = true)]
    Manual(manual::ManualArgs),
}

/// A volume and the options of its preparation.
#[derive(Debug, Clone, Args)]
struct VolumeOptions {
    /// The brain mask, NIfTI or MGH, on any grid. Not needed if the volume is skull-stripped or the brain is to be extracted.
    #[arg(long, value_name = "FILE")]
    mask: Option<PathBuf>,
    /// Radius of the ball that closes the brain mask to the envelope, 0 to 50 mm.
    #[arg(long, value_name = "MM", default_value_t = 10.0)]
    closing_radius_mm: f64,
    /// Where the mask comes from if none is given.
    #[arg(long, value_name = "SOURCE", value_parser = choices::mask_source(), default_value = "auto")]
    mask_source: MaskSource,
    /// What the mask contains; an envelope is not closed.
    #[arg(long, value_name = "KIND", value_parser = choices::mask_kind(), default_value = "brain")]
    mask_kind: MaskKind,
    /// The weights of the network that extracts the brain. [default: deepbet-1.0.2-py3-none-any.whl beside the program]
    #[arg(long, value_name = "FILE", env = "ISOCORTEX_NETWORK")]
    network: Option<PathBuf>,
    /// The probability above which the network counts a voxel as brain, 0.05 to 0.95.
    #[arg(long, value_name = "P", default_value_t = 0.5)]
    threshold: f64,
    /// How far the surface of the mask is moved outwards before it is closed, -20 to 20 mm.
    #[arg(
        long,
        value_name = "MM",
        default_value_t = 0.0,
        allow_negative_numbers = true
    )]
    offset_mm: f64,
    /// Which form of the NIfTI headers of volume and mask is true, if they contradict each other.
    #[arg(long, value_name = "FORM", value_parser = choices::form())]
    affine: Option<Form>,
    /// The DICOM series to read: its number, instance UID or token.
    #[arg(long, value_name = "SERIES", value_parser = series_name)]
    series: Option<SeriesName>,
    /// Interpolate single missing DICOM slices, and list them.
    #[arg(long)]
    allow_gaps: bool,
}

impl VolumeOptions {
    /// What prepares it.
    fn pipeline(&self, config: &Config) -> Result<Pipeline, CliError> {
        let network = self.network.as_ref().or(config.prepare.network.as_ref());
        let extractor = Extractor::open(network.map(PathBuf::as_path));
        let extractor = extractor.map_err(|error| CliError::new(ExitStatus::NoInput, error))?;
        Ok(Pipeline::new(extractor))
    }

    /// The parameters of the preparation, checked.
    fn parameters(&self, name: Option<String>) -> Result<Parameters, CliError> {
        let parameters = Parameters {
            closing_radius_mm: self.closing_radius_mm,
            mask: self.mask_source,
            mask_kind: self.mask_kind,
            threshold: self.threshold,
            offset_mm: self.offset_mm,
            name,
        };
        parameters
            .check()
            .map_err(|failure| CliError::new(ExitStatus::Usage, failure.detail))?;
        Ok(parameters)
    }
}

fn series_name(text: &str) -> Result<SeriesName, &'static str> {
    SeriesName::parse(text).ok_or("name a series by its number, instance UID or token")
}

/// Runs the command and returns its exit status.
pub fn main() -> ExitCode {
    // The others of this user must not read the memory of this process.
    worker::hide();
    if std::env::args_os()
        .nth(1)
        .is_some_and(|first| first == worker::SUBCOMMAND)
    {
        return worker::run_child();
    }
    let Some(command) = Cli::parse().command else {
        println!("{FIRST_WORDS}");
        return ExitCode::SUCCESS;
    };
    match run(command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            match crate::logs::are_json() {
                true => tracing::error!("{}", error.message),
                false => eprintln!("isocortex: {}", error.message),
            }
            error.status.into()
        }
    }
}

fn run(command: Command) -> Result<(), CliError> {
    match command {
        Command::Serve(args) => serve::run(&args),
        Command::Work(args) => work::run(&args),
        Command::Doctor(args) => doctor::run(&args),
        Command::CheckConfig(args) => check_config::run(&args),
        Command::Token(args) => token::run(&args),
        Command::Audit(args) => audit::run(&args),
        Command::TestNode(args) => test_node::run(&args),
        Command::InitStore(args) => init_store::init(&args),
        Command::NewStoreId(args) => init_store::new_id(&args),
        Command::CheckStore(args) => check_store::run(&args),
        Command::RemoveExpired(args) => remove_expired::run(&args),
        Command::MigrateStore(args) => migrate_store::run(&args),
        Command::Demo(args) => demo::run(&args),
        Command::Prepare(args) => prepare::run(&args),
        Command::Render(args) => render::run(&args),
        Command::Bids(args) => bids::run(&args),
        Command::Manual(args) => manual::run(&args),
    }
}

/// The variables that no option reads.
const OTHER_VARIABLES: [&str; 2] = ["ISOCORTEX_DEMO_VOLUME", "ISOCORTEX_DEMO_MASK"];

/// Warnings of variables that begin like ours and that the program does not know: most likely a typing error, so that a setting does not hold.
fn unknown_variables(variables: impl IntoIterator<Item = String>) -> Vec<String> {
    let commands = Cli::command();
    let options = commands
        .get_subcommands()
        .flat_map(|command| command.get_arguments().filter_map(clap::Arg::get_env));
    let known: Vec<_> = options.filter_map(|name| name.to_str()).collect();
    // Kubernetes sets those for a service that is called `isocortex`.
    let is_of_a_service = |name: &str| {
        ["SERVICE_", "PORT"]
            .iter()
            .any(|part| name["ISOCORTEX_".len()..].starts_with(part))
    };
    let unknown = variables.into_iter().filter(|name| {
        name.starts_with("ISOCORTEX_")
            && !known.contains(&&**name)
            && !OTHER_VARIABLES.contains(&&**name)
            && !is_of_a_service(name)
    });
    let mut unknown: Vec<_> = unknown
        .map(|name| {
            let name = name.escape_debug();
            format!("the variable {name} is not known, and changes nothing; is it spelled right?")
        })
        .collect();
    unknown.sort();
    unknown
}

/// The names of the variables of this process.
fn variables() -> impl Iterator<Item = String> {
    std::env::vars_os().filter_map(|(name, _)| name.into_string().ok())
}

/// Makes new files private to the user, because they contain images of patients.
fn keep_files_private() {
    rustix::process::umask(rustix::fs::Mode::from_raw_mode(0o077));
}

/// Starts the runtime and waits for `work`.
fn block_on<T>(work: impl Future<Output = Result<T, CliError>>) -> Result<T, CliError> {
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .enable_all()
        .build()
        .map_err(|error| CliError::new(ExitStatus::Internal, error))?;
    runtime.block_on(work)
}

/// The first bytes of an input, which identify it; empty for a folder.
fn head_of(input: &Path) -> Result<Vec<u8>, CliError> {
    let mut head = Vec::new();
    if input.is_dir() {
        return Ok(head);
    }
    let read = File::open(input).and_then(|file| file.take(START_BYTES).read_to_end(&mut head));
    read.map(|_| head).map_err(|error| {
        let message = format!("{} cannot be read: {error}", input.display());
        CliError::new(ExitStatus::NoInput, message)
    })
}

fn read_input(path: &Path) -> Result<bytes::Bytes, CliError> {
    let read = std::fs::read(path).map(bytes::Bytes::from);
    read.map_err(|error| {
        let message = format!("{} cannot be read: {error}", path.display());
        CliError::new(ExitStatus::NoInput, message)
    })
}

fn write_output(path: &Path, contents: &[u8]) -> Result<(), CliError> {
    std::fs::write(path, contents).map_err(|error| unwritable(path, &error))
}

/// Checks that a file can be written, without changing it.
fn check_output(path: &Path) -> Result<(), CliError> {
    let tried = match std::fs::metadata(path) {
        // A pipe would be closed for its reader.
        Ok(there) if !there.is_file() && !there.is_dir() => Ok(()),
        Ok(_) => std::fs::OpenOptions::new()
            .append(true)
            .open(path)
            .map(drop),
        Err(_) => std::fs::File::create_new(path).and_then(|_| std::fs::remove_file(path)),
    };
    tried.map_err(|error| unwritable(path, &error))
}

fn unwritable(path: &Path, error: &std::io::Error) -> CliError {
    let message = format!("{} cannot be written: {error}", path.display());
    CliError::new(ExitStatus::CannotCreate, message)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn a_variable_that_is_spelled_wrongly_is_named() {
        let names = [
            "ISOCORTEX_TOKENFILE",
            "ISOCORTEX_TOKEN_FILE",
            "ISOCORTEX_WORK_LISTEN",
            "ISOCORTEX_SERVICE_HOST",
            "ISOCORTEX_PORT_8640_TCP",
            "PATH",
        ];
        let warnings = unknown_variables(names.map(str::to_owned));
        let [warning] = &warnings[..] else {
            panic!("{warnings:?}")
        };
        assert!(warning.contains("ISOCORTEX_TOKENFILE"), "{warning}");
    }

    #[test]
    fn an_output_is_tried_before_the_work_and_left_as_it_was() {
        let directory = tempfile::tempdir().unwrap();
        let output = directory.path().join("a.png");
        assert!(check_output(&output).is_ok());
        assert!(!output.exists());
        std::fs::write(&output, b"kept").unwrap();
        assert!(check_output(&output).is_ok());
        assert_eq!(std::fs::read(&output).unwrap(), b"kept");
        for wrong in [directory.path().join("none/a.png"), directory.path().into()] {
            let error = check_output(&wrong).unwrap_err();
            assert_eq!(error.status, ExitStatus::CannotCreate);
            assert!(error.message.contains("cannot be written"));
        }
    }
}
