//! Further volumes of the head of a case: submitted, listed, changed and deleted.

mod subject;
mod surfaces;

pub use subject::{ReceivedSubject, upload_of_subject};
pub use surfaces::ReceivedSurfaces;

use case::{
    CaseId, CaseState, Contrast, Failure, Layer, LayerChange, LayerId, LayerKind, LayerParameters,
    MapName,
};
use imaging::START_BYTES;
use pipeline::layers::{LayerSource, check_layer};
use storage::{LayerName, LayerUpload, SubmittedLayer};

use crate::application::Cases;
use crate::dicom::{Choice, Options, SeriesSummary};
use crate::error::Error;
use crate::intake::VolumeFiles;
use crate::pictures::{ChosenLayer, LayerRef};

/// A layer to be added, with its received files.
#[derive(Debug)]
pub struct ReceivedLayer {
    pub case: CaseId,
    /// The files of the volume.
    pub volume: VolumeFiles,
    /// The choice among DICOM files.
    pub options: Options,
    /// The name; by default the DICOM sequence, or the kind.
    pub name: Option<String>,
    /// What the values are; by default the modality of DICOM files, otherwise MR.
    pub kind: Option<LayerKind>,
    /// The unit; by default that of DICOM files, or none.
    pub unit: Option<String>,
    /// The other parameters. Without a contrast, it is that of DICOM files, or the one that the name states.
    pub parameters: LayerParameters,
}

/// The parameters of a layer: its kind, unit and contrast as stated, otherwise those of its DICOM series. Without a series, the
/// name may state the contrast.
///
/// # Errors
/// If they do not fit together.
pub fn parameters_of(
    series: Option<&SeriesSummary>,
    name: Option<&str>,
    kind: Option<LayerKind>,
    unit: Option<String>,
    others: LayerParameters,
) -> Result<LayerParameters, Failure> {
    let kind = kind.or(series.map(|series| LayerKind::of_modality(&series.modality)));
    let unit = unit.or(series.and_then(|series| series.unit.clone()));
    let kind = kind.unwrap_or_default();
    let told = series.map(|series| series.name.as_str()).or(name);
    let told = told.and_then(Contrast::of_name);
    let parameters = LayerParameters {
        kind,
        unit: unit.unwrap_or_default(),
        contrast: others.contrast.or(told.filter(|_| kind == LayerKind::Mr)),
        ..others
    };
    parameters.check()?;
    Ok(parameters)
}

/// A picture of the case with the layer would show one patient under the name of another.
fn of_another_patient() -> Failure {
    Failure::unusable(
        "layer-of-another-patient",
        "the volume is of another patient than the case, according to patient id, issuer and date of birth; add it to a case of its own patient",
    )
}

impl Cases {
    /// Checks a layer and queues it; returns also the choice among DICOM files. One that is there already is answered as it is.
    ///
    /// # Errors
    /// [`Error::Failure`] that states what is wrong with the upload or why the case failed; [`Error::NoSuchCase`], [`Error::Busy`], or an error of the store.
    pub async fn add_layer(
        &self,
        new: ReceivedLayer,
    ) -> Result<(SubmittedLayer, Option<Choice>), Error> {
        let (is_removed, case) = (self.deidentifies(), new.case.short());
        let (added, choice) = self.add_layer_of(new, is_removed).await?;
        tracing::info!(case, is_new = added.created, "a layer was accepted");
        Ok((added, choice))
    }

    /// As [`Cases::add_layer`], whether or not the identity of the patient is removed.
    ///
    /// # Errors
    /// As [`Cases::add_layer`].
    pub async fn add_layer_of(
        &self,
        new: ReceivedLayer,
        is_identity_removed: bool,
    ) -> Result<(SubmittedLayer, Option<Choice>), Error> {
        if let Some(name) = &new.name {
            Layer::check_name(name)?;
        }
        let case = self.case(&new.case).await?;
        if let (CaseState::Failed, Some(failure)) = (case.state, case.failure) {
            return Err(failure.into());
        }
        let (files, choice) = self
            .read_upload(new.volume, None, &new.options, is_identity_removed)
            .await?;
        if self.is_of_patient(&files, &new.case).await? == Some(false) {
            return Err(of_another_patient().into());
        }
        let has_options = new.options.series.is_some() || new.options.allow_gaps;
        if choice.is_none() && has_options {
            return Err(Error::Parameter {
                kind: "parameters-unreadable",
                name: "series".into(),
                detail: "and `allow_gaps` are only accepted for DICOM files".to_owned(),
            });
        }
        let series = choice.as_ref().map(|choice| &choice.series);
        let name = new.name.as_deref();
        let parameters = parameters_of(series, name, new.kind, new.unit, new.parameters)?;
        let usual = || match series.map(|series| series.name.as_str()) {
            Some(name) if !name.is_empty() => name.to_owned(),
            _ => parameters.kind.name().to_owned(),
        };
        let upload = LayerUpload {
            case: new.case,
            volume: files.volume,
            dicom: files.dicom,
            series: files.series.map(|series| series.uids.series),
            images: files.images,
            name: new
                .name
                .map_or_else(|| LayerName::Usual(usual()), LayerName::Given),
            parameters: parameters.clone(),
        };
        let known = self.store().layer(&upload.case, &upload.id()).await?;
        if known.is_none() {
            self.check_layer(&upload).await?;
        }
        let submitted = self.store_of_client().submit_layer(upload).await?;
        Ok((submitted, choice))
    }

    /// Rejects what cannot be a layer, before anything is stored.
    async fn check_layer(&self, upload: &LayerUpload) -> Result<(), Error> {
        let start = upload.volume.head(START_BYTES).await?;
        let _room = self.checks.enter_layer(&start).await?;
        let source = LayerSource {
            volume: upload.volume.read().await?,
            dicom: None,
        };
        let (limits, parameters) = (self.library.limits(), upload.parameters.clone());
        let check = move || check_layer(&source, &parameters, &limits);
        Ok(self.queue.run(check).await??)
    }

    /// The layers of a case, in their order.
    ///
    /// # Errors
    /// [`Error::NoSuchCase`], or an error of the store.
    pub async fn layers(&self, case: &CaseId) -> Result<Vec<Layer>, Error> {
        let layers = self.store().layers(case).await?;
        if layers.is_empty() {
            self.case(case).await?;
        }
        Ok(layers)
    }

    /// A map of a case. That of a FLAIR is another one once another layer is the newest.
    ///
    /// # Errors
    /// As [`Cases::layers`].
    pub async fn map(&self, case: &CaseId, name: MapName) -> Result<ChosenLayer, Error> {
        let layers = match name {
            MapName::Flair => self.layers(case).await?,
            _ => Vec::new(),
        };
        Ok(ChosenLayer::of_map(name, &layers))
    }

    /// An uploaded layer of a case by its name or id.
    ///
    /// # Errors
    /// [`Error::NoSuchCase`], [`Error::NoSuchLayer`], or an error of the store.
    pub async fn layer(&self, case: &CaseId, name: &LayerRef) -> Result<Layer, Error> {
        match name.of(&self.layers(case).await?)? {
            crate::pictures::ChosenLayer::Layer(layer) => Ok((*layer).clone()),
            crate::pictures::ChosenLayer::Map { .. } => Err(Error::NoSuchLayer),
        }
    }

    /// Renames a layer, moves it in the list, or states its contrast; returns it as it is then.
    ///
    /// # Errors
    /// [`Error::Failure`] if the name or the contrast is unusable, [`Error::NoSuchLayer`], or an error of
    /// the store.
    pub async fn change_layer(
        &self,
        case: &CaseId,
        id: &LayerId,
        change: &LayerChange,
    ) -> Result<Layer, Error> {
        if let Some(name) = &change.name {
            Layer::check_name(name)?;
        }
        if change.contrast.is_some() {
            let known = self.store().layer(case, id).await?;
            let known = known.ok_or(Error::NoSuchLayer)?;
            let contrast = change.contrast;
            LayerParameters {
                contrast,
                ..known.parameters
            }
            .check()?;
        }
        if !self.store().change_layer(case, id, change).await? {
            return Err(Error::NoSuchLayer);
        }
        let changed = self.store().layer(case, id).await?;
        changed.ok_or(Error::NoSuchLayer)
    }

    /// Removes a layer.
    ///
    /// # Errors
    /// [`Error::NoSuchLayer`], or an error of the store.
    pub async fn delete_layer(&self, case: &CaseId, id: &LayerId) -> Result<(), Error> {
        match self.store().delete((case, id)).await? {
            true => Ok(()),
            false => Err(Error::NoSuchLayer),
        }
    }
}
