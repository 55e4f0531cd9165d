//! Submits again what was uploaded after the backup from which the rows were restored: by the manifests that are still among the objects,
//! though no row names them.

use std::collections::HashMap;

use case::{CaseId, LayerId, ObjectKind};
use storage::{Manifest, Manifested, ObjectName, Spooled, StoreError, Upload, upkeep};

use crate::application::Cases;
use crate::error::Error;
use crate::series::series_of;

/// What became of the objects that no row named.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Adopted {
    pub cases: Vec<CaseId>,
    /// Layers, by their cases.
    pub layers: Vec<(CaseId, LayerId)>,
    /// Manifests that stay as they are: they are damaged, or a source of theirs or the case of a layer is lost.
    pub left: Vec<ObjectName>,
}

impl Cases {
    /// Submits each manifest again that no row names, with the same ids. Run again, it finds nothing more.
    ///
    /// # Errors
    /// If the store cannot be reached.
    pub async fn adopt(&self) -> Result<Adopted, Error> {
        let store = self.store();
        upkeep::forget_writers(store).await?;
        let (mut adopted, mut manifests) = (Adopted::default(), Vec::new());
        for name in upkeep::unreferenced_of(store, ObjectKind::Manifest).await? {
            match upkeep::manifest(store, &name).await? {
                Some(manifest) => manifests.push((name, manifest)),
                None => adopted.left.push(name),
            }
        }
        in_order(&mut manifests);
        for (name, manifest) in manifests {
            let case = manifest.case;
            match self.submit_again(&name, &manifest).await? {
                Again::Case => adopted.cases.push(case),
                Again::Layer(layer) => adopted.layers.push((case, layer)),
                Again::Known => {}
                Again::Impossible => adopted.left.push(name),
            }
        }
        Ok(adopted)
    }

    async fn submit_again(
        &self,
        manifest_name: &ObjectName,
        manifest: &Manifest,
    ) -> Result<Again, Error> {
        let (store, case) = (self.store(), manifest.case);
        let mut files = HashMap::new();
        for name in manifest.sources().into_iter().flatten() {
            if let Some(file) = upkeep::spool_object(store, &name).await? {
                files.insert(name.kind, file);
            }
        }
        match &manifest.upload {
            Manifested::Case { parameters, .. } => {
                let Some(volume) = files.remove(&ObjectKind::SourceVolume) else {
                    return Ok(Again::Impossible);
                };
                let upload = Upload {
                    volume,
                    mask: files.remove(&ObjectKind::SourceMask),
                    dicom: files.remove(&ObjectKind::SourceDicom),
                    images: Vec::new(),
                    series: None,
                };
                // Without its mask, or somebody's attributes, it would be another case.
                if upload.case_id(parameters) != case {
                    return Ok(Again::Impossible);
                }
                let attributes = match &upload.dicom {
                    Some(stored) => Some(pipeline::attributes(&stored.read().await?)?),
                    None => None,
                };
                let label = attributes.as_ref().and_then(|it| self.label_of(it));
                let series = attributes.as_ref().and_then(series_of);
                match upkeep::adopt(store, manifest_name, manifest, label, series).await? {
                    true => Ok(Again::Case),
                    false => Ok(Again::Known),
                }
            }
            Manifested::Layer { id, parameters, .. } => {
                let dicom = files.get(&ObjectKind::SourceDicom).map(Spooled::digest);
                let Some(volume) = files.get(&ObjectKind::SourceLayer) else {
                    return Ok(Again::Impossible);
                };
                if LayerId::of(volume.digest(), dicom, parameters) != *id {
                    return Ok(Again::Impossible);
                }
                match upkeep::adopt(store, manifest_name, manifest, None, None).await {
                    Ok(true) => Ok(Again::Layer(*id)),
                    Ok(false) => Ok(Again::Known),
                    Err(StoreError::NoSuchCase) => Ok(Again::Impossible),
                    Err(error) => Err(error.into()),
                }
            }
        }
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

#[cfg(test)]
mod tests {
    use std::path::Path;

    use case::{CaseState, LayerParameters, Parameters};
    use pipeline::Source;
    use storage::testing::{assert_nothing_left_over, files_below, objects_below};
    use storage::{
        LayerName, LayerUpload, Location, NewMask, ObjectsAddress, Opening, Store, Version,
    };
    use tempfile::TempDir;

    use super::*;
    use crate::testing::application;
    use crate::testing::{options, source};

    /// A store that has the rows of its first day each time that it is opened.
    struct Restored {
        objects: TempDir,
        backup: TempDir,
    }

    impl Restored {
        async fn new() -> Self {
            let [objects, backup] = [(); 2].map(|()| tempfile::tempdir().unwrap());
            let restored = Self { objects, backup };
            let store = restored.store(&restored.backup, Opening::OrMake).await;
            store.close().await;
            restored
        }

        async fn store(&self, folder: &TempDir, opening: Opening) -> Store {
            let location = Location {
                objects: Some(ObjectsAddress::Folder(self.objects.path().to_owned())),
                ..folder.path().into()
            };
            let options = storage::Options {
                opening,
                ..options()
            };
            Store::open(location, options).await.unwrap()
        }

        async fn open(&self) -> (TempDir, Cases) {
            let folder = tempfile::tempdir().unwrap();
            let rows = |of: &TempDir| of.path().join("rows.sqlite");
            std::fs::copy(rows(&self.backup), rows(&folder)).unwrap();
            let store = self.store(&folder, Opening::Existing).await;
            (folder, application(store, ""))
        }

        fn objects(&self) -> &Path {
            self.objects.path()
        }
    }

    async fn submitted(cases: &Cases, source: Source) -> CaseId {
        let submitted = cases.library.submit(source, Parameters::default());
        submitted.await.unwrap().case.id
    }

    fn with_mask_and_attributes() -> Source {
        Source {
            mask: Some("mask".into()),
            dicom: Some(r#"{"attributes":[],"instances":[],"interpolated_slices":[]}"#.into()),
            ..source("volume")
        }
    }

    async fn version(cases: &Cases, of: CaseId, closing_radius_mm: f64) -> CaseId {
        let version = Version {
            of,
            mask: NewMask::Kept,
            parameters: Parameters {
                closing_radius_mm,
                ..Parameters::default()
            },
        };
        let submitted = cases.store().submit_version(version).await.unwrap();
        submitted.unwrap().case.id
    }

    async fn layer(cases: &Cases, case: CaseId, volume: &'static str) -> LayerId {
        let upload = LayerUpload {
            case,
            volume: cases.store().spools().of(volume.into()).await.unwrap(),
            dicom: None,
            images: Vec::new(),
            series: None,
            name: LayerName::Usual(volume.to_owned()),
            parameters: LayerParameters::default(),
        };
        cases.store().submit_layer(upload).await.unwrap().layer.id
    }

    #[tokio::test]
    async fn cases_versions_and_layers_come_back_with_their_ids_and_what_was_deleted_does_not() {
        let restored = Restored::new().await;
        let (_folder, cases) = restored.open().await;
        let first = submitted(&cases, with_mask_and_attributes()).await;
        let t2 = layer(&cases, first, "T2").await;
        // A radius that no binary number is.
        let second = version(&cases, first, 7.3).await;
        let third = version(&cases, second, 0.1).await;
        let flair = layer(&cases, third, "FLAIR").await;
        let deleted = submitted(&cases, source("deleted")).await;
        layer(&cases, deleted, "PET").await;
        assert!(cases.store().delete(&deleted).await.unwrap());

        let (_folder, cases) = restored.open().await;
        let adopted = cases.adopt().await.unwrap();
        assert_eq!(
            adopted.cases,
            [first, second, third],
            "a case before its versions"
        );
        assert_eq!(adopted.layers, [(first, t2), (third, flair)]);
        assert_eq!(adopted.left, Vec::new());
        let store = cases.store();
        let case = store.case(&third).await.unwrap().unwrap();
        assert_eq!(
            (case.state, case.previous),
            (CaseState::Queued, Some(second))
        );
        for (case, count) in [(first, 1), (second, 1), (third, 2)] {
            assert_eq!(store.layers(&case).await.unwrap().len(), count);
            let objects = store.objects_of(&case).await.unwrap();
            assert!(
                cases
                    .library
                    .source(&case, &objects)
                    .await
                    .unwrap()
                    .is_some()
            );
        }
        assert_eq!(cases.adopt().await.unwrap(), Adopted::default());
        let mut defects = Vec::new();
        upkeep::inspect(store, &mut |defect| defects.push(defect))
            .await
            .unwrap();
        assert_eq!(defects, []);
    }

    #[tokio::test]
    async fn what_is_damaged_or_incomplete_stays_as_it_is() {
        for kind in ["manifest", "source-volume", "source-mask", "source-dicom"] {
            for is_missing in [true, false] {
                let restored = Restored::new().await;
                let (_folder, cases) = restored.open().await;
                let case = submitted(&cases, with_mask_and_attributes()).await;
                let file = files_below(&restored.objects().join(kind)).remove(0);
                match is_missing {
                    true => std::fs::remove_file(file).unwrap(),
                    false => std::fs::write(file, b"damaged").unwrap(),
                }
                let (_folder, cases) = restored.open().await;
                let files = objects_below(restored.objects()).len();
                let adopted = cases.adopt().await.unwrap();
                assert_eq!(adopted.cases, []);
                let is_named = kind != "manifest" || !is_missing;
                assert_eq!(adopted.left.len(), usize::from(is_named), "{kind}");
                assert_eq!(cases.store().case(&case).await.unwrap(), None);
                assert_eq!(objects_below(restored.objects()).len(), files);
            }
        }
    }

    #[tokio::test]
    async fn a_layer_of_a_lost_case_stays_and_comes_back_with_it() {
        let restored = Restored::new().await;
        let (_folder, cases) = restored.open().await;
        let case = submitted(&cases, source("volume")).await;
        let t2 = layer(&cases, case, "T2").await;
        let file = files_below(&restored.objects().join("source-volume")).remove(0);
        let away = restored.objects().join("away");
        std::fs::rename(&file, &away).unwrap();
        let (folder, cases) = restored.open().await;
        assert_eq!(cases.adopt().await.unwrap().left.len(), 2);
        std::fs::rename(&away, &file).unwrap();
        let adopted = cases.adopt().await.unwrap();
        assert_eq!(
            (adopted.cases, adopted.layers),
            (vec![case], vec![(case, t2)])
        );
        cases.store().delete(&case).await.unwrap();
        assert_eq!(objects_below(restored.objects()).len(), 0);
        assert_eq!(files_below(&folder.path().join("uploads")).len(), 0);
    }

    #[tokio::test]
    async fn what_the_rows_know_is_left_alone() {
        let directory = tempfile::tempdir().unwrap();
        let store = Store::open(directory.path(), options()).await;
        let cases = application(store.unwrap(), "");
        let case = submitted(&cases, source("volume")).await;
        layer(&cases, case, "T2").await;
        assert_eq!(cases.adopt().await.unwrap(), Adopted::default());
        assert_nothing_left_over(cases.store(), directory.path()).await;
    }
}
