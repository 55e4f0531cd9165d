//! Layers: from an upload to objects and rows, and back.

use bytes::Bytes;
use case::images::Image;
use case::{CaseId, Layer, LayerFacts, LayerId, LayerParameters, ObjectKind};

use super::jobs::Claim;
use super::pinned::Writing;
use super::rows::{LayerName, NewLayer, Pinned, Published};
use super::{Framed, Manifest, ObjectName, Spooled, Store, StoreError, Unreadable};
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
    /// How many layers a case may have.
    pub most: usize,
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
                most: upload.most,
                queue_limit: self.options().queue_limit,
                client: self.client.to_string(),
            };
            self.insert_layer(&new).await
        };
        for _ in 0..ATTEMPTS {
            let created = self.with_pinned(&objects, &insert).await?.is_queued();
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

    /// A layer of a case.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn layer(&self, case: &CaseId, id: &LayerId) -> Result<Option<Layer>, StoreError> {
        let layers = self.layers(case).await?;
        Ok(layers.into_iter().find(|layer| layer.id == *id))
    }

    /// Removes a layer and the objects that nothing else needs; `false` if it did not exist. The operation completes
    /// even if the caller drops the future.
    ///
    /// # Errors
    /// If the rows or the objects cannot be written. The layer may have been removed even so; its objects are then
    /// removed later.
    pub async fn delete_layer(&self, case: &CaseId, id: &LayerId) -> Result<bool, StoreError> {
        let (store, case, id) = (self.clone(), *case, *id);
        let delete = async move {
            store.check_id().await?;
            let deleted = store.delete_layer_row(&case, &id).await?;
            if deleted {
                store.signals().changed(&case);
                store.collect().await?;
            }
            Ok(deleted)
        };
        tokio::spawn(delete).await?
    }

    /// The payload of an object of a layer; `None`, reported, if it is damaged, or missing and derived.
    ///
    /// # Errors
    /// [`StoreError::SourceMissing`] if it was uploaded and is missing, or if the store cannot be reached.
    pub async fn read_layer(
        &self,
        case: &CaseId,
        id: &LayerId,
        kind: ObjectKind,
    ) -> Result<Option<Bytes>, StoreError> {
        let names = self.layer_objects(case, id).await?;
        let Some(name) = names.iter().find(|name| name.kind == kind) else {
            return Ok(None);
        };
        match self.objects().get(name).await {
            Ok(payload) => Ok(Some(payload)),
            Err(Unreadable::Store(error)) => Err(error.into()),
            Err(fault) => {
                // One that is missing because the layer was deleted a moment ago is no fault.
                let names = self.layer_objects(case, id).await?;
                if names.contains(name) {
                    self.report_unreadable(kind, &fault)?;
                }
                Ok(None)
            }
        }
    }

    /// Makes what is computed from a layer that is ready durable, and gives it to the layer, with which it is deleted.
    ///
    /// # Errors
    /// If the store cannot be reached.
    pub async fn publish_of_layer(
        &self,
        case: &CaseId,
        id: &LayerId,
        derived: &[Framed],
    ) -> Result<Published, StoreError> {
        let objects: Vec<_> = derived.iter().map(Writing::Framed).collect();
        let publish =
            |derived: Pinned| async move { self.refer_to_layer(case, id, &derived).await };
        self.with_pinned(&objects, publish).await
    }

    /// Makes the objects of a layer durable, then publishes them and ends its job in one transaction. Leaves nothing
    /// behind if that fails.
    ///
    /// # Errors
    /// If the store cannot be reached.
    pub async fn publish_layer(
        &self,
        claim: &Claim,
        derived: &[Framed],
        facts: &LayerFacts,
    ) -> Result<Published, StoreError> {
        let objects: Vec<_> = derived.iter().map(Writing::Framed).collect();
        let publish =
            |derived: Pinned| async move { self.make_layer_ready(claim, &derived, facts).await };
        let published = self.with_pinned(&objects, publish).await?;
        self.job_changed(claim);
        Ok(published)
    }
}
