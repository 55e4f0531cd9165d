//! Manifests: what is needed to submit an upload again, as an object beside its sources.
//!
//! If the rows are restored from a backup, the objects of later uploads are still there, and their manifests say what they
//! are. A manifest has no label of the case and nothing that changes after the upload. It is written and deleted as the
//! other objects of its case or layer; a deletion removes it before the sources, so that nothing brings back what was deleted.

use bytes::Bytes;
use case::images::Image;
use case::{CaseId, LayerId, LayerParameters, ObjectKind, Parameters};
use serde::{Deserialize, Serialize};

use super::pinned::Writing;
use super::rows::{LayerName, Made, NewCase, NewLayer, Owner, Pinned, Referred};
use super::sql::{cases, layers, made, pins};
use super::{Framed, ObjectName, Spooled, Store, StoreError, Unreadable, frame};
use case::series::Uid;

/// What was uploaded.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// The case, or the one that the layer was added to.
    pub case: CaseId,
    /// The names of the source objects.
    sources: Vec<String>,
    pub upload: Manifested,
}

/// A case or a layer, but for its files.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Manifested {
    Case {
        /// Without the label.
        parameters: Parameters,
        /// The case of which it is a version.
        previous: Option<CaseId>,
        images: Vec<Image>,
    },
    Layer {
        id: LayerId,
        parameters: LayerParameters,
        /// The name that it was uploaded with.
        name: String,
        /// The series that it is made of, if that is known.
        series: Option<String>,
        images: Vec<Image>,
    },
}

impl Manifest {
    /// That of a case with these objects.
    pub(crate) fn of_case(
        case: CaseId,
        objects: impl IntoIterator<Item = ObjectName>,
        parameters: &Parameters,
        previous: Option<CaseId>,
        images: Vec<Image>,
    ) -> Self {
        let parameters = Parameters {
            name: None,
            ..parameters.clone()
        };
        let upload = Manifested::Case {
            parameters,
            previous,
            images,
        };
        Self::new(case, objects, upload)
    }

    /// That of a layer with these objects.
    pub(crate) fn of_layer(
        case: CaseId,
        id: LayerId,
        objects: impl IntoIterator<Item = ObjectName>,
        name: &str,
        parameters: &LayerParameters,
        series: Option<&Uid>,
        images: Vec<Image>,
    ) -> Self {
        let upload = Manifested::Layer {
            id,
            parameters: parameters.clone(),
            name: name.to_owned(),
            series: series.map(|series| series.as_str().to_owned()),
            images,
        };
        Self::new(case, objects, upload)
    }

    fn new(
        case: CaseId,
        objects: impl IntoIterator<Item = ObjectName>,
        upload: Manifested,
    ) -> Self {
        let sources = objects.into_iter().filter(|name| name.kind.is_source());
        let mut sources: Vec<_> = sources.map(|name| name.to_string()).collect();
        sources.sort();
        Self {
            case,
            sources,
            upload,
        }
    }

    /// The source objects; `None` if one has no name.
    pub fn sources(&self) -> Option<Vec<ObjectName>> {
        let parse = |name: &String| {
            let (kind, digest) = name.split_once('/')?;
            ObjectName::parse(kind, digest)
        };
        self.sources.iter().map(parse).collect()
    }

    /// It as an object.
    pub(crate) fn framed(&self) -> Result<Framed, StoreError> {
        let json = Bytes::from(serde_json::to_vec(self)?);
        Ok(frame(ObjectKind::Manifest, json))
    }
}

impl Store {
    /// A stored manifest; `None`, reported, if it is missing or damaged.
    ///
    /// # Errors
    /// If the store cannot be reached.
    pub async fn manifest(&self, name: &ObjectName) -> Result<Option<Manifest>, StoreError> {
        let read = match self.object(name).await {
            Ok(json) => serde_json::from_slice(&json).ok(),
            Err(Unreadable::Store(error)) => return Err(error.into()),
            Err(_) => None,
        };
        if read.is_none() {
            self.report_bad(ObjectKind::Manifest, "it cannot be read");
        }
        Ok(read)
    }

    /// The objects of a kind that nothing refers to and no process is about to refer to.
    ///
    /// # Errors
    /// If the store cannot be reached.
    pub async fn unreferenced_of(&self, kind: ObjectKind) -> Result<Vec<ObjectName>, StoreError> {
        let listed = self.objects().list().await?.into_iter();
        let listed: Vec<_> = listed.filter(|name| name.kind == kind).collect();
        self.unneeded(&listed).await
    }

    /// An object as a file, for another submission; `None` if it is missing or damaged.
    ///
    /// # Errors
    /// If the store cannot be reached, or the disk fails.
    pub async fn spool_object(&self, name: &ObjectName) -> Result<Option<Spooled>, StoreError> {
        match self.object(name).await {
            Ok(bytes) => self.spools().of(bytes).await.map(Some),
            Err(Unreadable::Store(error)) => Err(error.into()),
            Err(_) => Ok(None),
        }
    }

    /// Makes a case, with this label, or a layer of the sources of a manifest that no row names, and queues it; `false` if it is there. The
    /// sources must have been read. Nothing is written but rows, and by one transaction, so that nothing is removed if it fails.
    ///
    /// # Errors
    /// If the rows cannot be written, or one of the objects is being removed; [`StoreError::NoSuchCase`] for a layer.
    pub async fn adopt(
        &self,
        name: &ObjectName,
        manifest: &Manifest,
        label: Option<String>,
    ) -> Result<bool, StoreError> {
        let objects = manifest.sources().unwrap_or_default().into_iter();
        let sources = Pinned::new(objects.chain([*name]));
        let (mut transaction, now) = self.write().await?;
        pins::hold(&mut transaction, &sources, now).await?;
        let inserted = match manifest.upload.clone() {
            Manifested::Case {
                parameters,
                previous,
                images,
            } => {
                let new = NewCase {
                    id: manifest.case,
                    parameters: Parameters {
                        name: label,
                        ..parameters
                    },
                    previous,
                    images: Some(images),
                    sources,
                    queue_limit: usize::MAX,
                    client: String::new(),
                };
                cases::submit(&mut transaction, &new, now).await?
            }
            Manifested::Layer {
                id,
                parameters,
                name,
                series,
                images,
            } => {
                let new = NewLayer {
                    case: manifest.case,
                    id,
                    name: LayerName::Usual(name),
                    parameters,
                    series: series.as_deref().and_then(Uid::parse),
                    images,
                    sources,
                    most: usize::MAX,
                    queue_limit: usize::MAX,
                    client: String::new(),
                };
                layers::submit(&mut transaction, &new, now).await?
            }
        };
        let is_inserted = matches!(inserted, Referred::Done(_));
        if is_inserted {
            transaction.commit().await?;
            self.signals().queued();
        }
        Ok(is_inserted)
    }

    /// Writes the manifests of a case and its layers again that are missing or damaged.
    ///
    /// # Errors
    /// If the store cannot be reached.
    pub async fn restore_manifests(&self, id: &CaseId) -> Result<(), StoreError> {
        let Some(case) = self.case(id).await? else {
            return Ok(());
        };
        let objects = self.objects_of(id).await?;
        if !self.has_manifest(&objects).await? {
            let images = made::of(&mut self.connect().await?, &Made::case(id)).await?;
            let manifest = Manifest::of_case(*id, objects, &case.parameters, case.previous, images);
            self.put_manifest(id.into(), &manifest).await?;
        }
        for layer in self.layers(id).await? {
            let owner = Owner::from((id, &layer.id));
            let objects = self.objects_of(owner).await?;
            if self.has_manifest(&objects).await? {
                continue;
            }
            let series = self.series_of_layer(id, &layer.id).await?;
            let made = Made::layer(id, &layer.id);
            let images = made::of(&mut self.connect().await?, &made).await?;
            let manifest = Manifest::of_layer(
                *id,
                layer.id,
                objects,
                &layer.name,
                &layer.parameters,
                series.as_ref(),
                images,
            );
            self.put_manifest(owner, &manifest).await?;
        }
        Ok(())
    }

    async fn has_manifest(&self, objects: &[ObjectName]) -> Result<bool, StoreError> {
        let mut manifests = objects.iter();
        match manifests.find(|name| name.kind == ObjectKind::Manifest) {
            Some(name) => Ok(self.manifest(name).await?.is_some()),
            None => Ok(false),
        }
    }

    async fn put_manifest(&self, owner: Owner, manifest: &Manifest) -> Result<(), StoreError> {
        let framed = manifest.framed()?;
        let refer = |pinned: Pinned| async move { self.refer(owner, &pinned, false).await };
        let put = self.with_pinned(&[Writing::Framed(&framed)], refer).await;
        put.map(drop)
    }
}
