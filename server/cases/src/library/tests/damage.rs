//! Stored objects that are damaged.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use case::{
    CaseId, CaseState, JobKind, JobState, Layer, LayerId, LayerParameters, ObjectKind, Parameters,
};
use pipeline::Source;
use pipeline::testing::{nifti, phantom, upload};
use storage::tables::jobs;
use storage::testing::assert_nothing_left_over;
use storage::{Count, LayerName, LayerUpload, Store, StoreError};
use tempfile::TempDir;

use super::{GRACE, as_they_are, expected, load, object_files, open, ready};
use crate::error::Error;
use crate::jobs::{prepare_one, prepare_one_layer, start_workers};
use crate::library::Library;
use crate::testing::{Fake, options, settled, settled_state, source, submit};

/// Ways to damage a file of a given length.
fn damage(file: &Path, way: usize) {
    let mut bytes = std::fs::read(file).unwrap();
    // Pseudo-random, but the same each time.
    let at = blake3::hash(&[way as u8]).as_bytes()[..4]
        .iter()
        .fold(0, |at, &byte| at << 8 | usize::from(byte));
    let at = at % bytes.len();
    match way % 3 {
        0 => bytes[at] ^= 1 << (way % 8),
        1 => bytes.truncate(at),
        _ => return std::fs::remove_file(file).unwrap(),
    }
    std::fs::write(file, bytes).unwrap();
}

#[tokio::test]
async fn a_damaged_derived_object_of_any_kind_is_made_again() {
    let (directory, fake) = (tempfile::tempdir().unwrap(), Arc::default());
    let (library, id) = ready(&directory, &fake).await;
    for (round, kind) in ObjectKind::DERIVED.into_iter().cycle().take(24).enumerate() {
        damage(&object_files(directory.path(), kind)[0], round);
        assert_eq!(
            load(&library, &id).await,
            Some(expected("volume")),
            "{kind:?}, way {round}"
        );
        assert_eq!(fake.run_count(), round + 2);
        assert_eq!(
            library.store().signals().counted(Count::Rebuild),
            round as u64 + 1
        );
    }
    assert!(library.store().signals().counted(Count::BadObject) >= 24);
    assert_nothing_left_over(library.store(), directory.path()).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 4)]
async fn many_readers_of_a_damaged_case_make_it_again_once() {
    let (directory, fake) = (tempfile::tempdir().unwrap(), Arc::default());
    let (library, id) = ready(&directory, &fake).await;
    damage(&object_files(directory.path(), ObjectKind::Forest)[0], 0);
    let readers = (0..16).map(|_| {
        let library = library.clone();
        tokio::spawn(async move { load(&library, &id).await })
    });
    for reader in readers.collect::<Vec<_>>() {
        assert_eq!(reader.await.unwrap(), Some(expected("volume")));
    }
    assert_eq!(fake.run_count(), 2);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 4)]
async fn of_two_processes_one_makes_a_case_again_and_the_other_waits_for_it() {
    let (directory, fake) = (tempfile::tempdir().unwrap(), Arc::<Fake>::default());
    let (first, id) = ready(&directory, &fake).await;
    let second = open(&directory, &fake).await;
    damage(&object_files(directory.path(), ObjectKind::Forest)[0], 0);
    fake.hold(true);
    let readers = [first.clone(), second]
        .map(|library| tokio::spawn(async move { load(&library, &id).await }));
    while fake.active.load(std::sync::atomic::Ordering::Relaxed) < 1 {
        tokio::time::sleep(Duration::from_millis(2)).await;
    }
    tokio::time::sleep(Duration::from_millis(300)).await;
    fake.hold(false);
    for reader in readers {
        assert_eq!(reader.await.unwrap(), Some(expected("volume")));
    }
    assert_eq!(fake.run_count(), 2);
    assert_nothing_left_over(first.store(), directory.path()).await;
}

#[tokio::test]
async fn contents_that_cannot_be_decoded_are_made_again_once() {
    let (directory, fake) = (tempfile::tempdir().unwrap(), Arc::default());
    let (library, id) = ready(&directory, &fake).await;
    let decoded = library
        .load(&id, &[ObjectKind::Paths], |_, _| None::<()>)
        .await;
    assert!(matches!(decoded, Err(StoreError::Objects(_))));
    assert_eq!(fake.run_count(), 2);
}

#[tokio::test]
async fn where_the_source_is_damaged_too_the_case_fails_until_it_is_uploaded_again() {
    for damage_way in 0..2 {
        let (directory, fake) = (tempfile::tempdir().unwrap(), Arc::default());
        let (library, id) = ready(&directory, &fake).await;
        damage(
            &object_files(directory.path(), ObjectKind::SourceVolume)[0],
            damage_way,
        );
        // Nobody needs the source as long as all else is there.
        assert_eq!(load(&library, &id).await, Some(expected("volume")));
        damage(
            &object_files(directory.path(), ObjectKind::Volume)[0],
            damage_way,
        );
        assert_eq!(load(&library, &id).await, None);
        let failed = library.store().case(&id).await.unwrap().unwrap();
        assert_eq!(failed.failure.unwrap().name, "source-damaged");
        let workers = start_workers(library.clone(), 1);
        assert_eq!(submit(&library, "volume").await.id, id);
        assert_eq!(settled_state(&library, &id).await, Some(CaseState::Ready));
        assert_eq!(load(&library, &id).await, Some(expected("volume")));
        workers.shut_down(GRACE).await;
        assert_nothing_left_over(library.store(), directory.path()).await;
    }
}

#[tokio::test]
async fn a_damaged_source_fails_its_preparation() {
    let (directory, fake) = (tempfile::tempdir().unwrap(), Arc::default());
    let library = open(&directory, &fake).await;
    let id = submit(&library, "volume").await.id;
    damage(
        &object_files(directory.path(), ObjectKind::SourceVolume)[0],
        0,
    );
    let workers = start_workers(library.clone(), 1);
    let failed = settled(&library, &id).await.unwrap();
    assert_eq!(failed.failure.unwrap().name, "source-damaged");
    workers.shut_down(GRACE).await;
    assert_eq!(fake.run_count(), 0);
}

/// A library with a ready case of a volume, a mask and attributes of DICOM files.
async fn ready_with_all_sources(directory: &TempDir, fake: &Arc<Fake>) -> (Library, CaseId) {
    let library = open(directory, fake).await;
    let upload = Source {
        mask: Some("mask".into()),
        dicom: Some("attributes".into()),
        ..source("volume")
    };
    let submitted = library.submit(upload, Parameters::default()).await;
    let id = submitted.unwrap().case.id;
    assert!(prepare_one(&library).await);
    (library, id)
}

async fn state(library: &Library, id: &CaseId) -> CaseState {
    library.store().case(id).await.unwrap().unwrap().state
}

async fn is_source_missing(library: &Library, id: &CaseId) -> bool {
    let loaded = library.load(id, &ObjectKind::DERIVED, as_they_are).await;
    matches!(loaded, Err(StoreError::SourceMissing))
}

#[tokio::test]
async fn a_source_that_is_away_is_an_answer_and_the_case_stays_as_it_is() {
    for away in [
        "objects/source-volume",
        "objects/source-mask",
        "objects/source-dicom",
        "objects",
    ] {
        let (directory, fake) = (tempfile::tempdir().unwrap(), Arc::default());
        let (library, id) = ready_with_all_sources(&directory, &fake).await;
        damage(&object_files(directory.path(), ObjectKind::Forest)[0], 2);
        let [there, moved] = [away, "moved"].map(|name| directory.path().join(name));
        std::fs::rename(&there, &moved).unwrap();
        for seen in 1..=2 {
            assert!(is_source_missing(&library, &id).await, "{away}");
            assert_eq!(state(&library, &id).await, CaseState::Ready);
            assert_eq!(
                library.store().signals().counted(Count::MissingSource),
                seen
            );
        }
        if there.exists() {
            std::fs::remove_dir_all(&there).unwrap();
        }
        std::fs::rename(&moved, &there).unwrap();
        assert_eq!(load(&library, &id).await, Some(expected("volume")));
        assert_nothing_left_over(library.store(), directory.path()).await;
    }
}

#[tokio::test]
async fn a_source_under_another_name_is_missing_and_a_cut_one_is_damaged() {
    let (directory, fake) = (tempfile::tempdir().unwrap(), Arc::default());
    let (library, id) = ready(&directory, &fake).await;
    damage(&object_files(directory.path(), ObjectKind::Forest)[0], 2);
    let file = object_files(directory.path(), ObjectKind::SourceVolume).remove(0);
    let renamed = file.with_extension("backup");
    std::fs::rename(&file, &renamed).unwrap();
    assert!(is_source_missing(&library, &id).await);
    std::fs::rename(&renamed, &file).unwrap();
    damage(&file, 1);
    assert_eq!(load(&library, &id).await, None);
    assert_eq!(state(&library, &id).await, CaseState::Failed);
}

#[tokio::test]
async fn a_preparation_waits_for_its_source_and_no_attempt_is_used_up() {
    let (directory, fake) = (tempfile::tempdir().unwrap(), Arc::default());
    let library = open(&directory, &fake).await;
    let id = submit(&library, "volume").await.id;
    let store = library.store();
    let [there, moved] = ["objects/source-volume", "moved"].map(|name| directory.path().join(name));
    std::fs::rename(&there, &moved).unwrap();
    let job = async || {
        let job = jobs::latest(
            &mut store.connect().await.unwrap(),
            JobKind::PREPARE,
            &id.to_string(),
        )
        .await;
        job.unwrap().unwrap()
    };
    // More often than a job may be tried.
    for _ in 0..=store.options().max_attempts {
        assert!(prepare_one(&library).await);
        let waiting = job().await;
        assert_eq!((waiting.state, waiting.attempts), (JobState::Queued, 0));
        assert_eq!(waiting.failure.unwrap().name, "source-missing");
        assert_eq!(state(&library, &id).await, CaseState::Queued);
        assert!(!prepare_one(&library).await, "it waits for a while");
        store.pass_time(Duration::from_secs(300));
    }
    std::fs::rename(&moved, &there).unwrap();
    assert!(prepare_one(&library).await);
    assert_eq!(state(&library, &id).await, CaseState::Ready);
    assert_eq!(load(&library, &id).await, Some(expected("volume")));
    assert_nothing_left_over(store, directory.path()).await;
}

/// A layer of a case, as its row is now.
async fn layer(library: &Library, case: &CaseId, id: &LayerId) -> Layer {
    library.store().layer(case, id).await.unwrap().unwrap()
}

#[tokio::test]
async fn a_layer_waits_for_its_source_and_one_that_is_ready_stays_so() {
    let directory = tempfile::tempdir().unwrap();
    let store = Store::open(directory.path(), options()).await;
    let library = Library::of(store.unwrap());
    let submitted = library.submit(upload(&phantom()), Parameters::default());
    let case = submitted.await.unwrap().case.id;
    assert!(prepare_one(&library).await);
    let store = library.store();
    let volume = store.spools().of(nifti(&phantom().volume)).await;
    let layer_upload = LayerUpload {
        case,
        volume: volume.unwrap(),
        dicom: None,
        images: Vec::new(),
        series: None,
        name: LayerName::Usual("T2".to_owned()),
        parameters: LayerParameters::default(),
    };
    let id = store.submit_layer(layer_upload).await.unwrap().layer.id;
    let [there, moved] = ["objects/source-layer", "moved"].map(|name| directory.path().join(name));
    std::fs::rename(&there, &moved).unwrap();
    for _ in 0..=store.options().max_attempts {
        assert!(prepare_one_layer(&library).await);
        assert_eq!(layer(&library, &case, &id).await.state, CaseState::Queued);
        store.pass_time(Duration::from_secs(300));
    }
    std::fs::rename(&moved, &there).unwrap();
    assert!(prepare_one_layer(&library).await);
    let row = layer(&library, &case, &id).await;
    assert_eq!(row.state, CaseState::Ready);

    // Without its voxels and its source it can be drawn by nobody, and is not prepared again for that.
    damage(&object_files(directory.path(), ObjectKind::Layer)[0], 2);
    std::fs::rename(&there, &moved).unwrap();
    let drawn = library.layer_voxels(&row).await;
    assert!(matches!(
        drawn,
        Err(Error::Store(StoreError::SourceMissing))
    ));
    assert_eq!(layer(&library, &case, &id).await.state, CaseState::Ready);
    std::fs::rename(&moved, &there).unwrap();
    let drawn = library.layer_voxels(&row).await;
    assert!(matches!(drawn, Err(Error::LayerNotReady)));
    assert!(prepare_one_layer(&library).await);
    library.layer_voxels(&row).await.unwrap();
    assert_nothing_left_over(store, directory.path()).await;
}
