//! Removals: an object goes once nobody needs it, and never earlier, whatever fails on the way.

use super::*;
use crate::frame;
use crate::testing::{name, pinned};

/// A store with rows in memory, on objects in a directory.
async fn movable(directory: &TempDir) -> Store {
    let rows = Rows::in_memory().await.unwrap();
    let objects = Objects::in_directory(directory.path()).unwrap();
    Store::on(rows, objects, Options::default()).unwrap()
}

async fn put(store: &Store, contents: &'static str) -> ObjectName {
    let framed = frame(ObjectKind::Volume, contents.into());
    store.objects().put(&framed).await.unwrap();
    framed.name
}

#[tokio::test]
async fn a_removal_that_fails_is_finished_after_its_lease() {
    let directory = tempfile::tempdir().unwrap();
    let store = movable(&directory).await;
    let id = submit(&store, "volume").await.unwrap().case.id;
    let object = store.case_objects(&id).await.unwrap()[0];
    let file = directory.path().join(object.path().as_ref());
    // A folder in its place cannot be removed like a file.
    std::fs::remove_file(&file).unwrap();
    std::fs::create_dir(&file).unwrap();
    let failed = store.delete(&id).await.unwrap_err();
    assert!(matches!(failed, StoreError::Objects(_)), "{failed:?}");
    assert_eq!(store.case(&id).await.unwrap(), None, "the case is gone");
    std::fs::remove_dir(&file).unwrap();
    std::fs::write(&file, b"left over").unwrap();

    store.collect().await.unwrap();
    assert!(file.exists(), "the lease of the sweep has not ended");
    let again = Pinned {
        holder: "another".to_owned(),
        names: vec![object],
    };
    assert!(!store.try_pin(&again, SWEEP_LEASE).await.unwrap());
    store.pass_time(SWEEP_LEASE);
    store.collect().await.unwrap();
    assert!(!file.exists());
    assert!(store.try_pin(&again, SWEEP_LEASE).await.unwrap());
}

#[tokio::test]
async fn an_upload_waits_while_its_object_is_being_removed() {
    let store = Store::in_memory(Options::default()).await.unwrap();
    let object = name(ObjectKind::SourceVolume, "volume");
    let sweep = Sweep {
        holder: "somebody".to_owned(),
        lease: SWEEP_LEASE,
    };
    let marked = store.mark(&[object], &sweep).await.unwrap();
    assert_eq!(marked, [object]);
    let mut submitting = std::pin::pin!(submit(&store, "volume"));
    let patience = Duration::from_millis(100);
    let early = tokio::time::timeout(patience, &mut submitting).await;
    assert!(early.is_err(), "it must not write what is about to go");
    store.remove_tombstones(&sweep.holder).await.unwrap();
    let submitted = submitting.await.unwrap();
    assert!(submitted.created);
    assert_eq!(store.objects().get(&object).await.unwrap(), "volume");
}

#[tokio::test]
async fn what_the_rows_do_not_know_stays_when_a_store_is_opened() {
    let directory = tempfile::tempdir().unwrap();
    let first = store(&directory).await;
    let stray = put(&first, "stray").await;
    first.close().await;
    // The rows may be those of a backup, and the object newer.
    let alone = store(&directory).await;
    assert!(alone.objects().get(&stray).await.is_ok());
}

#[tokio::test]
async fn only_what_is_still_unneeded_is_removed() {
    let store = Store::in_memory(Options::default()).await.unwrap();
    let id = submit(&store, "volume").await.unwrap().case.id;
    let needed = store.case_objects(&id).await.unwrap()[0];
    let [held, stray] = [put(&store, "held").await, put(&store, "stray").await];
    let _held = pinned(&store, &[held]).await;
    let names = [needed, held, stray];
    store.remove_unreferenced(&names).await.unwrap();
    for (name, stays) in names.iter().zip([true, true, false]) {
        let read = store.objects().get(name).await;
        assert_eq!(read.is_ok(), stays, "{name}");
    }
}

#[tokio::test]
async fn cases_that_are_too_old_go_with_their_objects_and_say_before_when() {
    let day = Duration::from_secs(86_400);
    let directory = tempfile::tempdir().unwrap();
    let rows = Rows::in_memory().await.unwrap();
    let objects = Objects::in_directory(directory.path()).unwrap();
    let options = Options {
        keep: Some(day),
        ..Options::default()
    };
    let store = Store::on(rows, objects, options).unwrap();
    let failure = crate::testing::failure();
    let mut ids = Vec::new();
    for name in ["one", "kept"] {
        ids.push(submit(&store, name).await.unwrap().case.id);
        let claim = crate::testing::claim(&store).await.unwrap();
        assert!(store.fail(&claim, &failure).await.unwrap());
    }
    let [one, kept] = [ids[0], ids[1]];
    let case = store.case(&one).await.unwrap().unwrap();
    assert_eq!(case.expires_at, Some(case.created_at + day));
    assert!(store.keep(&kept, true).await.unwrap());
    let case = store.case(&kept).await.unwrap().unwrap();
    assert_eq!((case.kept, case.expires_at), (true, None));
    let forgotten = Arc::new(Mutex::new(Vec::new()));
    let noted = Arc::clone(&forgotten);
    store.on_delete(move |id| noted.lock().unwrap().push(*id));

    assert_eq!(store.remove_expired(|_| async { true }).await.unwrap(), 0);
    store.pass_time(day);
    assert_eq!(store.remove_expired(|_| async { false }).await.unwrap(), 0);
    assert_eq!(store.remove_expired(|_| async { true }).await.unwrap(), 1);
    assert_eq!(*forgotten.lock().unwrap(), [one]);
    let left = store.cases(None, 10).await.unwrap().cases;
    assert_eq!(left.iter().map(|case| case.id).collect::<Vec<_>>(), [kept]);
    let needed = store.case_objects(&kept).await.unwrap().len();
    assert_eq!(crate::testing::files_below(directory.path()).len(), needed);
}
