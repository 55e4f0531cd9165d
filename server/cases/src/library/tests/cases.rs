//! Cases from their upload to their preparation.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use bytes::Bytes;
use case::{CaseState, Parameters};
use imaging::Limits;
use storage::testing::{assert_nothing_left_over, files_below};
use storage::{CaseQuery, Count, NewMask, Options, Store, StoreError, Version};

use super::{GRACE, expected, load, open, ready};
use crate::jobs::start_workers;
use crate::testing::{Fake, library_on, options, settled, settled_state, source, submit, until};
use crate::{Library, LibraryOptions, Preparation};
use worker::ChildBudget;

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
    let workers = start_workers(library.clone(), 2);
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
        library
            .store()
            .cases(&CaseQuery::default(), None, 10)
            .await
            .unwrap()
            .cases
            .len(),
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
    let opened = Store::open(directory.path(), options).await.unwrap();
    let library = library_on(opened, &fake);
    submit(&library, "first").await;
    let refused = library
        .submit(source("second"), Parameters::default())
        .await;
    assert!(matches!(refused, Err(StoreError::QueueFull(_))));
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
    let opened = Store::open(directory.path(), options).await.unwrap();
    let library = library_on(opened, &fake);
    let workers = start_workers(library.clone(), 1);
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
async fn preparations_wait_until_there_is_memory_for_their_processes() {
    let directory = tempfile::tempdir().unwrap();
    for (processes, is_apart, most) in [(1, true, 1), (2, true, 2), (1, false, 2)] {
        let fake = Arc::<Fake>::default();
        let folder = directory.path().join(format!("{processes}-{is_apart}"));
        let store = Store::open(&folder, options()).await.unwrap();
        let preparation = Preparation {
            is_apart,
            ..fake.preparation()
        };
        let usual = ChildBudget::usual(&Limits::default(), 1);
        let library_options = LibraryOptions {
            children: usual.of((processes + 1) * usual.least()),
            ..LibraryOptions::default()
        };
        let library = Library::new(store, preparation, library_options);
        let workers = start_workers(library.clone(), 2);
        fake.hold(true);
        let ids = [
            submit(&library, "first").await.id,
            submit(&library, "second").await.id,
        ];
        // Both are at work, whether there is memory for both or not.
        for id in &ids {
            let mut watch = library.store().subscribe(id);
            while watch.next().await.unwrap().unwrap().state == CaseState::Queued {}
        }
        until(|| fake.run_count() >= most).await;
        fake.hold(false);
        for id in &ids {
            assert_eq!(settled_state(&library, id).await, Some(CaseState::Ready));
        }
        let reached = fake.most.load(Ordering::Relaxed);
        assert_eq!(reached, most, "{processes} {is_apart}");
        workers.shut_down(GRACE).await;
    }
}

#[tokio::test]
async fn an_upload_that_is_cut_leaves_nothing() {
    let (directory, fake) = (tempfile::tempdir().unwrap(), Arc::default());
    let library = open(&directory, &fake).await;
    let mut spool = library.store().spools().begin().await.unwrap();
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
    let mut spool = library.store().spools().begin().await.unwrap();
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
    let workers = start_workers(library.clone(), 1);
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
    assert_eq!(library.store().signals().counted(Count::Failed), 3);
    let id = submit(&library, "interrupted").await.id;
    let case = settled(&library, &id).await.unwrap();
    assert_eq!(case.state, CaseState::Ready, "it is tried again by itself");
    assert_eq!(library.store().signals().counted(Count::Failed), 3);
    workers.shut_down(GRACE).await;
}

#[tokio::test]
async fn the_same_suite_of_steps_works_in_memory() {
    let fake = Arc::default();
    let library = library_on(Store::in_memory(options()).await.unwrap(), &fake);
    let workers = start_workers(library.clone(), 1);
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
    let workers = start_workers(library.clone(), 1);
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
