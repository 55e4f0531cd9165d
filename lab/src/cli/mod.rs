//! The command line.

mod agreement;
mod head;
mod paper;
mod step;
mod study;
mod study_progress;

use std::path::Path;
use std::process::ExitCode;

use bench::{BenchError, Report, Table, plots};
use clap::{Args, Parser, Subcommand};

/// Repeat the experiments of the paper on this machine, and compare the pictures of the renderers
#[derive(Debug, Parser)]
#[command(name = "isocortex-bench", version, after_help = render::RESEARCH_USE_NOTICE)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Paper(paper::PaperArgs),
    Agreement(agreement::AgreementArgs),
    Step(step::StepArgs),
    Study(Box<study::StudyArgs>),
}

/// The output of a report.
#[derive(Debug, Args)]
struct OutputArgs {
    /// Print JSON instead of tables.
    #[arg(long)]
    json: bool,
    /// Also write the figures as SVG files into this directory; it is created if missing.
    #[arg(long, value_name = "DIR")]
    plot: Option<std::path::PathBuf>,
}

/// Runs the program.
pub(crate) fn run() -> ExitCode {
    let done = match Cli::parse().command {
        Command::Paper(args) => paper::run(&args),
        Command::Agreement(args) => agreement::run(&args),
        Command::Step(args) => step::run(&args),
        Command::Study(args) => study::run(&args),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("isocortex-bench: {error}");
            ExitCode::from(error.exit_status())
        }
    }
}

/// Reports the next measurement on standard error.
fn progress(what: &str) {
    eprintln!("{what}");
}

impl OutputArgs {
    /// Creates the directory of the plots before the work, which may take minutes.
    fn check(&self) -> Result<(), BenchError> {
        let Some(directory) = &self.plot else {
            return Ok(());
        };
        create(directory)
    }

    /// Prints a report and writes its plots.
    fn give(&self, report: &Report) -> Result<(), BenchError> {
        if let Some(directory) = &self.plot {
            write_plots(directory, &report.tables)?;
        }
        if self.json {
            println!("{:#}", report.json());
        } else {
            print!("{}", report.text());
        }
        Ok(())
    }
}

/// Creates a directory if it is missing.
fn create(directory: &Path) -> Result<(), BenchError> {
    std::fs::create_dir_all(directory).map_err(|error| BenchError::unwritable(directory, &error))
}

/// Writes the plots of tables as SVG files.
fn write_plots(directory: &Path, tables: &[Table]) -> Result<(), BenchError> {
    for (name, svg) in tables.iter().flat_map(plots) {
        write(&directory.join(format!("{name}.svg")), svg.as_bytes())?;
    }
    Ok(())
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), BenchError> {
    std::fs::write(path, bytes).map_err(|error| BenchError::unwritable(path, &error))
}
