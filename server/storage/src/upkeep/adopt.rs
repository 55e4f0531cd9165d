//! Finds uploads that no row names, by their manifests, and enters them again.

use case::series::{CaseSeries, Uid};
use case::{CaseId, ObjectKind, Parameters};

use crate::manifest::{Manifest, Manifested};
use crate::rows::{LayerName, Made, NewCase, NewLayer, Owner, Pinned, Referred, Relabel};
use crate::sql::{cases, layers, made, pins};
use crate::tables::Writing;
use crate::{ObjectName, Spooled, Store, StoreError, Unreadable};

/// A stored manifest; `None`, reported, if it is missing or damaged.
///
/// # Errors
/// If the store cannot be reached.
pub async fn manifest(store: &Store, name: &ObjectName) -> Result<Option<Manifest>, StoreError> {
    let read = match store.object(name).await {
        Ok(json) => serde_json::from_slice(&json).ok(),
        Err(Unreadable::Store(error)) => return Err(error.into()),
        Err(_) => None,
    };
    if read.is_none() {
        store.report_bad(ObjectKind::Manifest, "it cannot be read");
    }
    Ok(read)
}

/// The objects of a kind that nothing refers to and no process is about to refer to.
///
/// # Errors
/// If the store cannot be reached.
pub async fn unreferenced_of(
    store: &Store,
    kind: ObjectKind,
) -> Result<Vec<ObjectName>, StoreError> {
    let listed = store.objects().list().await?.into_iter();
    let listed: Vec<_> = listed.filter(|name| name.kind == kind).collect();
    store.unneeded(&listed).await
}

/// An object as a file, for another submission; `None` if it is missing or damaged.
///
/// # Errors
/// If the store cannot be reached, or the disk fails.
pub async fn spool_object(store: &Store, name: &ObjectName) -> Result<Option<Spooled>, StoreError> {
    match store.object(name).await {
        Ok(bytes) => store.spools().of(bytes).await.map(Some),
        Err(Unreadable::Store(error)) => Err(error.into()),
        Err(_) => Ok(None),
    }
}

/// Makes a case, with this label and of this series, or a layer of the sources of a manifest that no row names, and queues it; `false` if it is there. The
/// sources must have been read. Nothing is written but rows, and by one transaction, so that nothing is removed if it fails.
///
/// # Errors
/// If the rows cannot be written, or one of the objects is being removed; [`StoreError::NoSuchCase`] for a layer.
pub async fn adopt(
    store: &Store,
    name: &ObjectName,
    manifest: &Manifest,
    label: Option<String>,
    series: Option<CaseSeries>,
) -> Result<bool, StoreError> {
    let objects = manifest.sources().unwrap_or_default().into_iter();
    let sources = Pinned::new(objects.chain([*name]));
    let (mut transaction, now) = store.write().await?;
    pins::hold(&mut transaction, &sources, now).await?;
    let is_inserted = match manifest.upload.clone() {
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
                series,
                relabel: Relabel::None,
                sources,
                queue_limit: usize::MAX,
                client: String::new(),
            };
            let submitted = cases::submit(&mut transaction, &new, now).await?;
            matches!(submitted, Referred::Done(_))
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
            let submitted = layers::submit(&mut transaction, &new, now).await?;
            matches!(submitted, Referred::Done(_))
        }
    };
    if is_inserted {
        transaction.commit().await?;
        store.signals().queued();
    }
    Ok(is_inserted)
}

/// Writes the manifests of a case and its layers again that are missing or damaged.
///
/// # Errors
/// If the store cannot be reached.
pub async fn restore_manifests(store: &Store, id: &CaseId) -> Result<(), StoreError> {
    let Some(case) = store.case(id).await? else {
        return Ok(());
    };
    let objects = store.objects_of(id).await?;
    if !has_manifest(store, &objects).await? {
        let images = made::of(&mut store.connect().await?, &Made::case(id)).await?;
        let manifest = Manifest::of_case(*id, objects, &case.parameters, case.previous, images);
        put_manifest(store, id.into(), &manifest).await?;
    }
    for layer in store.layers(id).await? {
        let owner = Owner::from((id, &layer.id));
        let objects = store.objects_of(owner).await?;
        if has_manifest(store, &objects).await? {
            continue;
        }
        let series = store.series_of_layer(id, &layer.id).await?;
        let made = Made::layer(id, &layer.id);
        let images = made::of(&mut store.connect().await?, &made).await?;
        let manifest = Manifest::of_layer(
            *id,
            layer.id,
            objects,
            &layer.name,
            &layer.parameters,
            series.as_ref(),
            images,
        );
        put_manifest(store, owner, &manifest).await?;
    }
    Ok(())
}

async fn has_manifest(store: &Store, objects: &[ObjectName]) -> Result<bool, StoreError> {
    let mut manifests = objects.iter();
    match manifests.find(|name| name.kind == ObjectKind::Manifest) {
        Some(name) => Ok(manifest(store, name).await?.is_some()),
        None => Ok(false),
    }
}

async fn put_manifest(store: &Store, owner: Owner, manifest: &Manifest) -> Result<(), StoreError> {
    let framed = manifest.framed()?;
    let refer = |pinned: Pinned| async move { store.refer(owner, &pinned, false).await };
    let put = store.with_pinned(&[Writing::Framed(&framed)], refer).await;
    put.map(drop)
}
