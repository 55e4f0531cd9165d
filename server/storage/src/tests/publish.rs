//! Derived objects: who may write them, and rebuilds.

use std::sync::atomic::{AtomicUsize, Ordering};

use super::*;

#[tokio::test]
async fn a_worker_without_its_lease_publishes_nothing() {
    let directory = tempfile::tempdir().unwrap();
    let store = store(&directory).await;
    let id = submit(&store, "volume").await.unwrap().case.id;
    let claim = claim(&store).await.unwrap();
    let handed_back = Release {
        after: Duration::ZERO,
        counts: false,
        failure: None,
    };
    assert!(store.release(&claim, &handed_back).await.unwrap());
    let objects = vec![(ObjectKind::Volume, Bytes::from_static(b"volume"))];
    let framed = frame_all(objects).await.unwrap();
    for publisher in [
        Publisher::Case(claim, facts().into(), &[]),
        Publisher::Ready((&id).into()),
    ] {
        let published = store.publish(publisher.clone(), framed.clone()).await;
        assert_eq!(published.unwrap(), Published::Fenced, "{publisher:?}");
        let case = store.case(&id).await.unwrap().unwrap();
        assert_eq!((case.state, case.facts), (CaseState::Queued, None));
        assert_nothing_left_over(&store, directory.path()).await;
    }
}

// A worker drops it when it hears that the case was deleted: what is half done would stay for as long as pins last.
#[tokio::test]
async fn what_is_published_comes_to_its_end_without_its_caller() {
    let directory = tempfile::tempdir().unwrap();
    let store = store(&directory).await;
    let id = submit(&store, "volume").await.unwrap().case.id;
    let claim = claim(&store).await.unwrap();
    let objects = vec![(ObjectKind::Volume, Bytes::from_static(b"volume"))];
    let framed = frame_all(objects).await.unwrap();
    let publisher = Publisher::Case(claim, facts().into(), &[]);
    let begun = tokio::time::timeout(Duration::ZERO, store.publish(publisher, framed)).await;
    assert!(begun.is_err(), "it was dropped before its end");
    let mut watch = store.subscribe(&id);
    while watch.next().await.unwrap().unwrap().state != CaseState::Ready {}
}

#[tokio::test]
async fn rebuilds_of_a_case_come_one_after_another() {
    let directory = tempfile::tempdir().unwrap();
    let store = store(&directory).await;
    let id = ready(&store, "volume").await;
    let active = AtomicUsize::new(0);
    let rebuild = async || {
        assert_eq!(active.fetch_add(1, Ordering::SeqCst), 0, "one at a time");
        let job = NewJob::about(JobKind::REBUILD, &id);
        let taken = store.enqueue_and_claim(&job, 30).await.unwrap();
        assert!(taken.is_none(), "nobody else gets the job: {taken:?}");
        active.fetch_sub(1, Ordering::SeqCst);
        Ok(())
    };
    let (first, second) = tokio::join!(
        store.rebuild_alone(&id, rebuild()),
        store.rebuild_alone(&id, rebuild())
    );
    assert!(matches!((first, second), (Ok(Some(())), Ok(Some(())))));
    // One that fails gives its lease back.
    let fails = async { Err::<(), _>(StoreError::NoSuchCase) };
    let failed = store.rebuild_alone(&id, fails).await;
    assert!(matches!(failed, Err(StoreError::NoSuchCase)));
    let begun = std::time::Instant::now();
    assert!(store.rebuild_alone(&id, rebuild()).await.unwrap().is_some());
    assert!(begun.elapsed() < Duration::from_secs(5));
    store.delete(&id).await.unwrap();
    let gone = store.rebuild_alone(&id, rebuild()).await.unwrap();
    assert!(gone.is_none());
}

#[tokio::test]
async fn lost_attributes_are_an_error_and_not_a_case_without_any() {
    let directory = tempfile::tempdir().unwrap();
    let store = store(&directory).await;
    let dicom = Upload {
        dicom: Some(store.spools().of("whose".into()).await.unwrap()),
        ..upload(&store, "volume", None).await
    };
    let submitted = store
        .submit(dicom, Parameters::default(), None, false)
        .await;
    let id = submitted.unwrap().case.id;
    let folder = directory.path().join("objects/source-dicom");
    let [file] = &files_below(&folder)[..] else {
        panic!("one object has the attributes");
    };
    std::fs::write(file, b"damaged").unwrap();
    let lost = store.source_dicom(&id).await.unwrap_err();
    assert!(matches!(lost, StoreError::Objects(_)), "{lost:?}");
    assert_eq!(store.signals().counted(Count::BadObject), 1);
}
