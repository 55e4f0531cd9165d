//! The store as a whole: uploads, deletions, damage, kills.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use tempfile::TempDir;

use case::{CaseFacts, CaseId, CaseState, ObjectKind, Parameters};
use storage::testing::{assert_nothing_left_over, facts, files_below};
use storage::{
    LeaseTerms, NewMask, ObjectName, Objects, Options, Pinned, Publisher, SqlRows, Store,
    StoreError, Sweep, Version, frame_all,
};

use super::Library;
use crate::jobs::Workers;
use crate::testing::{
    Fake, fake_objects, library_on, options, settled, settled_state, source, submit,
};

const GRACE: Duration = Duration::from_secs(20);

async fn open(directory: &TempDir, fake: &Arc<Fake>) -> Library {
    let store = Store::open_with(directory.path(), options()).await;
    library_on(store.unwrap(), fake)
}

/// A library with one ready case.
async fn ready(directory: &TempDir, fake: &Arc<Fake>) -> (Library, CaseId) {
    let library = open(directory, fake).await;
    let workers = Workers::start(library.clone(), 1);
    let id = submit(&library, "volume").await.id;
    assert_eq!(settled_state(&library, &id).await, Some(CaseState::Ready));
    workers.shut_down(GRACE).await;
    (library, id)
}

fn as_they_are(_: &CaseFacts, payloads: &[Bytes]) -> Option<Vec<Bytes>> {
    Some(payloads.to_vec())
}

/// The derived objects of a case, as a reader gets them.
async fn load(library: &Library, id: &CaseId) -> Option<Vec<Bytes>> {
    library
        .load(id, &ObjectKind::DERIVED, as_they_are)
        .await
        .unwrap()
}

fn expected(volume: &str) -> Vec<Bytes> {
    fake_objects(volume.as_bytes())
        .into_iter()
        .map(|(_, payload)| payload)
        .collect()
}

#[tokio::test]
async fn a_case_is_prepared_and_outlives_the_process() {
    let (directory, fake) = (tempfile::tempdir().unwrap(), Arc::default());
    let (library, id) = ready(&directory, &fake).await;
    let case = library.store().case(&id).await.unwrap().unwrap();
    drop(library);
    let library = open(&directory, &fake).await;
    assert_eq!(library.store().case(&id).await.unwrap(), Some(case));
    assert_eq!(load(&library, &id).await, Some(expected("volume")));
    assert_eq!(fake.run_count(), 1);
    assert_nothing_left_over(library.store(), directory.path()).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 4)]
async fn twenty_identical_uploads_at_once_are_one_case_and_one_preparation() {
    let (directory, fake) = (tempfile::tempdir().unwrap(), Arc::default());
    let library = open(&directory, &fake).await;
    let workers = Workers::start(library.clone(), 2);
    let submissions = (0..20).map(|_| {
        let library = library.clone();
        tokio::spawn(async move { library.submit(source("same"), Parameters::default()).await })
    });
    let mut created = 0;
    let mut ids = Vec::new();
    for submission in submissions.collect::<Vec<_>>() {
        let submitted = submission.await.unwrap().unwrap();
        created += usize::from(submitted.created);
        ids.push(submitted.case.id);
    }
    ids.dedup();
    assert_eq!((created, ids.len()), (1, 1));
    assert_eq!(
        settled_state(&library, &ids[0]).await,
        Some(CaseState::Ready)
    );
    workers.shut_down(GRACE).await;
    assert_eq!(fake.run_count(), 1);
    assert_eq!(
        library.store().cases(None, 10).await.unwrap().cases.len(),
        1
    );
    assert_nothing_left_over(library.store(), directory.path()).await;
}

#[tokio::test]
async fn a_full_queue_refuses_and_leaves_nothing() {
    let (directory, fake) = (tempfile::tempdir().unwrap(), Arc::default());
    let options = Options {
        queue_limit: 1,
        ..options()
    };
    let opened = Store::open_with(directory.path(), options).await.unwrap();
    let library = library_on(opened, &fake);
    submit(&library, "first").await;
    let refused = library
        .submit(source("second"), Parameters::default())
        .await;
    assert!(matches!(refused, Err(StoreError::QueueFull)));
    // What is there already is no further work.
    assert_eq!(submit(&library, "first").await.state, CaseState::Queued);
    assert_nothing_left_over(library.store(), directory.path()).await;
}

#[tokio::test]
async fn a_preparation_that_takes_too_long_fails_and_the_next_one_is_begun() {
    let (directory, fake) = (tempfile::tempdir().unwrap(), Arc::default());
    let options = Options {
        longest_preparation: Duration::from_millis(300),
        ..options()
    };
    let opened = Store::open_with(directory.path(), options).await.unwrap();
    let library = library_on(opened, &fake);
    let workers = Workers::start(library.clone(), 1);
    fake.hold(true);
    let slow = submit(&library, "slow").await.id;
    let case = settled(&library, &slow).await.unwrap();
    assert_eq!(case.failure.unwrap().name, "preparation-too-slow");
    fake.hold(false);
    let next = submit(&library, "next").await.id;
    assert_eq!(settled_state(&library, &next).await, Some(CaseState::Ready));
    workers.shut_down(GRACE).await;
}

#[tokio::test]
async fn an_upload_that_is_cut_leaves_nothing() {
    let (directory, fake) = (tempfile::tempdir().unwrap(), Arc::default());
    let library = open(&directory, &fake).await;
    let mut spool = library.store().spool().await.unwrap();
    spool
        .write(Bytes::from_static(b"half of a vol"))
        .await
        .unwrap();
    assert_eq!(
        (
            spool.len(),
            files_below(&directory.path().join("uploads")).len()
        ),
        (13, 1)
    );
    drop(spool);
    let mut spool = library.store().spool().await.unwrap();
    spool.write(Bytes::from_static(b"volume")).await.unwrap();
    let spooled = spool.finish().await.unwrap();
    assert_eq!(*spooled.digest(), blake3::hash(b"volume"));
    drop(spooled);
    assert_nothing_left_over(library.store(), directory.path()).await;
}

#[tokio::test]
async fn a_failed_case_says_why_and_is_tried_again_when_it_is_uploaded_again() {
    let (directory, fake) = (tempfile::tempdir().unwrap(), Arc::default());
    let library = open(&directory, &fake).await;
    let workers = Workers::start(library.clone(), 1);
    for runs in 1..=2 {
        let submitted = library.submit(source("bad"), Parameters::default()).await;
        let submitted = submitted.unwrap();
        assert!(
            submitted.created,
            "it is queued, whether for the first time or again"
        );
        let id = submitted.case.id;
        let case = settled(&library, &id).await.unwrap();
        assert_eq!(case.state, CaseState::Failed);
        assert_eq!(case.failure.unwrap().name, "mask-empty");
        assert_eq!(fake.run_count(), runs);
    }
    let id = submit(&library, "panic").await.id;
    let case = settled(&library, &id).await.unwrap();
    assert_eq!(case.failure.unwrap().name, "preparation-crashed");
    assert_eq!(library.store().counters().failed, 3);
    workers.shut_down(GRACE).await;
}

#[tokio::test]
async fn deleting_a_case_removes_what_no_other_case_needs() {
    let (directory, fake) = (tempfile::tempdir().unwrap(), Arc::default());
    let (library, id) = ready(&directory, &fake).await;
    let other = Parameters {
        closing_radius_mm: 5.0,
        ..Parameters::default()
    };
    let other = library
        .submit(source("volume"), other)
        .await
        .unwrap()
        .case
        .id;
    assert_ne!(id, other);
    assert!(library.store().delete(&id).await.unwrap());
    assert!(!library.store().delete(&id).await.unwrap());
    assert_eq!(library.store().case(&id).await.unwrap(), None);
    assert_eq!(files_below(&directory.path().join("objects")).len(), 1);
    let workers = Workers::start(library.clone(), 1);
    assert_eq!(
        settled_state(&library, &other).await,
        Some(CaseState::Ready)
    );
    workers.shut_down(GRACE).await;
    assert_nothing_left_over(library.store(), directory.path()).await;
    assert!(library.store().delete(&other).await.unwrap());
    assert_eq!(files_below(&directory.path().join("objects")).len(), 0);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn deleting_a_case_while_it_is_prepared_cancels_it() {
    let (directory, fake) = (tempfile::tempdir().unwrap(), Arc::<Fake>::default());
    let library = open(&directory, &fake).await;
    fake.hold(true);
    let workers = Workers::start(library.clone(), 1);
    let id = submit(&library, "volume").await.id;
    fake.until_active().await;
    assert_eq!(
        library
            .store()
            .case(&id)
            .await
            .unwrap()
            .unwrap()
            .progress
            .unwrap()
            .fraction,
        0.4
    );
    assert!(library.store().delete(&id).await.unwrap());
    assert_eq!(settled(&library, &id).await, None);
    workers.shut_down(GRACE).await;
    assert_eq!(library.store().case(&id).await.unwrap(), None);
    assert_nothing_left_over(library.store(), directory.path()).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_case_deleted_and_uploaded_again_while_it_is_prepared_becomes_ready() {
    let (directory, fake) = (tempfile::tempdir().unwrap(), Arc::<Fake>::default());
    let library = open(&directory, &fake).await;
    fake.hold(true);
    let workers = Workers::start(library.clone(), 2);
    for _ in 0..5 {
        let id = submit(&library, "volume").await.id;
        fake.until_active().await;
        library.store().delete(&id).await.unwrap();
    }
    fake.hold(false);
    let id = submit(&library, "volume").await.id;
    assert_eq!(settled_state(&library, &id).await, Some(CaseState::Ready));
    workers.shut_down(GRACE).await;
    assert_eq!(load(&library, &id).await, Some(expected("volume")));
    assert_nothing_left_over(library.store(), directory.path()).await;
}

fn object_files(directory: &Path, kind: ObjectKind) -> Vec<std::path::PathBuf> {
    files_below(&directory.join("objects").join(kind.name()))
}

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
async fn what_was_just_deleted_can_be_uploaded_again_while_it_is_removed() {
    let (directory, fake) = (tempfile::tempdir().unwrap(), Arc::default());
    let (library, id) = ready(&directory, &fake).await;
    let rows = library.store().rows();
    rows.delete(&id).await.unwrap();
    let sweep = Sweep {
        holder: "another process".to_owned(),
        lease: Duration::from_secs(60),
    };
    let marked = rows.mark(&rows.abandoned(100).await.unwrap(), &sweep).await;
    let marked = marked.unwrap();
    let upload = tokio::spawn({
        let library = library.clone();
        async move { submit(&library, "volume").await }
    });
    tokio::time::sleep(Duration::from_millis(100)).await;
    assert!(!upload.is_finished(), "it waits for the removal");
    for name in &marked {
        library.store().objects().delete(name).await.unwrap();
    }
    rows.bury(&sweep.holder).await.unwrap();
    assert_eq!(upload.await.unwrap().id, id);
    let workers = Workers::start(library.clone(), 1);
    assert_eq!(settled_state(&library, &id).await, Some(CaseState::Ready));
    workers.shut_down(GRACE).await;
    assert_nothing_left_over(library.store(), directory.path()).await;
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
        let workers = Workers::start(library.clone(), 1);
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
    let workers = Workers::start(library.clone(), 1);
    let failed = settled(&library, &id).await.unwrap();
    assert_eq!(failed.failure.unwrap().name, "source-damaged");
    workers.shut_down(GRACE).await;
    assert_eq!(fake.run_count(), 0);
}

/// Does the steps of an upload and its preparation one by one, and stops before the given one, as a killed process would.
async fn killed_before(step: usize, directory: &TempDir, fake: &Arc<Fake>) {
    let library = open(directory, fake).await;
    let mut spool = library.store().spool().await.unwrap();
    spool.write(Bytes::from_static(b"volume")).await.unwrap();
    if step == 0 {
        return std::mem::forget(spool);
    }
    let spooled = spool.finish().await.unwrap();
    let name = ObjectName {
        kind: ObjectKind::SourceVolume,
        digest: *spooled.digest(),
    };
    let _pinned: Pinned = library.store().pin([name]).await.unwrap();
    if step == 1 {
        return std::mem::forget(spooled);
    }
    library
        .store()
        .objects()
        .put_file(&name, spooled.path(), spooled.len())
        .await
        .unwrap();
    let half_staged = directory
        .path()
        .join("objects")
        .join(format!("{}#7", name.path()));
    std::fs::write(half_staged, b"half").unwrap();
    if step == 2 {
        return std::mem::forget(spooled);
    }
    drop(spooled);
    submit(&library, "volume").await;
    if step == 3 {
        return;
    }
    let terms = LeaseTerms {
        lease: Duration::from_secs(3600),
        max_attempts: 3,
    };
    let claim = library.store().rows().claim(&terms).await.unwrap().unwrap();
    if step == 4 {
        return;
    }
    let framed = frame_all(fake_objects(b"volume")).await.unwrap();
    library
        .store()
        .pin(framed.iter().map(|framed| framed.name))
        .await
        .unwrap();
    for framed in &framed[..2] {
        library.store().objects().put(framed).await.unwrap();
    }
    if step == 5 {
        return;
    }
    for framed in &framed[2..] {
        library.store().objects().put(framed).await.unwrap();
    }
    if step == 6 {
        return;
    }
    library
        .store()
        .publish(Publisher::Worker(&claim), &framed, &facts())
        .await
        .unwrap();
    if step == 7 {
        return;
    }
    let rows = library.store().rows();
    rows.delete(&claim.id).await.unwrap();
    if step == 8 {
        return;
    }
    let sweep = Sweep {
        holder: "killed".to_owned(),
        lease: Duration::from_secs(3600),
    };
    // The pins from above have no holder any more.
    rows.forget_holders().await.unwrap();
    let unneeded = rows.abandoned(100).await.unwrap();
    let marked = rows.mark(&unneeded, &sweep).await.unwrap();
    assert_eq!(marked.len(), 6);
    if step == 9 {
        return;
    }
    for name in &marked[..3] {
        library.store().objects().delete(name).await.unwrap();
    }
    if step == 10 {
        return;
    }
    for name in &marked[3..] {
        library.store().objects().delete(name).await.unwrap();
    }
    assert_eq!(step, 11, "there is no further step");
}

#[tokio::test]
async fn a_kill_at_any_step_leaves_nothing_half_there() {
    for step in 0..=11 {
        let (directory, fake) = (tempfile::tempdir().unwrap(), Arc::default());
        killed_before(step, &directory, &fake).await;
        let library = open(&directory, &fake).await;
        assert_nothing_left_over(library.store(), directory.path()).await;
        let cases = library.store().cases(None, 10).await.unwrap().cases;
        assert_eq!(
            cases.len(),
            usize::from((3..=7).contains(&step)),
            "step {step}"
        );
        let workers = Workers::start(library.clone(), 1);
        let id = submit(&library, "volume").await.id;
        assert_eq!(
            settled_state(&library, &id).await,
            Some(CaseState::Ready),
            "step {step}"
        );
        workers.shut_down(GRACE).await;
        assert_eq!(load(&library, &id).await, Some(expected("volume")));
        assert_eq!(fake.run_count(), usize::from(step != 7), "step {step}");
        assert_nothing_left_over(library.store(), directory.path()).await;
    }
}

#[tokio::test]
async fn an_object_that_no_row_knows_is_removed_at_the_next_start() {
    let (directory, fake) = (tempfile::tempdir().unwrap(), Arc::default());
    let (library, id) = ready(&directory, &fake).await;
    let unknown = frame_all(fake_objects(b"a removal that the disk forgot"))
        .await
        .unwrap();
    for framed in &unknown {
        library.store().objects().put(framed).await.unwrap();
    }
    drop(library);
    let library = open(&directory, &fake).await;
    assert_nothing_left_over(library.store(), directory.path()).await;
    assert_eq!(load(&library, &id).await, Some(expected("volume")));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_second_process_takes_neither_live_jobs_nor_live_files() {
    let (directory, fake) = (tempfile::tempdir().unwrap(), Arc::<Fake>::default());
    let first = open(&directory, &fake).await;
    fake.hold(true);
    let workers = Workers::start(first.clone(), 1);
    let id = submit(&first, "volume").await.id;
    fake.until_active().await;
    let mut spool = first.store().spool().await.unwrap();
    spool.write(Bytes::from_static(b"second")).await.unwrap();
    let pinned = frame_all(fake_objects(b"about to be published"))
        .await
        .unwrap();
    first
        .store()
        .pin(pinned.iter().map(|framed| framed.name))
        .await
        .unwrap();
    first.store().objects().put(&pinned[0]).await.unwrap();

    let second = open(&directory, &fake).await;
    let others = Workers::start(second.clone(), 1);
    tokio::time::sleep(Duration::from_millis(200)).await;
    assert_eq!(fake.run_count(), 1);
    assert!(second.store().objects().get(&pinned[0].name).await.is_ok());
    spool.finish().await.unwrap();

    // Deleted by the other process: the first one's worker learns of it by its heartbeat.
    assert!(second.store().delete(&id).await.unwrap());
    while fake.active.load(std::sync::atomic::Ordering::Relaxed) > 0 {
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    workers.shut_down(GRACE).await;
    others.shut_down(GRACE).await;
    assert_eq!(first.store().case(&id).await.unwrap(), None);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_shutdown_finishes_or_hands_back() {
    let (directory, fake) = (tempfile::tempdir().unwrap(), Arc::<Fake>::default());
    let library = open(&directory, &fake).await;
    let id = submit(&library, "volume").await.id;
    fake.hold(true);
    for _ in 0..5 {
        let workers = Workers::start(library.clone(), 1);
        fake.until_active().await;
        workers.shut_down(Duration::from_millis(5)).await;
        // At once, with no lease to wait for, and without an end of its attempts.
        assert_eq!(
            library.store().case(&id).await.unwrap().unwrap().state,
            CaseState::Queued
        );
    }
    let workers = Workers::start(library.clone(), 1);
    fake.until_active().await;
    let finish = tokio::spawn(workers.shut_down(GRACE));
    tokio::time::sleep(Duration::from_millis(30)).await;
    fake.hold(false);
    finish.await.unwrap();
    assert_eq!(
        library.store().case(&id).await.unwrap().unwrap().state,
        CaseState::Ready
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_worker_that_lost_its_lease_publishes_nothing() {
    let (directory, fake) = (tempfile::tempdir().unwrap(), Arc::<Fake>::default());
    std::fs::create_dir(directory.path().join("uploads")).unwrap();
    std::fs::create_dir(directory.path().join("objects")).unwrap();
    let file = directory.path().join("rows.sqlite");
    let rows = SqlRows::sqlite(&file).await.unwrap();
    let objects = Objects::in_directory(&directory.path().join("objects")).unwrap();
    let options = Options {
        heartbeat: Duration::from_secs(3600),
        ..options()
    };
    let opened = Store::on(Arc::new(rows.clone()), objects, options).unwrap();
    let library = library_on(opened, &fake);
    fake.hold(true);
    let asleep = Workers::start(library.clone(), 1);
    let id = submit(&library, "volume").await.id;
    fake.until_active().await;
    // Its heartbeat does not come for longer than the lease.
    rows.pass_time(Duration::from_secs(31));
    let awake = Workers::start(library.clone(), 1);
    while fake.run_count() < 2 {
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    fake.hold(false);
    assert_eq!(settled_state(&library, &id).await, Some(CaseState::Ready));
    asleep.shut_down(GRACE).await;
    awake.shut_down(GRACE).await;
    assert_eq!(library.store().counters().prepared, 1);
    assert_nothing_left_over(library.store(), directory.path()).await;
}

#[tokio::test]
async fn the_same_suite_of_steps_works_in_memory() {
    let fake = Arc::default();
    let library = library_on(Store::in_memory(options()).await.unwrap(), &fake);
    let workers = Workers::start(library.clone(), 1);
    let mask = Some(Bytes::from_static(b"mask"));
    let source = pipeline::Source {
        mask,
        ..source("volume")
    };
    let submitted = library.submit(source, Parameters::default()).await.unwrap();
    assert!(submitted.created);
    assert_eq!(
        settled_state(&library, &submitted.case.id).await,
        Some(CaseState::Ready)
    );
    assert_eq!(
        load(&library, &submitted.case.id).await,
        Some(expected("volume"))
    );
    library.store().check().await.unwrap();
    assert!(library.store().delete(&submitted.case.id).await.unwrap());
    workers.shut_down(GRACE).await;
}

#[tokio::test]
async fn a_watch_tells_each_state_once_and_the_end() {
    let fake = Arc::<Fake>::default();
    let library = library_on(Store::in_memory(options()).await.unwrap(), &fake);
    fake.hold(true);
    let id = submit(&library, "volume").await.id;
    let mut watch = library.store().subscribe(&id);
    assert_eq!(
        watch.next().await.unwrap().unwrap().state,
        CaseState::Queued
    );
    let workers = Workers::start(library.clone(), 1);
    let mut seen = Vec::new();
    while let Some(case) = watch.next().await.unwrap() {
        seen.push((case.state, case.progress));
        match case.state {
            CaseState::Preparing if case.progress.is_some() => fake.hold(false),
            CaseState::Ready => assert!(library.store().delete(&id).await.unwrap()),
            _ => {}
        }
    }
    let mut once = seen.clone();
    once.dedup();
    assert_eq!(seen, once);
    assert!(
        seen.iter()
            .any(|(state, progress)| *state == CaseState::Preparing && progress.is_some())
    );
    assert_eq!(seen.last(), Some(&(CaseState::Ready, None)));
    workers.shut_down(GRACE).await;
}

/// What the first version of the program left behind: its schema, and a ready case in its rows, with its source stored.
async fn first_versions_folder(directory: &TempDir) -> CaseId {
    let fake = Arc::default();
    let (library, id) = ready(directory, &fake).await;
    let facts = serde_json::to_value(facts()).unwrap();
    let mut facts = facts.as_object().unwrap().clone();
    for later in ["quality", "native_patient_from_voxel", "envelope_sphere"] {
        facts.remove(later);
    }
    let names = library.store().rows().objects(&id).await.unwrap();
    drop(library);
    for file in ["rows.sqlite", "rows.sqlite-wal", "rows.sqlite-shm"] {
        let _gone = std::fs::remove_file(directory.path().join(file));
    }
    let options = sqlx::sqlite::SqliteConnectOptions::new()
        .filename(directory.path().join("rows.sqlite"))
        .create_if_missing(true);
    let pool = sqlx::SqlitePool::connect_with(options).await.unwrap();
    let mut migrator = sqlx::migrate!("../storage/migrations/sqlite");
    migrator.migrations.to_mut().truncate(1);
    migrator.run(&pool).await.unwrap();
    sqlx::query(
        "INSERT INTO cases (id, closing_radius_mm, name, state, facts, created_at)
         VALUES (?, 7.3, 'old', 'ready', ?, 5)",
    )
    .bind(id.to_string())
    .bind(serde_json::Value::from(facts).to_string())
    .execute(&pool)
    .await
    .unwrap();
    // It kept no mask.
    for name in names.iter().filter(|name| name.kind != ObjectKind::Mask) {
        sqlx::query("INSERT INTO case_objects (case_id, kind, digest) VALUES (?, ?, ?)")
            .bind(id.to_string())
            .bind(name.kind.name())
            .bind(name.digest.to_string())
            .execute(&pool)
            .await
            .unwrap();
    }
    pool.close().await;
    id
}

#[tokio::test]
async fn a_folder_of_the_first_version_is_taken_over() {
    let directory = tempfile::tempdir().unwrap();
    let id = first_versions_folder(&directory).await;
    let fake = Arc::default();
    let library = open(&directory, &fake).await;
    let case = library.store().case(&id).await.unwrap().unwrap();
    let expected_parameters = Parameters {
        closing_radius_mm: 7.3,
        name: Some("old".to_owned()),
        ..Parameters::default()
    };
    assert_eq!((case.state, case.facts), (CaseState::Queued, None));
    assert_eq!(case.parameters, expected_parameters);
    assert_eq!((case.previous, case.next), (None, Vec::new()));
    // What the first version did not keep and did not tell is made from the source.
    let workers = Workers::start(library.clone(), 1);
    let case = settled(&library, &id).await.unwrap();
    assert_eq!((case.state, case.facts), (CaseState::Ready, Some(facts())));
    assert_eq!(load(&library, &id).await, Some(expected("volume")));
    assert_eq!(fake.run_count(), 1);
    assert_eq!(library.store().counters().bad_objects, 0);
    // The case can have versions, which outlive it.
    let version = library
        .store()
        .submit_version(Version {
            of: id,
            mask: NewMask::None,
            parameters: Parameters {
                offset_mm: 2.0,
                ..Parameters::default()
            },
        })
        .await
        .unwrap()
        .unwrap();
    assert!(version.created);
    assert_eq!(version.case.previous, Some(id));
    assert_eq!(version.case.parameters.name.as_deref(), Some("old"));
    let case = library.store().case(&id).await.unwrap().unwrap();
    assert_eq!(case.next, [version.case.id]);
    library.store().delete(&id).await.unwrap();
    assert_eq!(
        settled_state(&library, &version.case.id).await,
        Some(CaseState::Ready)
    );
    workers.shut_down(GRACE).await;
    assert_nothing_left_over(library.store(), directory.path()).await;
}

#[tokio::test]
async fn there_is_no_version_of_a_case_that_has_gone() {
    let (directory, fake) = (tempfile::tempdir().unwrap(), Arc::default());
    let (library, id) = ready(&directory, &fake).await;
    library.store().delete(&id).await.unwrap();
    let version = Version {
        of: id,
        mask: NewMask::Kept,
        parameters: Parameters::default(),
    };
    assert!(
        library
            .store()
            .submit_version(version)
            .await
            .unwrap()
            .is_none()
    );
    assert_nothing_left_over(library.store(), directory.path()).await;
}
