//! `isocortex prepare`.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use clap::Args;

use super::progress::ProgressDisplay;
use super::status::{CliError, ExitStatus};
use super::{VolumeOptions, case_file, read_input, write_output};
use crate::case::{CaseId, CaseState, Parameters};
use crate::jobs::Workers;
use crate::prepare::{Limits, Prepared, Source};
use crate::store::Store;

/// How long the worker may take to put its things away.
const GRACE: Duration = Duration::from_secs(5);

/// Prepare a volume: into the store, or into one file
///
/// With --data it becomes a case of that store, under the id that is printed. With --output everything goes into one
/// file, which `isocortex render` reads.
#[derive(Debug, Args)]
pub(super) struct PrepareArgs {
    /// An MR volume: NIfTI-1 or NIfTI-2, .nii or .nii.gz.
    volume: PathBuf,
    #[command(flatten)]
    options: VolumeOptions,
    /// The file to write, instead of a case in the store.
    #[arg(long, value_name = "FILE", conflicts_with = "data")]
    output: Option<PathBuf>,
    /// The directory of the store. [default: isocortex-data]
    #[arg(long, value_name = "DIR", env = "ISOCORTEX_DATA")]
    data: Option<PathBuf>,
    /// A label for lists; not the patient's name.
    #[arg(long)]
    name: Option<String>,
}

/// Prepares a volume.
pub(super) fn run(args: &PrepareArgs) -> Result<(), CliError> {
    let source = source(&args.volume, args.options.mask.as_deref())?;
    let parameters = args.options.parameters(args.name.clone())?;
    match &args.output {
        Some(output) => {
            let prepared = prepare_here(&source, &parameters)?;
            write_output(output, &case_file::write(prepared)?)
        }
        None => {
            let data = args.data.clone();
            let data = data.unwrap_or_else(|| crate::config::Config::default().data);
            super::block_on(into_store(&data, source, parameters))
        }
    }
}

/// Reads the files of an input.
pub(super) fn source(volume: &Path, mask: Option<&Path>) -> Result<Source, CliError> {
    Ok(Source {
        volume: read_input(volume)?,
        mask: mask.map(read_input).transpose()?,
        ..Source::default()
    })
}

/// Prepares an input in this process, showing the progress.
pub(super) fn prepare_here(source: &Source, parameters: &Parameters) -> Result<Prepared, CliError> {
    let display = ProgressDisplay::new();
    let observe = |progress| display.show(progress);
    let never = AtomicBool::new(false);
    let limits = Limits::default();
    Ok(crate::prepare::prepare(
        source, parameters, &limits, &observe, &never,
    )?)
}

async fn into_store(data: &Path, source: Source, parameters: Parameters) -> Result<(), CliError> {
    let store = Store::open(data).await?;
    let submitted = store.submit(source, parameters).await?;
    let workers = Workers::start(store.clone(), 1);
    let ready = wait_until_ready(&store, &submitted.case.id).await;
    workers.shut_down(GRACE).await;
    ready?;
    println!("{}", submitted.case.id);
    Ok(())
}

/// Shows the progress of a case until it is ready.
pub(super) async fn wait_until_ready(store: &Store, id: &CaseId) -> Result<(), CliError> {
    let display = ProgressDisplay::new();
    let mut watch = store.subscribe(id);
    while let Some(case) = watch.next().await? {
        if let Some(progress) = case.progress {
            display.show(progress);
        }
        match (case.state, case.failure) {
            (CaseState::Ready, _) => return Ok(()),
            (CaseState::Failed, Some(failure)) => return Err(failure.into()),
            _ => {}
        }
    }
    Err(CliError::new(
        ExitStatus::Unavailable,
        "the case was deleted while it was being prepared",
    ))
}
