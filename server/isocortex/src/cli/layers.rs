//! The layers of `isocortex prepare`.

use std::path::PathBuf;

use bytes::Bytes;
use case::series::Uid;
use case::{CaseId, CaseState, Contrast, Layer, LayerKind, LayerParameters, QualityState};
use cases::dicom::{DicomReader, Input, Options, Program, Purpose};
use cases::layers::{parameters_of, upload_of_subject};
use clap::Args;
use imaging::sniff;
use imaging::surface::SubjectLayer;
use pipeline::Limits;
use pipeline::layers::{LayerSource, check_layer};
use storage::{LayerName, LayerUpload, Store};

use super::status::{CliError, ExitStatus};
use super::{MAX_DICOM_BYTES, choices, head_of, read_input};

/// Further volumes of the same head.
#[derive(Debug, Args)]
pub(super) struct LayerOptions {
    /// A further volume of the same head (FLAIR, T2, PET, CT, a map or labels): NIfTI, MGH or DICOM. It is registered if it
    /// is an acquired one. Repeat it for several.
    #[arg(long = "layer", value_name = "[NAME=]VOLUME")]
    volumes: Vec<String>,
    /// What the layers are, one for each --layer. [default: from DICOM, otherwise mr]
    #[arg(long = "layer-kind", value_parser = choices::layer_kind(), value_name = "KIND", requires = "volumes")]
    kinds: Vec<LayerKind>,
    /// The units of the layers, one for each --layer. [default: from DICOM, otherwise none]
    #[arg(long = "layer-unit", value_name = "UNIT", requires = "volumes")]
    units: Vec<String>,
    /// The contrasts of the layers, one for each --layer; `none` if it is not known or not MR. The map `flair` needs `flair`. [default: from
    /// DICOM, otherwise from the name]
    #[arg(long = "layer-contrast", value_parser = choices::contrast(), value_name = "CONTRAST", requires = "volumes")]
    contrasts: Vec<Option<Contrast>>,
    /// A text file with the names of the labels of label maps: a number and a name on each line.
    #[arg(long = "layer-labels", value_name = "FILE", requires = "volumes")]
    labels: Option<PathBuf>,
}

/// A layer to be added.
pub(super) struct LayerFile {
    path: PathBuf,
    name: String,
    kind: Option<LayerKind>,
    unit: Option<String>,
    parameters: LayerParameters,
}

impl LayerFile {
    /// The FLAIR of a head.
    pub(super) fn flair(path: PathBuf) -> Self {
        Self {
            path,
            name: "FLAIR".to_owned(),
            kind: Some(LayerKind::Mr),
            unit: None,
            parameters: LayerParameters {
                contrast: Some(Contrast::Flair),
                ..LayerParameters::default()
            },
        }
    }
}

impl LayerOptions {
    /// The layers.
    ///
    /// # Errors
    /// If the options do not fit together, or the names of labels cannot be read.
    pub(super) fn layers(&self) -> Result<Vec<LayerFile>, CliError> {
        for (option, count) in [
            ("--layer-kind", self.kinds.len()),
            ("--layer-unit", self.units.len()),
            ("--layer-contrast", self.contrasts.len()),
        ] {
            if count > 0 && count != self.volumes.len() {
                let message = format!("give {option} once for each --layer, in the same order");
                return Err(CliError::new(ExitStatus::Usage, message));
            }
        }
        let labels = match &self.labels {
            Some(file) => {
                let text = read_input(file)?;
                LayerParameters::parse_labels(&String::from_utf8_lossy(&text))?
            }
            None => Default::default(),
        };
        let layer = |(number, volume): (usize, &String)| {
            let (name, path) = named(volume);
            Layer::check_name(&name)?;
            // Before the case is prepared, which takes long.
            head_of(&path)?;
            let kind = self.kinds.get(number).copied();
            let has_labels = kind == Some(LayerKind::Labels);
            Ok(LayerFile {
                path,
                name,
                kind,
                unit: self.units.get(number).cloned(),
                parameters: LayerParameters {
                    labels: if has_labels {
                        labels.clone()
                    } else {
                        Default::default()
                    },
                    contrast: self.contrasts.get(number).copied().flatten(),
                    ..LayerParameters::default()
                },
            })
        };
        self.volumes.iter().enumerate().map(layer).collect()
    }
}

/// The name and the file of a layer: `FLAIR=flair.nii.gz`, or the file alone, which gives the name.
fn named(volume: &str) -> (String, PathBuf) {
    if let Some((name, path)) = volume.split_once('=')
        && !PathBuf::from(volume).exists()
    {
        return (name.to_owned(), path.into());
    }
    let path = PathBuf::from(volume);
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let stem = name.split('.').next().unwrap_or_default();
    // `flair` is the name of a map.
    let name = match stem {
        "flair" => "FLAIR",
        other => other,
    };
    (name.to_owned(), path)
}

/// Adds layers to a case, waits for them, and reports each on standard error, also one that cannot be added.
///
/// # Errors
/// If one cannot be read or prepared; all others are added.
pub(super) async fn add_layers(
    store: &Store,
    case: &CaseId,
    layers: Vec<LayerFile>,
) -> Result<(), CliError> {
    let mut all = Ok(());
    for layer in layers {
        let name = layer.name.clone();
        let added = add_layer(store, case, layer).await;
        all = all.and(tell_added(&name, added));
    }
    all
}

/// Adds a layer to a case and waits for it.
///
/// # Errors
/// If it cannot be read or prepared.
pub(super) async fn add_layer(
    store: &Store,
    case: &CaseId,
    layer: LayerFile,
) -> Result<Layer, CliError> {
    let added = add(store, case, layer).await?;
    wait(store, added).await
}

/// The same of the layers of a FreeSurfer subject.
///
/// # Errors
/// As [`add_layers`].
pub(super) async fn add_subject(
    store: &Store,
    case: &CaseId,
    layers: Vec<(Bytes, SubjectLayer)>,
) -> Result<(), CliError> {
    let mut all = Ok(());
    for (file, layer) in layers {
        let name = layer.name.clone();
        let added = async {
            let volume = store.spools().of(file).await?;
            let upload = upload_of_subject(*case, volume, layer)?;
            wait(store, store.submit_layer(upload).await?.layer).await
        };
        all = all.and(tell_added(&name, added.await));
    }
    all
}

/// Reports a layer on standard error, or why it was not added.
fn tell_added(name: &str, added: Result<Layer, CliError>) -> Result<(), CliError> {
    match added {
        Ok(layer) => {
            tell(&layer);
            Ok(())
        }
        Err(error) => {
            eprintln!("isocortex: layer {name}: {}", error.message);
            let message = "the case is prepared, but not all of its layers could be added";
            Err(CliError::new(error.status, message))
        }
    }
}

async fn add(store: &Store, case: &CaseId, file: LayerFile) -> Result<Layer, CliError> {
    let is_dicom = file.path.is_dir() || sniff(&head_of(&file.path)?).may_be_dicom();
    let (source, series, images) = if is_dicom {
        let reader = DicomReader::new(Program::default(), Limits::default(), MAX_DICOM_BYTES);
        let options = Options {
            purpose: Purpose::Layer,
            ..Options::default()
        };
        let scratch = std::env::temp_dir();
        let reading = reader
            .read(Input::Path(&file.path), &options, &scratch)
            .await?;
        let volume = reading.volume().await;
        let volume = volume.map_err(|error| CliError::new(ExitStatus::Internal, error))?;
        let dicom = Some(reading.attributes);
        let source = LayerSource { volume, dicom };
        (source, Some(reading.choice.series), reading.images)
    } else {
        let volume = read_input(&file.path)?;
        (
            LayerSource {
                volume,
                dicom: None,
            },
            None,
            Vec::new(),
        )
    };
    let (series, name) = (series.as_ref(), Some(&*file.name));
    let parameters = parameters_of(series, name, file.kind, file.unit, file.parameters)?;
    check_layer(&source, &parameters, &Limits::default())?;
    let stated = source
        .dicom
        .as_ref()
        .map(|dicom| pipeline::attributes(dicom));
    let stated = stated.transpose()?;
    let series = stated.and_then(|stated| stated.value("SeriesInstanceUID").and_then(Uid::parse));
    let spooled = async |bytes: Option<Bytes>| match bytes {
        Some(bytes) => store.spools().of(bytes).await.map(Some),
        None => Ok(None),
    };
    let upload = LayerUpload {
        case: *case,
        volume: store.spools().of(source.volume).await?,
        dicom: spooled(source.dicom).await?,
        series,
        images,
        name: LayerName::Usual(file.name),
        parameters,
    };
    let submitted = store.submit_layer(upload).await;
    Ok(submitted?.layer)
}

/// Waits until a layer is ready.
async fn wait(store: &Store, layer: Layer) -> Result<Layer, CliError> {
    let mut watch = store.subscribe(&layer.case);
    loop {
        let now = store.layer(&layer.case, &layer.id).await?;
        let now = now.ok_or(cases::Error::NoSuchLayer)?;
        match (now.state, now.failure.clone()) {
            (CaseState::Ready, _) => return Ok(now),
            (CaseState::Failed, Some(failure)) => return Err(failure.into()),
            _ => watch.changed().await,
        }
    }
}

/// Reports the place of a layer on standard error.
fn tell(layer: &Layer) {
    let Some(facts) = &layer.facts else {
        return;
    };
    let placement = &facts.placement;
    eprintln!("layer {}: {}", layer.name, placement.origin.words());
    if let (QualityState::Review, Some(reason)) = (placement.quality, &placement.reason) {
        eprintln!("isocortex: review: layer {}: {reason}", layer.name);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_layer_is_named_by_the_user_or_its_file() {
        let named = |text| {
            let (name, path) = named(text);
            (name, path.to_string_lossy().into_owned())
        };
        let pair = |name: &str, path: &str| (name.to_owned(), path.to_owned());
        assert_eq!(named("/a/flair.nii.gz"), pair("FLAIR", "/a/flair.nii.gz"));
        assert_eq!(named("T2=/a/x.nii"), pair("T2", "/a/x.nii"));
    }
}
