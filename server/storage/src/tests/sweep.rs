//! Removals: an object goes once nobody needs it, and never earlier, whatever fails on the way.

use super::*;
use crate::frame;
use crate::rows::{NewCase, Referred};
use crate::testing::{keep, name, pinned};
use crate::upkeep::{Expired, Removal, Waiting};

/// A store with rows in memory, on objects in a directory.
async fn movable(directory: &TempDir) -> Store {
    let rows = Rows::in_memory(Arc::new(())).await.unwrap();
    let objects = Objects::in_directory(directory.path()).unwrap();
    Store::on(rows, objects, Options::default()).await.unwrap()
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
    let object = store.objects_of(&id).await.unwrap()[0];
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
    let needed = store.objects_of(&id).await.unwrap()[0];
    let [held, stray] = [put(&store, "held").await, put(&store, "stray").await];
    let _held = pinned(&store, &[held]).await;
    let names = [needed, held, stray];
    upkeep::remove_unreferenced(&store, &names).await.unwrap();
    for (name, stays) in names.iter().zip([true, true, false]) {
        let read = store.objects().get(name).await;
        assert_eq!(read.is_ok(), stays, "{name}");
    }
}

#[tokio::test]
async fn cases_that_are_too_old_go_with_their_objects_and_say_before_when() {
    let day = Duration::from_secs(86_400);
    let directory = tempfile::tempdir().unwrap();
    let rows = Rows::in_memory(Arc::new(())).await.unwrap();
    let objects = Objects::in_directory(directory.path()).unwrap();
    let options = Options {
        keep: Some(day),
        ..Options::default()
    };
    let store = Store::on(rows, objects, options).await.unwrap();
    let failure = crate::testing::failure();
    let mut ids = Vec::new();
    for name in ["one", "kept"] {
        ids.push(submit(&store, name).await.unwrap().case.id);
        let claim = crate::testing::claim(&store).await.unwrap();
        assert!(store.finish(&claim, Err(&failure)).await.unwrap());
    }
    let [one, kept] = [ids[0], ids[1]];
    let case = store.case(&one).await.unwrap().unwrap();
    assert_eq!(case.expires_at, Some(case.created_at + day));
    assert!(keep(&store, &kept, true).await);
    let case = store.case(&kept).await.unwrap().unwrap();
    assert_eq!((case.kept, case.expires_at), (true, None));
    let forgotten = Arc::new(Mutex::new(Vec::new()));
    let noted = Arc::clone(&forgotten);
    store.on_delete(move |id| noted.lock().unwrap().push(*id));

    let removed = async |may_go: bool| {
        let removed = upkeep::remove_expired(&store, Removal::Automatic, |_| async move { may_go });
        removed.await.unwrap()
    };
    assert_eq!(removed(true).await, Expired::default());
    store.pass_time(day);
    assert_eq!(removed(false).await, Expired::default());
    let one_removed = Expired {
        removed: 1,
        waiting: None,
    };
    assert_eq!(removed(true).await, one_removed);
    assert_eq!(*forgotten.lock().unwrap(), [one]);
    let left = store
        .cases(&CaseQuery::default(), None, 10)
        .await
        .unwrap()
        .cases;
    let left: Vec<_> = left.iter().map(|listed| listed.case.id).collect();
    assert_eq!(left, [kept]);
    let needed = store.objects_of(&kept).await.unwrap().len();
    assert_eq!(objects_below(directory.path()).len(), needed);
}

/// A store that keeps cases for ten days.
struct Kept {
    rows: Rows,
    objects: Objects,
    store: Store,
}

impl Kept {
    async fn new() -> Self {
        let rows = Rows::in_memory(Arc::new(())).await.unwrap();
        let objects = Objects::new(Arc::new(object_store::memory::InMemory::new()));
        let store = Self::store_on(&rows, &objects).await;
        let kept = Self {
            rows,
            objects,
            store,
        };
        // At one o'clock, so that no day ends meanwhile.
        let now = jiff::Timestamp::now().as_second().unsigned_abs();
        kept.pass(25 * HOUR - Duration::from_secs(now % 86_400));
        kept
    }

    async fn store_on(rows: &Rows, objects: &Objects) -> Store {
        let options = Options {
            keep: Some(10 * DAY),
            ..Options::default()
        };
        Store::on(rows.clone(), objects.clone(), options)
            .await
            .unwrap()
    }

    fn pass(&self, time: Duration) {
        self.store.pass_time(time);
    }

    /// Adds failed cases.
    async fn add(&self, names: [&'static str; 6]) {
        for name in names {
            submit(&self.store, name).await.unwrap();
            let claim = crate::testing::claim(&self.store).await.unwrap();
            assert!(self.store.finish(&claim, Err(&failure())).await.unwrap());
        }
    }

    async fn removed(&self, removal: Removal) -> (usize, Option<Waiting>) {
        removed(&self.store, removal).await
    }
}

async fn removed(store: &Store, removal: Removal) -> (usize, Option<Waiting>) {
    let removed = upkeep::remove_expired(store, removal, |_| async { true });
    let Expired { removed, waiting } = removed.await.unwrap();
    (removed, waiting)
}

const HOUR: Duration = Duration::from_secs(3600);
const DAY: Duration = Duration::from_secs(86_400);

#[tokio::test]
async fn a_clock_that_is_far_ahead_removes_nothing_until_somebody_says_that_it_is_right() {
    let kept = Kept::new().await;
    kept.add(["a", "b", "c", "d", "e", "f"]).await;
    kept.pass(400 * DAY);
    assert_eq!(upkeep::row_counts(&kept.store).await.unwrap().expired, 6);
    let waits = (0, Some(Waiting::Clock));
    for removal in [Removal::Automatic, Removal::Asked, Removal::Automatic] {
        assert_eq!(kept.removed(removal).await, waits);
        kept.pass(HOUR);
    }
    assert_eq!(kept.removed(Removal::Confirmed).await, (6, None));
    assert_eq!(upkeep::row_counts(&kept.store).await.unwrap().expired, 0);
}

#[tokio::test]
async fn what_a_wrong_clock_has_written_does_not_make_it_right() {
    for is_seen_before in [true, false] {
        let kept = Kept::new().await;
        let (rows, objects) = (kept.rows.clone(), kept.objects.clone());
        let removes_nothing = Store::on(rows, objects, Options::default()).await.unwrap();
        let look = async || removed(&removes_nothing, Removal::Automatic).await;
        kept.add(["a", "b", "c", "d", "e", "f"]).await;
        if is_seen_before {
            assert_eq!(look().await, (0, None));
        }
        kept.pass(400 * DAY);
        assert_eq!(look().await, (0, None));
        kept.add(["g", "h", "i", "j", "k", "l"]).await;
        let waits = (0, Some(Waiting::Clock));
        assert_eq!(kept.removed(Removal::Asked).await, waits);
        assert_eq!(kept.removed(Removal::Confirmed).await, (6, None));
    }
}

#[tokio::test]
async fn a_process_removes_nothing_by_itself_in_its_first_hour_and_a_person_may() {
    let kept = Kept::new().await;
    kept.add(["a", "b", "c", "d", "e", "f"]).await;
    for _ in 0..2 {
        assert_eq!(kept.removed(Removal::Automatic).await, (0, None));
        kept.pass(5 * DAY);
    }
    let started = Kept::store_on(&kept.rows, &kept.objects).await;
    let waits = (0, Some(Waiting::FirstHour));
    assert_eq!(removed(&started, Removal::Automatic).await, waits);
    kept.pass(HOUR - Duration::from_secs(60));
    assert_eq!(removed(&started, Removal::Automatic).await, waits);
    assert_eq!(removed(&started, Removal::Asked).await, (6, None));
    kept.add(["a", "b", "c", "d", "e", "f"]).await;
    for _ in 0..2 {
        kept.pass(5 * DAY);
        kept.removed(Removal::Automatic).await;
    }
    assert_eq!(upkeep::row_counts(&kept.store).await.unwrap().expired, 0);
}

#[tokio::test]
async fn twice_as_many_cases_go_in_a_day_as_came_on_one() {
    let kept = Kept::new().await;
    for names in [
        ["a", "b", "c", "d", "e", "f"],
        ["g", "h", "i", "j", "k", "l"],
        ["m", "n", "o", "p", "q", "r"],
        ["s", "t", "u", "v", "w", "x"],
    ] {
        kept.add(names).await;
        kept.pass(DAY);
        assert_eq!(kept.removed(Removal::Automatic).await, (0, None));
    }
    kept.pass(6 * DAY);
    assert_eq!(kept.removed(Removal::Automatic).await, (6, None));
    // The others become too old at once: the clock is a few days ahead.
    kept.pass(5 * DAY);
    assert_eq!(upkeep::row_counts(&kept.store).await.unwrap().expired, 18);
    let waits = Some(Waiting::Day);
    assert_eq!(kept.removed(Removal::Automatic).await, (12, waits));
    for removal in [Removal::Automatic, Removal::Asked] {
        assert_eq!(kept.removed(removal).await, (0, waits));
    }
    assert_eq!(upkeep::row_counts(&kept.store).await.unwrap().expired, 6);
    kept.pass(DAY);
    assert_eq!(kept.removed(Removal::Automatic).await, (6, None));
}

#[tokio::test]
async fn a_manifest_goes_before_the_source_that_it_names() {
    let directory = tempfile::tempdir().unwrap();
    let store = movable(&directory).await;
    let id = submit(&store, "volume").await.unwrap().case.id;
    let of = |kind: &str| crate::testing::files_below(&directory.path().join(kind));
    let file = of("source-volume").remove(0);
    // A folder in its place cannot be removed like a file.
    std::fs::remove_file(&file).unwrap();
    std::fs::create_dir(&file).unwrap();
    store.delete(&id).await.unwrap_err();
    assert_eq!(of("manifest").len(), 0);
}

#[tokio::test]
async fn what_was_being_written_when_the_rows_were_saved_is_not_removed_after_a_restore() {
    let directory = tempfile::tempdir().unwrap();
    let saved = movable(&directory).await;
    let source = put(&saved, "source").await;
    let held = pinned(&saved, &[source]).await;
    // Whoever wrote it is done since.
    upkeep::forget_writers(&saved).await.unwrap();
    saved.pass_time(Duration::from_secs(7200));
    saved.collect().await.unwrap();
    assert!(saved.objects().get(&source).await.is_ok());
    let found = upkeep::unreferenced_of(&saved, ObjectKind::Volume)
        .await
        .unwrap();
    assert_eq!(found, [source]);
    // A writer that is still at work notices that its pin is gone.
    let new = NewCase {
        sources: held,
        ..crate::testing::new_case(&saved, "another").await
    };
    assert_eq!(saved.insert_case(&new).await.unwrap(), Referred::PinLost);
}
