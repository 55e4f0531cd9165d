//! `isocortex check-config`.

use clap::Args;

use super::before_patients;
use super::serve::ServeArgs;
use super::status::{CliError, ExitStatus};
use crate::start;

/// Check a configuration without starting anything
///
/// Takes the options and variables of `serve`. Reads the files that it names: the token, passwords, certificates, the
/// weights of the network and the atlas. Opens no store and no port, and asks no node (`isocortex test-node`). Lists what is
/// done and what is missing before real patients. The exit status is 0 if a server could start with it, otherwise 78.
#[derive(Debug, Clone, Args)]
pub(super) struct CheckConfigArgs {
    #[command(flatten)]
    serve: ServeArgs,
}

/// Checks a configuration, and prints what it comes to.
pub(super) fn run(args: &CheckConfigArgs) -> Result<(), CliError> {
    let config = args.serve.config()?;
    let checked = start::check(&config)?;
    let unknown = super::unknown_variables(super::variables());
    for warning in unknown.iter().chain(&checked.warnings) {
        println!("warning: {warning}");
    }
    let extractor = pipeline::Extractor::open(config.prepare.network.as_deref());
    let extractor = extractor.map_err(|error| CliError::new(ExitStatus::Config, error))?;
    println!("brains are extracted {}", extractor.words());
    let atlas = pipeline::atlas::Atlas::open(&config.prepare.atlas);
    let atlas = atlas.map_err(|error| CliError::new(ExitStatus::Config, error))?;
    match atlas {
        Some(atlas) => println!("gyri are named by the atlas {}", atlas.path().display()),
        None => println!("gyri have no names, because no atlas is installed"),
    }
    for line in checked.lines {
        println!("{line}");
    }
    println!("the configuration is valid");
    println!("before real patients:");
    for point in before_patients::points(&config)? {
        println!("  {point}");
    }
    Ok(())
}
