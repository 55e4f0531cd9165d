//! Layers: from an upload to objects and rows, and back.

use case::images::Image;
use case::{CaseId, Layer, LayerId, LayerParameters, MAX_LAYERS, ObjectKind};

use super::pinned::Writing;
use super::rows::{LayerName, NewLayer, Pinned};
use super::{Manifest, ObjectName, Spooled, Store, StoreError};
use case::series::Uid;

/// How often to insert a layer again that others delete meanwhile.
const ATTEMPTS: usize = 16;

/// An upload of a layer, checked.
#[derive(Debug)]
pub struct LayerUpload {
    pub case: CaseId,
    pub volume: Spooled,
    /// The identifying attributes, if it comes from DICOM.
    pub dicom: Option<Spooled>,
    /// The series that it is made of, if that is known.
    pub series: Option<Uid>,
    /// The images that it is made of, if it comes from DICOM.
    pub images: Vec<Image>,
    pub name: LayerName,
    pub parameters: LayerParameters,
}

impl LayerUpload {
    /// The id of the layer.
    pub fn id(&self) -> LayerId {
        let dicom = self.dicom.as_ref().map(Spooled::digest);
        LayerId::of(self.volume.digest(), dicom, &self.parameters)
    }

    fn manifest(&self, sources: &[Writing<'_>]) -> Manifest {
        let (LayerName::Given(name) | LayerName::Usual(name)) = &self.name;
        let sources = sources.iter().map(Writing::name);
        let (parameters, series) = (&self.parameters, self.series.as_ref());
        let images = self.images.clone();
        Manifest::of_layer(
            self.case,
            self.id(),
            sources,
            name,
            parameters,
            series,
            images,
        )
    }

    fn sources(&self) -> Vec<Writing<'_>> {
        let named = |kind, file| {
            let digest = *Spooled::digest(file);
            Writing::File(ObjectName { kind, digest }, file)
        };
        let volume = named(ObjectKind::SourceLayer, &self.volume);
        let dicom = self.dicom.as_ref();
        let dicom = dicom.map(|file| named(ObjectKind::SourceDicom, file));
        std::iter::once(volume).chain(dicom).collect()
    }
}

/// The result of the upload of a layer.
#[derive(Debug, Clone)]
pub struct SubmittedLayer {
    pub layer: Layer,
    /// Whether its preparation was queued, because it is new or had failed.
    pub created: bool,
}

impl Store {
    /// Makes a layer of a case from spooled files and queues its preparation.
    ///
    /// An existing layer is unchanged, but a failed one is queued again. The operation completes even if the caller
    /// drops the future.
    ///
    /// # Errors
    /// [`StoreError::QueueFull`], [`StoreError::NoSuchCase`], [`StoreError::TooManyLayers`],
    /// [`StoreError::LayerNameTaken`], or another error if the store fails; nothing is left behind then.
    pub async fn submit_layer(&self, upload: LayerUpload) -> Result<SubmittedLayer, StoreError> {
        let store = self.clone();
        tokio::spawn(async move { store.submit_layer_now(&upload).await }).await?
    }

    async fn submit_layer_now(&self, upload: &LayerUpload) -> Result<SubmittedLayer, StoreError> {
        let (case, id) = (upload.case, upload.id());
        let mut objects = upload.sources();
        let manifest = upload.manifest(&objects).framed()?;
        objects.push(Writing::Framed(&manifest));
        let insert = |sources: Pinned| async move {
            let new = NewLayer {
                case,
                id,
                name: upload.name.clone(),
                parameters: upload.parameters.clone(),
                series: upload.series.clone(),
                images: upload.images.clone(),
                sources,
                most: MAX_LAYERS,
                queue_limit: self.options().queue_limit,
                client: self.client.to_string(),
            };
            self.insert_layer(&new).await
        };
        for _ in 0..ATTEMPTS {
            let created = self.with_pinned(&objects, &insert).await?;
            if created {
                self.signals().queued();
                self.signals().changed(&case);
            }
            // If another process deletes it at this moment, it is inserted again.
            if let Some(layer) = self.layer(&case, &id).await? {
                return Ok(SubmittedLayer { layer, created });
            }
        }
        Err(StoreError::Rows(
            "a layer was deleted repeatedly while it was uploaded".into(),
        ))
    }
}
