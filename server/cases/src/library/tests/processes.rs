//! Several processes and workers on one store.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use bytes::Bytes;
use case::CaseState;
use storage::testing::{assert_nothing_left_over, steps};
use storage::{Count, Options, Store, frame_all};

use super::{GRACE, open};
use crate::jobs::start_workers;
use crate::testing::{Fake, fake_objects, library_on, options, settled_state, submit, until};

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_second_process_takes_neither_live_jobs_nor_live_files() {
    let (directory, fake) = (tempfile::tempdir().unwrap(), Arc::<Fake>::default());
    let first = open(&directory, &fake).await;
    fake.hold(true);
    let workers = start_workers(first.clone(), 1);
    let id = submit(&first, "volume").await.id;
    fake.until_active().await;
    let mut spool = first.store().spools().begin().await.unwrap();
    spool.write(Bytes::from_static(b"second")).await.unwrap();
    let pinned = frame_all(fake_objects(b"about to be published"))
        .await
        .unwrap();
    steps::pin(first.store(), pinned.iter().map(|framed| framed.name))
        .await
        .unwrap();
    steps::write(first.store(), &pinned[0]).await.unwrap();

    let second = open(&directory, &fake).await;
    let others = start_workers(second.clone(), 1);
    // It takes the next job, and leaves the older one and the files alone.
    let next = submit(&second, "next").await.id;
    until(|| fake.run_count() == 2).await;
    second.store().collect().await.unwrap();
    assert_eq!(fake.runs.lock().unwrap()[..], ["volume", "next"]);
    assert!(second.store().object(&pinned[0].name).await.is_ok());
    spool.finish().await.unwrap();

    // Deleted by the other process: the first one's worker learns of it by its heartbeat.
    assert!(second.store().delete(&id).await.unwrap());
    until(|| fake.active.load(Ordering::Relaxed) == 1).await;
    fake.hold(false);
    assert_eq!(settled_state(&second, &next).await, Some(CaseState::Ready));
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
        let workers = start_workers(library.clone(), 1);
        fake.until_active().await;
        workers.shut_down(Duration::from_millis(5)).await;
        // At once, with no lease to wait for, and without an end of its attempts.
        assert_eq!(
            library.store().case(&id).await.unwrap().unwrap().state,
            CaseState::Queued
        );
    }
    let workers = start_workers(library.clone(), 1);
    fake.until_active().await;
    let mut finish = Box::pin(workers.shut_down(GRACE));
    // It begins when it is first polled.
    tokio::select! {
        biased;
        () = &mut finish => panic!("a preparation is at work"),
        () = std::future::ready(()) => {}
    }
    fake.hold(false);
    finish.await;
    assert_eq!(
        library.store().case(&id).await.unwrap().unwrap().state,
        CaseState::Ready
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_worker_that_lost_its_lease_publishes_nothing() {
    let (directory, fake) = (tempfile::tempdir().unwrap(), Arc::<Fake>::default());
    let options = Options {
        heartbeat: Duration::from_secs(3600),
        ..options()
    };
    let opened = Store::open(directory.path(), options).await;
    let library = library_on(opened.unwrap(), &fake);
    fake.hold(true);
    let asleep = start_workers(library.clone(), 1);
    let id = submit(&library, "volume").await.id;
    fake.until_active().await;
    // Its heartbeat does not come for longer than the lease.
    library.store().pass_time(Duration::from_secs(31));
    let awake = start_workers(library.clone(), 1);
    while fake.run_count() < 2 {
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    fake.hold(false);
    assert_eq!(settled_state(&library, &id).await, Some(CaseState::Ready));
    asleep.shut_down(GRACE).await;
    awake.shut_down(GRACE).await;
    assert_eq!(library.store().signals().counted(Count::Prepared), 1);
    assert_nothing_left_over(library.store(), directory.path()).await;
}
