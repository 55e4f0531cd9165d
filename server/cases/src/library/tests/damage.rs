//! Stored objects that are damaged.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use case::{CaseState, ObjectKind};
use storage::StoreError;
use storage::testing::assert_nothing_left_over;

use super::{GRACE, expected, load, object_files, open, ready};
use crate::jobs::start_workers;
use crate::testing::{Fake, settled, settled_state, submit};

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
        assert_eq!(library.store().counters().rebuilds, round as u64 + 1);
    }
    assert!(library.store().counters().bad_objects >= 24);
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
    for damage_way in 0..3 {
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
