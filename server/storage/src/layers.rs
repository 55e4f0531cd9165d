//! Layers: from an upload to objects and rows, and back.

use bytes::Bytes;
use case::{CaseId, Failure, Layer, LayerFacts, LayerId, LayerParameters, ObjectKind};

use super::rows::{
    ChangedLayer, InsertedLayer, LayerChange, LayerClaim, LayerName, NewLayer, Pinned, Published,
};
use super::{Framed, ObjectName, PIN_ATTEMPTS, Spooled, Store, StoreError, Unreadable};

/// An upload of a layer, checked.
#[derive(Debug)]
pub struct LayerUpload {
    /// The case.
    pub case: CaseId,
    /// The volume.
    pub volume: Spooled,
    /// The identifying attributes, if it comes from DICOM.
    pub dicom: Option<Spooled>,
    /// The name.
    pub name: LayerName,
    /// The parameters.
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

    fn sources(&self) -> Vec<(ObjectName, &Spooled)> {
        let named = |kind, file| {
            let digest = *Spooled::digest(file);
            (ObjectName { kind, digest }, file)
        };
        let volume = named(ObjectKind::SourceLayer, &self.volume);
        let dicom = self.dicom.as_ref();
        let dicom = dicom.map(|file| named(ObjectKind::SourceDicom, file));
        std::iter::once(volume).chain(dicom).collect()
    }
}

/// The result of the upload of a layer.
#[derive(Debug, Clone)]
pub enum SubmittedLayer {
    /// The layer, and whether its preparation was queued, because it is new or had failed.
    Layer {
        /// The layer.
        layer: Box<Layer>,
        /// Whether it was queued.
        created: bool,
    },
    /// There is no such case.
    NoCase,
    /// The case has as many layers as it may have.
    TooMany,
    /// Another layer of the case has the name.
    NameTaken,
}

impl Store {
    /// Makes a layer of a case from spooled files and queues its preparation.
    ///
    /// An existing layer is unchanged, but a failed one is queued again. The operation completes even if the caller
    /// drops the future.
    ///
    /// # Errors
    /// [`StoreError::QueueFull`], or another error if the store fails; nothing is left behind then.
    pub async fn submit_layer(&self, upload: LayerUpload) -> Result<SubmittedLayer, StoreError> {
        let store = self.clone();
        tokio::spawn(async move { store.submit_layer_now(&upload).await }).await?
    }

    async fn submit_layer_now(&self, upload: &LayerUpload) -> Result<SubmittedLayer, StoreError> {
        let (case, id) = (upload.case, upload.id());
        for _ in 0..PIN_ATTEMPTS {
            let sources = upload.sources();
            let pinned = self.pin(sources.iter().map(|(name, _)| *name)).await?;
            let inserted = self.write_layer(upload, &sources, &pinned).await;
            let created = matches!(
                inserted,
                Ok(InsertedLayer::Created | InsertedLayer::Requeued)
            );
            if created {
                self.signals().queued();
                self.signals().changed(&case);
            } else {
                self.abandon(&pinned).await;
            }
            match inserted? {
                InsertedLayer::Created | InsertedLayer::Requeued | InsertedLayer::Exists => {
                    // If another process deletes it at this moment, it is inserted again.
                    if let Some(layer) = self.layer(&case, &id).await? {
                        let layer = Box::new(layer);
                        return Ok(SubmittedLayer::Layer { layer, created });
                    }
                }
                InsertedLayer::PinLost => {}
                InsertedLayer::NoCase => return Ok(SubmittedLayer::NoCase),
                InsertedLayer::TooMany => return Ok(SubmittedLayer::TooMany),
                InsertedLayer::NameTaken => return Ok(SubmittedLayer::NameTaken),
                InsertedLayer::QueueFull => return Err(StoreError::QueueFull),
            }
        }
        Err(StoreError::Rows(
            "an object was removed repeatedly while it was written".into(),
        ))
    }

    async fn write_layer(
        &self,
        upload: &LayerUpload,
        sources: &[(ObjectName, &Spooled)],
        pinned: &Pinned,
    ) -> Result<InsertedLayer, StoreError> {
        for (name, file) in sources {
            self.objects().put_file(name, file).await?;
        }
        let new = NewLayer {
            case: upload.case,
            id: upload.id(),
            name: upload.name.clone(),
            parameters: upload.parameters.clone(),
            sources: pinned.clone(),
            most: upload.most,
            queue_limit: self.options().queue_limit,
        };
        self.insert_layer(&new).await
    }

    /// A layer of a case.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn layer(&self, case: &CaseId, id: &LayerId) -> Result<Option<Layer>, StoreError> {
        let layers = self.layers(case).await?;
        Ok(layers.into_iter().find(|layer| layer.id == *id))
    }

    /// Renames a layer, or moves it in the list.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub async fn change_layer(
        &self,
        case: &CaseId,
        id: &LayerId,
        change: &LayerChange,
    ) -> Result<ChangedLayer, StoreError> {
        let changed = self.change_layer_row(case, id, change).await?;
        self.signals().changed(case);
        Ok(changed)
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
            let deleted = store.delete_layer_row(&case, &id).await?;
            if deleted {
                store.signals().changed(&case);
                store.collect().await?;
            }
            Ok(deleted)
        };
        tokio::spawn(delete).await?
    }

    /// Makes a layer failed, if the lease is still ours, and removes its files; returns whether it was. To try again, the
    /// files must be sent again.
    ///
    /// # Errors
    /// If the rows or the objects cannot be written. The layer may have failed even so; its objects are then removed
    /// later.
    pub async fn fail_layer(
        &self,
        claim: &LayerClaim,
        failure: &Failure,
    ) -> Result<bool, StoreError> {
        let is_ours = self.make_layer_failed(claim, failure).await?;
        if is_ours {
            self.collect().await?;
        }
        Ok(is_ours)
    }

    /// The payload of an object of a layer; `None`, reported, if it is missing or damaged.
    ///
    /// # Errors
    /// If the store cannot be reached.
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
                    self.report_bad(kind, &fault.to_string());
                }
                Ok(None)
            }
        }
    }

    /// Makes the objects of a layer durable, then publishes them in one transaction. Leaves nothing behind if that
    /// fails.
    ///
    /// # Errors
    /// If the store cannot be reached.
    pub async fn publish_layer(
        &self,
        claim: &LayerClaim,
        derived: &[Framed],
        facts: &LayerFacts,
    ) -> Result<Published, StoreError> {
        for _ in 0..PIN_ATTEMPTS {
            let pinned = self.pin(derived.iter().map(|framed| framed.name)).await?;
            let publish = async {
                for framed in derived {
                    self.objects().put(framed).await?;
                }
                self.make_layer_ready(claim, &pinned, facts).await
            };
            let published = publish.await;
            if !matches!(published, Ok(Published::Done)) {
                self.abandon(&pinned).await;
            }
            match published? {
                Published::PinLost => {}
                settled => return Ok(settled),
            }
        }
        Err(StoreError::Rows(
            "an object was removed repeatedly while it was written".into(),
        ))
    }
}
