//! Deleted cases, and the objects that others need.

use std::sync::Arc;
use std::time::Duration;

use case::{CaseState, Parameters};
use storage::testing::{assert_nothing_left_over, objects_below, steps};

use super::{GRACE, expected, load, open, ready};
use crate::jobs::start_workers;
use crate::testing::{Fake, settled, settled_state, source, submit};

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
    // The source and the other manifest.
    assert_eq!(objects_below(&directory.path().join("objects")).len(), 2);
    let workers = start_workers(library.clone(), 1);
    assert_eq!(
        settled_state(&library, &other).await,
        Some(CaseState::Ready)
    );
    workers.shut_down(GRACE).await;
    assert_nothing_left_over(library.store(), directory.path()).await;
    assert!(library.store().delete(&other).await.unwrap());
    assert_eq!(objects_below(&directory.path().join("objects")).len(), 0);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn deleting_a_case_while_it_is_prepared_cancels_it() {
    let (directory, fake) = (tempfile::tempdir().unwrap(), Arc::<Fake>::default());
    let library = open(&directory, &fake).await;
    fake.hold(true);
    let workers = start_workers(library.clone(), 1);
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
    let workers = start_workers(library.clone(), 2);
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

#[tokio::test]
async fn what_was_just_deleted_can_be_uploaded_again_while_it_is_removed() {
    let (directory, fake) = (tempfile::tempdir().unwrap(), Arc::default());
    let (library, id) = ready(&directory, &fake).await;
    let store = library.store();
    steps::delete_rows(store, &id).await.unwrap();
    let marked = steps::begin_sweep(store, "another process", Duration::from_secs(60))
        .await
        .unwrap();
    let upload = tokio::spawn({
        let library = library.clone();
        async move { submit(&library, "volume").await }
    });
    tokio::time::sleep(Duration::from_millis(100)).await;
    assert!(!upload.is_finished(), "it waits for the removal");
    for name in &marked {
        steps::delete(store, name).await.unwrap();
    }
    steps::end_sweep(store, "another process").await.unwrap();
    assert_eq!(upload.await.unwrap().id, id);
    let workers = start_workers(library.clone(), 1);
    assert_eq!(settled_state(&library, &id).await, Some(CaseState::Ready));
    workers.shut_down(GRACE).await;
    assert_nothing_left_over(library.store(), directory.path()).await;
}
