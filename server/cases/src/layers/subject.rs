//! The folder of a FreeSurfer subject: a case, and its layers.

use std::collections::BTreeMap;

use case::{CaseId, Failure, Layer, LayerKind, LayerParameters, SurfaceFacts};
use imaging::surface::{Drawn, SubjectLayer, subject_files, subject_folder};
use imaging::{Format, START_BYTES, sniff};
use storage::{LayerName, LayerUpload, Spooled};

use crate::application::Cases;
use crate::dicom::{Input, flat_name};
use crate::error::Error;
use crate::intake::VolumeFiles;

/// The received files of a subject.
#[derive(Debug)]
pub struct ReceivedSubject {
    pub volume: Spooled,
    pub mask: Option<Spooled>,
    /// Its layers, each with its file.
    pub layers: Vec<(Spooled, SubjectLayer)>,
}

/// What is known of a layer that was drawn.
pub(super) fn facts_of(drawn: &Drawn) -> SurfaceFacts {
    SurfaceFacts {
        vertices: drawn.vertices,
        triangles: drawn.triangles,
        thickness_mm: drawn.thickness_mm,
    }
}

/// A layer of a subject, as it is added to its case. If a map or another layer of the case has its name, it gets another one.
///
/// # Errors
/// If its name, unit or labels are unusable.
pub fn upload_of_subject(
    case: CaseId,
    volume: Spooled,
    layer: SubjectLayer,
) -> Result<LayerUpload, Failure> {
    let (kind, labels) = match layer.are_labels {
        true => (
            LayerKind::Labels,
            LayerParameters::fitting_labels(layer.names),
        ),
        false => (LayerKind::Map, BTreeMap::new()),
    };
    let parameters = LayerParameters {
        kind,
        unit: layer.unit,
        labels,
        surface: layer.drawn.as_ref().map(facts_of),
        ..LayerParameters::default()
    };
    // `thickness` is a map of every case.
    let name = match Layer::check_name(&layer.name) {
        Ok(()) => layer.name,
        Err(_) => format!("surface {}", layer.name),
    };
    Layer::check_name(&name)?;
    parameters.check()?;
    Ok(LayerUpload {
        case,
        volume,
        dicom: None,
        series: None,
        images: Vec::new(),
        name: LayerName::Usual(name),
        parameters,
    })
}

impl Cases {
    /// Reads the folder of a FreeSurfer subject, which is in a zip or has [`flat_name`]s; `None` if the files are something else.
    ///
    /// # Errors
    /// As [`DicomReader::read_subject`](crate::dicom::DicomReader::read_subject), or an error of the store.
    pub async fn subject(&self, files: &VolumeFiles) -> Result<Option<ReceivedSubject>, Error> {
        let input = match files {
            VolumeFiles::One(file) => {
                let is_zip = sniff(&file.head(START_BYTES).await?) == Format::Zip;
                is_zip.then_some(Input::Spooled(file))
            }
            VolumeFiles::Dicom(folder) => {
                let is_volume = |name: &String| subject_folder(name) == Some("");
                let mut volumes = subject_files().filter(is_volume);
                let is_there = |name: String| folder.path().join(flat_name(&name)).exists();
                volumes.any(is_there).then_some(Input::Directory(folder))
            }
        };
        let Some(input) = input else {
            return Ok(None);
        };
        let spools = self.store().spools();
        let scratch = spools.path();
        let reading = self.dicom.read_subject(input, &scratch);
        let Some(reading) = reading.await? else {
            return Ok(None);
        };
        let mut layers = Vec::new();
        for (number, layer) in reading.layers.iter().enumerate() {
            layers.push((spools.take(reading.layer(number)).await?, layer.clone()));
        }
        Ok(Some(ReceivedSubject {
            volume: spools.take(reading.volume()).await?,
            mask: match reading.mask() {
                Some(mask) => Some(spools.take(mask).await?),
                None => None,
            },
            layers,
        }))
    }

    /// Adds the layers of a subject to its case. Those that are there already stay as they are.
    ///
    /// # Errors
    /// As [`Cases::add_layer`].
    pub async fn add_subject(
        &self,
        case: &CaseId,
        layers: Vec<(Spooled, SubjectLayer)>,
    ) -> Result<(), Error> {
        for (volume, layer) in layers {
            let upload = upload_of_subject(*case, volume, layer)?;
            if self.store().layer(case, &upload.id()).await?.is_none() {
                self.check_layer(&upload).await?;
                self.store_of_client().submit_layer(upload).await?;
            }
        }
        Ok(())
    }
}
