//! Submits again what was uploaded after the backup from which the rows were restored: by the manifests and the images of a
//! PACS that are still among the objects, though no row names them.

use std::collections::HashMap;

use case::{CaseId, LayerId, ObjectKind};
use storage::arrivals::{ArrivalSource, Uid};
use storage::{
    LayerName, LayerUpload, Manifest, Manifested, ObjectName, Spooled, StoreError, Upload,
};

use crate::application::Cases;
use crate::arrivals::{Reception, SeriesOfUpload};
use crate::error::Error;

/// What became of the objects that no row named.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Adopted {
    pub cases: Vec<CaseId>,
    /// Layers, by their cases.
    pub layers: Vec<(CaseId, LayerId)>,
    /// Images of a PACS that were received again.
    pub images: usize,
    /// Manifests and images that stay as they are: they are damaged, or a source of theirs or the case of a layer is lost.
    pub left: Vec<ObjectName>,
}

impl Cases {
    /// Submits each manifest again that no row names, with the same ids, and receives the images of a PACS again that no row
    /// names. Run again, it finds nothing more.
    ///
    /// # Errors
    /// If the store cannot be reached.
    pub async fn adopt(&self) -> Result<Adopted, Error> {
        let store = self.store();
        store.forget_writers().await?;
        let (mut adopted, mut manifests) = (Adopted::default(), Vec::new());
        for name in store.unreferenced_of(ObjectKind::Manifest).await? {
            match store.manifest(&name).await? {
                Some(manifest) => manifests.push((name, manifest)),
                None => adopted.left.push(name),
            }
        }
        in_order(&mut manifests);
        for (name, manifest) in manifests {
            let case = manifest.case;
            match self.submit_again(manifest).await? {
                Again::Case => adopted.cases.push(case),
                Again::Layer(layer) => adopted.layers.push((case, layer)),
                Again::Known => {}
                Again::Impossible => adopted.left.push(name),
            }
        }
        for name in store.unreferenced_of(ObjectKind::Instance).await? {
            match self.receive_again(&name).await? {
                true => adopted.images += 1,
                false => adopted.left.push(name),
            }
        }
        Ok(adopted)
    }

    async fn submit_again(&self, manifest: Manifest) -> Result<Again, Error> {
        let (store, case) = (self.store(), manifest.case);
        let mut files = HashMap::new();
        for name in manifest.sources().into_iter().flatten() {
            if let Some(file) = store.spool_object(&name).await? {
                files.insert(name.kind, file);
            }
        }
        match manifest.upload {
            Manifested::Case {
                mut parameters,
                previous,
            } => {
                let Some(volume) = files.remove(&ObjectKind::SourceVolume) else {
                    return Ok(Again::Impossible);
                };
                let upload = Upload {
                    volume,
                    mask: files.remove(&ObjectKind::SourceMask),
                    dicom: files.remove(&ObjectKind::SourceDicom),
                };
                // Without its mask, or somebody's attributes, it would be another case.
                if store.id_of(&upload, &parameters) != case {
                    return Ok(Again::Impossible);
                }
                parameters.name = self.label_of(&upload).await?;
                let series = SeriesOfUpload::read(&upload).await?;
                let submitted = store.submit_after(upload, parameters, previous).await?;
                self.index(case, series).await?;
                Ok(match submitted.created {
                    true => Again::Case,
                    false => Again::Known,
                })
            }
            Manifested::Layer {
                id,
                parameters,
                name,
                series,
            } => {
                let Some(volume) = files.remove(&ObjectKind::SourceLayer) else {
                    return Ok(Again::Impossible);
                };
                let upload = LayerUpload {
                    case,
                    volume,
                    dicom: files.remove(&ObjectKind::SourceDicom),
                    series: series.as_deref().and_then(Uid::parse),
                    name: LayerName::Usual(name),
                    parameters,
                    most: usize::MAX,
                };
                if upload.id() != id {
                    return Ok(Again::Impossible);
                }
                match store.submit_layer(upload).await {
                    Ok(submitted) if submitted.created => Ok(Again::Layer(id)),
                    Ok(_) => Ok(Again::Known),
                    Err(StoreError::NoSuchCase) => Ok(Again::Impossible),
                    Err(error) => Err(error.into()),
                }
            }
        }
    }

    /// Whether an image could be received.
    async fn receive_again(&self, name: &ObjectName) -> Result<bool, Error> {
        let Some(file): Option<Spooled> = self.store().spool_object(name).await? else {
            return Ok(false);
        };
        let identity = match self.headers.read(&file).await {
            Ok(identity) => identity,
            Err(Error::Failure(_)) => return Ok(false),
            Err(error) => return Err(error),
        };
        // The file has lost the identity of its patient before it was stored, if it was to.
        let received = self.receive_as_is(vec![(identity, file)], ArrivalSource::Retrieval);
        let kept = [Reception::Stored, Reception::Corrected];
        Ok(received.await?.iter().all(|became| kept.contains(became)))
    }
}

/// What became of a manifest.
enum Again {
    Case,
    Layer(LayerId),
    /// The rows know its case or its layer by another manifest.
    Known,
    Impossible,
}

/// Puts a case before its layers, and both before the versions of the case, which inherit the layers.
fn in_order(manifests: &mut [(ObjectName, Manifest)]) {
    let previous: HashMap<CaseId, Option<CaseId>> = manifests
        .iter()
        .filter_map(|(_, manifest)| match &manifest.upload {
            Manifested::Case { previous, .. } => Some((manifest.case, *previous)),
            Manifested::Layer { .. } => None,
        })
        .collect();
    let depth = |case: CaseId| {
        let before = |case: &CaseId| previous.get(case).copied().flatten();
        // As many as there are, should two name each other.
        std::iter::successors(Some(case), before)
            .take(previous.len() + 1)
            .count()
    };
    manifests.sort_by_cached_key(|(_, manifest)| {
        let is_layer = matches!(manifest.upload, Manifested::Layer { .. });
        (depth(manifest.case), is_layer)
    });
}
