//! `isocortex prepare`.

use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use clap::Args;
use imaging::{Format, sniff};

use super::progress::ProgressDisplay;
use super::status::{CliError, ExitStatus};
use super::{VolumeOptions, case_file, check_output, read_input, write_output};
use case::{CaseFacts, CaseId, CaseState, Parameters};
use cases::Library;
use cases::dicom::{Choice, DicomReader, Input, Options, Program};
use cases::jobs::Workers;
use pipeline::{Limits, Pipeline, Prepared, Source};
use storage::Store;

/// The limit for unpacked DICOM files, in bytes.
const MAX_DICOM_BYTES: u64 = 16 << 30;

/// The number of bytes that identify the kind of a file.
const SNIFFED_BYTES: u64 = 64 << 10;

/// The time for the worker to finish.
const GRACE: Duration = Duration::from_secs(5);

/// Prepare a volume into the store, or into one file
///
/// With --data, it becomes a case in that store, and its id is printed. With --output, everything is written to one
/// file, which `isocortex render` reads.
#[derive(Debug, Args)]
pub(super) struct PrepareArgs {
    /// An MR volume: NIfTI-1 or NIfTI-2, .nii or .nii.gz; or DICOM: a folder, a zip, or one file.
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
    args.output.as_deref().map_or(Ok(()), check_output)?;
    let source = super::block_on(source(&args.volume, &args.options))?;
    let parameters = args.options.parameters(args.name.clone())?;
    let pipeline = args.options.pipeline()?;
    match &args.output {
        Some(output) => {
            let prepared = prepare_here(&source, &parameters, &pipeline)?;
            write_output(output, &case_file::write(prepared)?)
        }
        None => {
            super::keep_files_private();
            let data = args.data.clone();
            let data = data.unwrap_or_else(|| crate::config::Config::default().storage.data);
            super::block_on(into_store(&data, (source, parameters), pipeline))
        }
    }
}

/// Reads the files of an input. DICOM files, recognised by content, become a volume.
pub(super) async fn source(volume: &Path, options: &VolumeOptions) -> Result<Source, CliError> {
    let mask = options.mask.as_deref().map(read_input).transpose()?;
    let is_dicom =
        volume.is_dir() || matches!(sniff(&head_of(volume)?), Format::Zip | Format::Dicom);
    if !is_dicom {
        return Ok(Source {
            volume: read_input(volume)?,
            mask,
            ..Source::default()
        });
    }
    let chosen = Options {
        series: options.series.clone(),
        allow_gaps: options.allow_gaps,
    };
    let reader = DicomReader::new(Program::default(), Limits::default(), MAX_DICOM_BYTES);
    let scratch = std::env::temp_dir();
    let reading = reader.read(Input::Path(volume), &chosen, &scratch).await?;
    tell(&reading.choice);
    Ok(Source {
        volume: reading.volume().await.map_err(internal)?,
        mask,
        dicom: Some(reading.attributes),
        ..Source::default()
    })
}

fn internal(error: std::io::Error) -> CliError {
    CliError::new(ExitStatus::Internal, error)
}

/// The first bytes of an input, which identify it; empty for a folder.
pub(super) fn head_of(input: &Path) -> Result<Vec<u8>, CliError> {
    let mut head = Vec::new();
    if input.is_dir() {
        return Ok(head);
    }
    let read = File::open(input).and_then(|file| file.take(SNIFFED_BYTES).read_to_end(&mut head));
    read.map(|_| head).map_err(|error| {
        let message = format!("{} cannot be read: {error}", input.display());
        CliError::new(ExitStatus::NoInput, message)
    })
}

/// Reports the chosen series.
fn tell(choice: &Choice) {
    let [columns, rows, slices] = choice.series.size;
    let number = choice.series.number.map(|number| format!(" {number}"));
    let modality = &choice.series.modality;
    eprintln!(
        "DICOM series{}: {modality}, {columns} × {rows} × {slices}; {} other series, {} other files",
        number.unwrap_or_default(),
        choice.others.len(),
        choice.ignored_files
    );
    let filled = &choice.interpolated_slices;
    if !filled.is_empty() {
        eprintln!("interpolated missing slices: {filled:?}");
    }
}

/// Prepares an input in this process, showing the progress.
pub(super) fn prepare_here(
    source: &Source,
    parameters: &Parameters,
    pipeline: &Pipeline,
) -> Result<Prepared, CliError> {
    let display = ProgressDisplay::new();
    let observe = |progress| display.show(progress);
    let never = AtomicBool::new(false);
    let limits = Limits::default();
    let prepared = pipeline.prepare(source, parameters, &limits, &observe, &never)?;
    warn_of_doubts(&prepared.facts);
    Ok(prepared)
}

/// Reports doubts about the mask on standard error.
fn warn_of_doubts(facts: &CaseFacts) {
    if let Some(quality) = &facts.quality {
        for reason in &quality.reasons {
            eprintln!("isocortex: {}: {reason}", quality.state.name());
        }
    }
}

async fn into_store(
    data: &Path,
    (source, parameters): (Source, Parameters),
    pipeline: Pipeline,
) -> Result<(), CliError> {
    let store = Store::open(data).await?;
    let library = Library::new(store.clone(), pipeline.into(), Limits::default());
    let submitted = library.submit(source, parameters).await?;
    let workers = Workers::start(library, 1);
    let ready = wait_until_ready(&store, &submitted.case.id).await;
    workers.shut_down(GRACE).await;
    ready?;
    if let Some(case) = store.case(&submitted.case.id).await?
        && let Some(facts) = &case.facts
    {
        warn_of_doubts(facts);
    }
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
