//! Processes that are killed at any step.

use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use case::{CaseState, JobKind, ObjectKind};
use storage::testing::{assert_nothing_left_over, facts, steps};
use storage::{CaseQuery, ObjectName, Publisher, frame_all};
use tempfile::TempDir;

use super::{GRACE, expected, load, open};
use crate::jobs::start_workers;
use crate::testing::{Fake, fake_objects, settled_state, submit};

/// Does the steps of an upload and its preparation one by one, and stops before the given one, as a killed process would.
async fn killed_before(step: usize, directory: &TempDir, fake: &Arc<Fake>) {
    let library = open(directory, fake).await;
    let mut spool = library.store().spools().begin().await.unwrap();
    spool.write(Bytes::from_static(b"volume")).await.unwrap();
    if step == 0 {
        return std::mem::forget(spool);
    }
    let spooled = spool.finish().await.unwrap();
    let name = ObjectName {
        kind: ObjectKind::SourceVolume,
        digest: *spooled.digest(),
    };
    steps::pin(library.store(), [name]).await.unwrap();
    if step == 1 {
        return std::mem::forget(spooled);
    }
    steps::write_file(library.store(), &name, &spooled)
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
    let claim = library.store().claim(JobKind::PREPARE, 3).await;
    let claim = claim.unwrap().unwrap();
    if step == 4 {
        return;
    }
    let framed = frame_all(fake_objects(b"volume")).await.unwrap();
    steps::pin(library.store(), framed.iter().map(|framed| framed.name))
        .await
        .unwrap();
    for framed in &framed[..2] {
        steps::write(library.store(), framed).await.unwrap();
    }
    if step == 5 {
        return;
    }
    for framed in &framed[2..] {
        steps::write(library.store(), framed).await.unwrap();
    }
    if step == 6 {
        return;
    }
    library
        .store()
        .publish(Publisher::Case(claim.clone(), facts().into(), &[]), framed)
        .await
        .unwrap();
    if step == 7 {
        return;
    }
    let store = library.store();
    store.delete(&claim.case.unwrap()).await.unwrap();
    if step == 8 {
        return;
    }
    // The pins from above have no holder any more.
    steps::forget_holders(store).await.unwrap();
    let marked = steps::begin_sweep(store, "killed", Duration::from_secs(3600))
        .await
        .unwrap();
    assert_eq!(marked.len(), 7);
    if step == 9 {
        return;
    }
    for name in &marked[..3] {
        steps::delete(library.store(), name).await.unwrap();
    }
    if step == 10 {
        return;
    }
    for name in &marked[3..] {
        steps::delete(library.store(), name).await.unwrap();
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
        let cases = library
            .store()
            .cases(&CaseQuery::default(), None, 10)
            .await
            .unwrap()
            .cases;
        assert_eq!(
            cases.len(),
            usize::from((3..=7).contains(&step)),
            "step {step}"
        );
        let workers = start_workers(library.clone(), 1);
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
