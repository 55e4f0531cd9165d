//! `isocortex prepare`.

use std::path::{Path, PathBuf};
use std::time::Duration;

use bytes::Bytes;
use clap::Args;
use imaging::sniff;
use imaging::surface::SubjectLayer;

use super::common::{StoreArgs, set_some};
use super::layers::{LayerFile, LayerOptions, add_layers, add_subject};
use super::progress::ProgressDisplay;
use super::status::{CliError, ExitStatus};
use super::voxels::write_voxels;
use super::{MAX_DICOM_BYTES, VolumeOptions, head_of, read_input};
use crate::start::StartError;
use case::images::Image;
use case::{CaseId, CaseState, MaskSource, Parameters, Progress};
use cases::dicom::{Choice, DicomReader, Input, Options, Program, SubjectReading};
use cases::jobs::start_workers;
use cases::settings::MapsUse;
use cases::{Library, open_library};
use pipeline::{Limits, Source};
use storage::Store;

/// The time for the worker to finish.
pub(super) const GRACE: Duration = Duration::from_secs(5);

/// Prepare a volume into the store, and print the id of its case
#[derive(Debug, Args)]
pub(super) struct PrepareArgs {
    /// An MR volume: NIfTI or MGH, gzipped or not; DICOM: a folder, a zip, or one file; or the folder of a FreeSurfer or FastSurfer subject, or a
    /// zip of it, whose surfaces and regions become layers.
    volume: PathBuf,
    #[command(flatten)]
    options: VolumeOptions,
    #[command(flatten)]
    store: StoreArgs,
    /// A label for lists; not the patient's name.
    #[arg(long)]
    name: Option<String>,
    /// Also write what voxels have values of as NIfTI, in the grid of the volume, into this folder: the brain, depths in mm, sides and regions,
    /// each map, and the places that it lists.
    #[arg(long, value_name = "FOLDER")]
    nifti: Option<PathBuf>,
    #[command(flatten)]
    layers: LayerOptions,
}

/// Prepares a volume, as a server with the same settings would; what else waits in the store may be prepared meanwhile.
pub(super) fn run(args: &PrepareArgs) -> Result<(), CliError> {
    let mut config = args.store.config()?;
    config.storage.create = true;
    config.prepares_apart = true;
    set_some(&mut config.prepare.network, args.options.network.as_ref());
    let input = super::block_on(source(&args.volume, &args.options))?;
    if config.pacs.deidentify && input.source.dicom.is_some() {
        let why = "`pacs.deidentify` is set, and `prepare` keeps what DICOM files state of the patient; upload them to the server";
        return Err(CliError::new(ExitStatus::Config, why));
    }
    let parameters = args.options.parameters(args.name.clone())?;
    let layers = args.layers.layers()?;
    super::keep_files_private();
    // They are made when somebody asks for them.
    config.limits.maps = MapsUse::Off;
    let options = config.cases()?;
    super::block_on(async {
        let library = open_library(&options).await.map_err(StartError::from)?;
        let store = library.store().clone();
        let (id, added) = into_store(library, input, parameters, layers).await?;
        println!("{id}");
        if let Some(folder) = &args.nifti {
            write_voxels(store, &id, folder).await?;
        }
        added
    })
}

/// What is read of an input.
#[derive(Default)]
pub(super) struct Read {
    pub(super) source: Source,
    /// The images that it is made of.
    images: Vec<Image>,
    /// The layers of a subject, each with its file.
    layers: Vec<(Bytes, SubjectLayer)>,
}

/// Reads the files of an input. DICOM files, recognised by content, become a volume; the folder of a subject, a volume with layers.
pub(super) async fn source(volume: &Path, options: &VolumeOptions) -> Result<Read, CliError> {
    let read = |path: &Path| {
        let bytes = read_input(path)?;
        Ok::<_, CliError>(match options.affine {
            Some(form) => pipeline::keeping_form(&bytes, form, &Limits::default())?.into(),
            None => bytes,
        })
    };
    let mask = options.mask.as_deref().map(read).transpose()?;
    if !volume.is_dir() && !sniff(&head_of(volume)?).may_be_dicom() {
        let source = Source {
            volume: read(volume)?,
            mask,
            ..Source::default()
        };
        return Ok(Read {
            source,
            ..Read::default()
        });
    }
    let chosen = Options {
        series: options.series.clone(),
        allow_gaps: options.allow_gaps,
        ..Options::default()
    };
    let reader = DicomReader::new(Program::default(), Limits::default(), MAX_DICOM_BYTES);
    let scratch = std::env::temp_dir();
    if let Some(subject) = reader.read_subject(Input::Path(volume), &scratch).await? {
        let takes_mask = mask.is_none() && options.mask_source == MaskSource::default();
        return of_subject(subject, mask, takes_mask).await;
    }
    let reading = reader.read(Input::Path(volume), &chosen, &scratch).await?;
    tell(&reading.choice);
    let source = Source {
        volume: reading.volume().await.map_err(internal)?,
        mask,
        dicom: Some(reading.attributes),
        ..Source::default()
    };
    Ok(Read {
        source,
        images: reading.images,
        layers: Vec::new(),
    })
}

/// The files of a subject in memory, with its brain as the mask if there is no other.
async fn of_subject(
    subject: SubjectReading,
    mask: Option<Bytes>,
    takes_mask: bool,
) -> Result<Read, CliError> {
    let bytes = async |file| SubjectReading::bytes(file).await.map_err(internal);
    let mask = match subject.mask().filter(|_| takes_mask) {
        Some(own) => Some(bytes(own).await?),
        None => mask,
    };
    let mut layers = Vec::new();
    for (number, layer) in subject.layers.iter().enumerate() {
        layers.push((bytes(subject.layer(number)).await?, layer.clone()));
    }
    let source = Source {
        volume: bytes(subject.volume()).await?,
        mask,
        ..Source::default()
    };
    Ok(Read {
        source,
        layers,
        ..Read::default()
    })
}

fn internal(error: std::io::Error) -> CliError {
    CliError::new(ExitStatus::Internal, error)
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
    for file in &choice.unread {
        eprintln!(
            "an image cannot be read, file {}: {}",
            file.file, file.reason
        );
    }
    let filled = &choice.interpolated_slices;
    if !filled.is_empty() {
        eprintln!("interpolated missing slices: {filled:?}");
    }
}

/// Reports doubts about the mask and about the plane between the hemispheres on standard error.
pub(super) async fn warn_of_doubts(store: &Store, id: &CaseId) -> Result<(), CliError> {
    let case = store.case(id).await?;
    let Some(facts) = case.and_then(|case| case.facts) else {
        return Ok(());
    };
    if facts.midsagittal.doubtful {
        let correlation = facts.midsagittal.correlation;
        eprintln!(
            "isocortex: the two sides of the head are unlike (their correlation is {correlation:.2}); the plane between them may be wrong, and \
             every side is in doubt"
        );
    }
    if let Some(quality) = &facts.quality {
        for reason in &quality.reasons {
            eprintln!("isocortex: {}: {reason}", quality.state.name());
        }
    }
    Ok(())
}

/// Prepares a case with its layers; whether all of them could be added.
async fn into_store(
    library: Library,
    input: Read,
    parameters: Parameters,
    layers: Vec<LayerFile>,
) -> Result<(CaseId, Result<(), CliError>), CliError> {
    let store = library.store().clone();
    let workers = start_workers(library.clone(), 1);
    let submitted = library
        .submit_of(input.source, input.images, parameters)
        .await?;
    let id = submitted.case.id;
    let prepare = async {
        wait_until_ready(&store, &id).await?;
        let of_subject = add_subject(&store, &id, input.layers).await;
        Ok::<_, CliError>(of_subject.and(add_layers(&store, &id, layers).await))
    };
    let prepared = prepare.await;
    workers.shut_down(GRACE).await;
    let added = prepared?;
    warn_of_doubts(&store, &id).await?;
    Ok((id, added))
}

/// Shows the progress of a case until it is ready.
pub(super) async fn wait_until_ready(store: &Store, id: &CaseId) -> Result<(), CliError> {
    let display = ProgressDisplay::new();
    until_ready(store, id, |progress| display.show(progress)).await
}

/// Waits until a case is ready.
pub(super) async fn until_ready(
    store: &Store,
    id: &CaseId,
    show: impl Fn(Progress),
) -> Result<(), CliError> {
    let mut watch = store.subscribe(id);
    while let Some(case) = watch.next().await? {
        if let Some(progress) = case.progress {
            show(progress);
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
