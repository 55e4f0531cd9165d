//! What every implementation of the rows, and every object store, must do. One suite, run on each of them.

use std::sync::Arc;

use super::frame::frame;
use super::objects::Unreadable;
use super::rows::{CaseRows, Inserted, NewCase, Published, Release};
use super::testing::{at, claim, facts, failure, name, new_case, pinned};
use super::{Objects, SqliteRows};
use case::{CaseState, ObjectKind, Parameters, Progress, Stage};

/// An implementation, and what must live as long.
struct Subject<T> {
    subject: T,
    _directory: Option<tempfile::TempDir>,
}

async fn rows_in_memory() -> Subject<Arc<dyn CaseRows>> {
    let rows = SqliteRows::in_memory().await.unwrap();
    Subject {
        subject: Arc::new(rows),
        _directory: None,
    }
}

async fn rows_in_a_file() -> Subject<Arc<dyn CaseRows>> {
    let directory = tempfile::tempdir().unwrap();
    let rows = SqliteRows::open(&directory.path().join("rows.sqlite"))
        .await
        .unwrap();
    Subject {
        subject: Arc::new(rows),
        _directory: Some(directory),
    }
}

async fn objects_in_memory() -> Subject<Objects> {
    let files = Arc::new(object_store::memory::InMemory::new());
    Subject {
        subject: Objects::new(files),
        _directory: None,
    }
}

async fn objects_in_a_directory() -> Subject<Objects> {
    let directory = tempfile::tempdir().unwrap();
    let objects = Objects::in_directory(directory.path()).unwrap();
    Subject {
        subject: objects,
        _directory: Some(directory),
    }
}

macro_rules! suite {
    ($($implementation:ident: $($check:ident),+;)+) => {$(
        mod $implementation {
            $(
                #[tokio::test]
                async fn $check() {
                    let subject = super::$implementation().await;
                    super::$check(&subject.subject).await;
                }
            )+
        }
    )+};
}

macro_rules! rows_suite {
    ($($implementation:ident)+) => {
        suite! {$(
            $implementation:
                a_case_is_inserted_once,
                a_case_is_renamed,
                cases_are_listed_newest_first_in_pages,
                no_more_jobs_wait_than_may,
                a_failed_case_is_queued_again,
                without_its_pins_nothing_is_inserted_or_published,
                jobs_are_leased_in_their_order_and_once,
                an_ended_lease_goes_to_another_and_fences_the_first_off,
                a_job_fails_after_so_many_attempts,
                a_lease_handed_back_need_not_count,
                a_published_case_is_ready_and_its_job_is_gone,
                progress_is_told_and_a_lease_renewed,
                what_two_cases_need_goes_with_the_second,
                a_pin_protects_until_it_expires,
                a_removal_that_is_dropped_changes_nothing,
                a_deleted_case_cannot_be_published,
                a_ready_case_gets_other_objects_or_fails,
                holders_that_are_dead_hold_nothing;
        )+}
    };
}

rows_suite! { rows_in_memory rows_in_a_file }

suite! {
    objects_in_memory: an_object_comes_back_and_goes, a_damaged_object_is_told_and_written_over, a_large_file_comes_back;
    objects_in_a_directory: an_object_comes_back_and_goes, a_damaged_object_is_told_and_written_over, a_large_file_comes_back;
}

type Rows = Arc<dyn CaseRows>;

async fn insert(rows: &Rows, contents: &str, second: i64) -> NewCase {
    let new = new_case(&**rows, contents, at(second)).await;
    assert_eq!(rows.insert(&new).await.unwrap(), Inserted::Created);
    new
}

async fn derived(rows: &Rows, contents: &str) -> super::rows::Pinned {
    let names = ObjectKind::DERIVED.map(|kind| name(kind, contents));
    pinned(&**rows, &names).await
}

async fn state(rows: &Rows, new: &NewCase) -> Option<CaseState> {
    rows.case(&new.id).await.unwrap().map(|case| case.state)
}

async fn a_case_is_inserted_once(rows: &Rows) {
    let mut new = new_case(&**rows, "a", at(5)).await;
    new.parameters = Parameters {
        closing_radius_mm: 7.5,
        mask_kind: case::MaskKind::Envelope,
        offset_mm: -0.3,
        name: Some("näme".to_owned()),
        ..Parameters::default()
    };
    assert_eq!(rows.insert(&new).await.unwrap(), Inserted::Created);
    assert_eq!(rows.insert(&new).await.unwrap(), Inserted::Exists);
    let case = rows.case(&new.id).await.unwrap().unwrap();
    assert_eq!((case.state, case.created_at), (CaseState::Queued, at(5)));
    assert_eq!(case.parameters, new.parameters);
    assert_eq!(
        (case.progress, case.failure, case.facts),
        (None, None, None)
    );
    assert_eq!(rows.objects(&new.id).await.unwrap(), new.sources.names);
    assert_eq!(rows.waiting().await.unwrap(), 1);
}

async fn a_case_is_renamed(rows: &Rows) {
    let new = insert(rows, "one", 1).await;
    rows.rename(&new.id, "another name").await.unwrap();
    let case = rows.case(&new.id).await.unwrap().expect("the case");
    assert_eq!(case.parameters.name.as_deref(), Some("another name"));
    rows.rename(&insert(rows, "two", 2).await.id, "its own")
        .await
        .unwrap();
    let case = rows.case(&new.id).await.unwrap().expect("the case");
    assert_eq!(case.parameters.name.as_deref(), Some("another name"));
}

async fn cases_are_listed_newest_first_in_pages(rows: &Rows) {
    let mut expected = Vec::new();
    for number in 0..7i64 {
        // Some are of the same moment.
        expected.push(insert(rows, &number.to_string(), number / 2).await);
    }
    expected.sort_by_key(|new| std::cmp::Reverse((new.now, new.id)));
    let mut listed = Vec::new();
    let mut cursor = None;
    for length in [3, 3, 1] {
        let page = rows.cases(cursor.as_ref(), 3).await.unwrap();
        assert_eq!(page.cases.len(), length);
        listed.extend(page.cases.into_iter().map(|case| case.id));
        cursor = page.next;
    }
    assert_eq!(cursor, None);
    assert!(
        listed
            .into_iter()
            .eq(expected.into_iter().map(|new| new.id))
    );
}

async fn no_more_jobs_wait_than_may(rows: &Rows) {
    insert(rows, "a", 0).await;
    let mut new = new_case(&**rows, "b", at(1)).await;
    new.queue_limit = 1;
    assert_eq!(rows.insert(&new).await.unwrap(), Inserted::QueueFull);
    assert_eq!(state(rows, &new).await, None);
    // A leased job does not wait.
    claim(&**rows, 2).await.unwrap();
    assert_eq!(rows.insert(&new).await.unwrap(), Inserted::Created);
}

async fn a_failed_case_is_queued_again(rows: &Rows) {
    let new = insert(rows, "a", 0).await;
    let leased = claim(&**rows, 1).await.unwrap();
    assert!(rows.fail(&leased, &failure()).await.unwrap());
    let failed = rows.case(&new.id).await.unwrap().unwrap();
    assert_eq!(
        (failed.state, failed.failure),
        (CaseState::Failed, Some(failure()))
    );
    assert_eq!(claim(&**rows, 2).await, None);
    let again = new_case(&**rows, "a", at(3)).await;
    assert_eq!(rows.insert(&again).await.unwrap(), Inserted::Requeued);
    let queued = rows.case(&new.id).await.unwrap().unwrap();
    assert_eq!(
        (queued.state, queued.failure, queued.created_at),
        (CaseState::Queued, None, at(0))
    );
    assert_eq!(claim(&**rows, 4).await.unwrap().attempt, 1);
}

async fn without_its_pins_nothing_is_inserted_or_published(rows: &Rows) {
    let new = new_case(&**rows, "a", at(0)).await;
    rows.unpin(&new.sources, at(1)).await.unwrap();
    let removal = rows.begin_removal(&new.sources.names, at(1)).await.unwrap();
    removal.finish().await.unwrap();
    assert_eq!(rows.insert(&new).await.unwrap(), Inserted::PinLost);
    assert_eq!(state(rows, &new).await, None);

    insert(rows, "a", 2).await;
    let leased = claim(&**rows, 3).await.unwrap();
    let unpinned = super::rows::Pinned {
        holder: "nobody has pinned it".to_owned(),
        names: ObjectKind::DERIVED.map(|kind| name(kind, "a")).into(),
    };
    let published = rows
        .publish(&leased, &unpinned, &facts(), at(4))
        .await
        .unwrap();
    assert_eq!(published, Published::PinLost);
    assert_eq!(state(rows, &new).await, Some(CaseState::Preparing));
    assert!(rows.renew(&leased, at(60), None).await.unwrap());
}

async fn jobs_are_leased_in_their_order_and_once(rows: &Rows) {
    let [first, second] = [insert(rows, "a", 0).await, insert(rows, "b", 1).await];
    let leased = claim(&**rows, 2).await.unwrap();
    assert_eq!((leased.id, leased.attempt), (first.id, 1));
    assert_eq!(
        (leased.parameters, leased.sources),
        (first.parameters.clone(), first.sources.names.clone())
    );
    assert_eq!(state(rows, &first).await, Some(CaseState::Preparing));
    assert_eq!(claim(&**rows, 2).await.unwrap().id, second.id);
    assert_eq!(claim(&**rows, 2).await, None);
}

async fn an_ended_lease_goes_to_another_and_fences_the_first_off(rows: &Rows) {
    let new = insert(rows, "a", 0).await;
    let first = claim(&**rows, 0).await.unwrap();
    assert_eq!(claim(&**rows, 29).await, None);
    let second = claim(&**rows, 30).await.unwrap();
    assert!(second.fence > first.fence && second.attempt == 2);

    let release = Release {
        available_at: at(31),
        counts: true,
    };
    assert!(!rows.renew(&first, at(90), None).await.unwrap());
    assert!(!rows.release(&first, release).await.unwrap());
    assert!(!rows.fail(&first, &failure()).await.unwrap());
    let late = derived(rows, "a").await;
    let published = rows.publish(&first, &late, &facts(), at(31)).await.unwrap();
    assert_eq!(published, Published::Fenced);
    assert_eq!(state(rows, &new).await, Some(CaseState::Preparing));

    let published = rows
        .publish(&second, &late, &facts(), at(32))
        .await
        .unwrap();
    assert_eq!(published, Published::Done);
}

async fn a_job_fails_after_so_many_attempts(rows: &Rows) {
    let new = insert(rows, "a", 0).await;
    let other = insert(rows, "b", 1).await;
    for attempt in 1..=3 {
        let leased = claim(&**rows, 100 * i64::from(attempt)).await.unwrap();
        assert_eq!((leased.id, leased.attempt), (new.id, attempt));
    }
    // The next look gives it up and goes on.
    assert_eq!(claim(&**rows, 1000).await.unwrap().id, other.id);
    let failed = rows.case(&new.id).await.unwrap().unwrap();
    assert_eq!(failed.state, CaseState::Failed);
    assert_eq!(failed.failure.unwrap().name, "preparation-interrupted");
}

async fn a_lease_handed_back_need_not_count(rows: &Rows) {
    let new = insert(rows, "a", 0).await;
    for (second, counts, attempt) in [(1, false, 1), (2, true, 1), (3, false, 2), (4, true, 2)] {
        let leased = claim(&**rows, second).await.unwrap();
        assert_eq!(leased.attempt, attempt);
        let release = Release {
            available_at: at(second + 1),
            counts,
        };
        assert!(rows.release(&leased, release).await.unwrap());
        assert_eq!(state(rows, &new).await, Some(CaseState::Queued));
        assert!(!rows.renew(&leased, at(90), None).await.unwrap());
        // Not before its time.
        assert_eq!(claim(&**rows, second).await, None);
    }
}

async fn a_published_case_is_ready_and_its_job_is_gone(rows: &Rows) {
    let new = insert(rows, "a", 0).await;
    let leased = claim(&**rows, 1).await.unwrap();
    let derived = derived(rows, "a").await;
    let published = rows
        .publish(&leased, &derived, &facts(), at(2))
        .await
        .unwrap();
    assert_eq!(published, Published::Done);
    let case = rows.case(&new.id).await.unwrap().unwrap();
    assert_eq!(
        (case.state, case.facts, case.progress),
        (CaseState::Ready, Some(facts()), None)
    );
    let objects = rows.objects(&new.id).await.unwrap();
    assert_eq!(objects.len(), 1 + ObjectKind::DERIVED.len());
    assert!(derived.names.iter().all(|name| objects.contains(name)));
    assert_eq!(claim(&**rows, 1000).await, None);
    assert!(rows.expired_pins(at(100_000), 10).await.unwrap().is_empty());
}

async fn progress_is_told_and_a_lease_renewed(rows: &Rows) {
    let new = insert(rows, "a", 0).await;
    let leased = claim(&**rows, 0).await.unwrap();
    let progress = Progress {
        stage: Stage::Forest,
        fraction: 0.5,
    };
    assert!(rows.renew(&leased, at(60), Some(progress)).await.unwrap());
    assert_eq!(
        rows.case(&new.id).await.unwrap().unwrap().progress,
        Some(progress)
    );
    assert_eq!(claim(&**rows, 59).await, None);
    assert!(claim(&**rows, 60).await.is_some());
    assert_eq!(rows.case(&new.id).await.unwrap().unwrap().progress, None);
}

async fn removable(
    rows: &Rows,
    names: &[super::ObjectName],
    second: i64,
) -> Vec<super::ObjectName> {
    let removal = rows.begin_removal(names, at(second)).await.unwrap();
    let names = removal.names().to_vec();
    removal.finish().await.unwrap();
    names
}

async fn what_two_cases_need_goes_with_the_second(rows: &Rows) {
    let first = insert(rows, "a", 0).await;
    let mut second = new_case(&**rows, "a", at(1)).await;
    let other_radius = Parameters {
        closing_radius_mm: 5.0,
        ..Parameters::default()
    };
    second.id = case::CaseId::of(&second.sources.names[0].digest, None, &other_radius);
    assert_eq!(rows.insert(&second).await.unwrap(), Inserted::Created);

    assert!(rows.delete(&first.id, at(2)).await.unwrap());
    assert!(!rows.delete(&first.id, at(2)).await.unwrap());
    let looked_at = rows.expired_pins(at(2), 10).await.unwrap();
    assert_eq!(looked_at, first.sources.names);
    assert_eq!(removable(rows, &looked_at, 2).await, []);
    assert!(rows.expired_pins(at(2), 10).await.unwrap().is_empty());

    assert!(rows.delete(&second.id, at(3)).await.unwrap());
    let looked_at = rows.expired_pins(at(3), 10).await.unwrap();
    assert_eq!(removable(rows, &looked_at, 3).await, first.sources.names);
    assert!(rows.expired_pins(at(3), 10).await.unwrap().is_empty());
}

async fn a_pin_protects_until_it_expires(rows: &Rows) {
    let names = [name(ObjectKind::Volume, "a")];
    pinned(&**rows, &names).await;
    let shorter = pinned(&**rows, &names).await;
    rows.unpin(&shorter, at(10)).await.unwrap();
    // One of two pins has expired.
    assert_eq!(rows.expired_pins(at(10), 10).await.unwrap(), names);
    assert_eq!(removable(rows, &names, 10).await, []);
    assert!(rows.expired_pins(at(3599), 10).await.unwrap().is_empty());
    assert_eq!(rows.expired_pins(at(3600), 10).await.unwrap(), names);
    assert_eq!(removable(rows, &names, 3600).await, names);
}

async fn a_removal_that_is_dropped_changes_nothing(rows: &Rows) {
    let names = [name(ObjectKind::Volume, "a")];
    let pins = pinned(&**rows, &names).await;
    rows.unpin(&pins, at(1)).await.unwrap();
    drop(rows.begin_removal(&names, at(1)).await.unwrap());
    assert_eq!(rows.expired_pins(at(1), 10).await.unwrap(), names);
}

async fn a_deleted_case_cannot_be_published(rows: &Rows) {
    let new = insert(rows, "a", 0).await;
    let leased = claim(&**rows, 1).await.unwrap();
    assert!(rows.delete(&new.id, at(2)).await.unwrap());
    assert!(!rows.renew(&leased, at(60), None).await.unwrap());
    // The same again is another job: the first one's lease has nothing to do with it.
    insert(rows, "a", 3).await;
    claim(&**rows, 4).await.unwrap();
    let late = derived(rows, "a").await;
    let published = rows.publish(&leased, &late, &facts(), at(5)).await.unwrap();
    assert_eq!(published, Published::Fenced);
}

async fn a_ready_case_gets_other_objects_or_fails(rows: &Rows) {
    let new = insert(rows, "a", 0).await;
    let others = derived(rows, "b").await;
    assert_eq!(
        rows.replace(&new.id, &others, at(1)).await.unwrap(),
        Published::Fenced
    );
    assert!(!rows.condemn(&new.id, &failure()).await.unwrap());

    let leased = claim(&**rows, 1).await.unwrap();
    let first = derived(rows, "a").await;
    rows.publish(&leased, &first, &facts(), at(2))
        .await
        .unwrap();
    assert_eq!(
        rows.replace(&new.id, &others, at(3)).await.unwrap(),
        Published::Done
    );
    let objects = rows.objects(&new.id).await.unwrap();
    assert!(others.names.iter().all(|name| objects.contains(name)));
    let mut dropped = rows.expired_pins(at(3), 10).await.unwrap();
    dropped.sort_by_key(|name| name.kind);
    assert_eq!(dropped, first.names);

    assert!(rows.condemn(&new.id, &failure()).await.unwrap());
    assert_eq!(state(rows, &new).await, Some(CaseState::Failed));
}

async fn holders_that_are_dead_hold_nothing(rows: &Rows) {
    let new = insert(rows, "a", 0).await;
    claim(&**rows, 1).await.unwrap();
    let names = [name(ObjectKind::Volume, "a")];
    pinned(&**rows, &names).await;
    rows.forget_holders(at(2)).await.unwrap();
    assert_eq!(claim(&**rows, 2).await.unwrap().id, new.id);
    assert_eq!(rows.expired_pins(at(2), 10).await.unwrap(), names);
}

async fn an_object_comes_back_and_goes(objects: &Objects) {
    let framed = frame(ObjectKind::Forest, vec![7; 5000].into());
    assert!(matches!(
        objects.get(&framed.name).await,
        Err(Unreadable::Missing)
    ));
    objects.put(&framed).await.unwrap();
    assert_eq!(objects.get(&framed.name).await.unwrap(), vec![7; 5000]);
    assert_eq!(objects.list().await.unwrap(), [framed.name]);
    objects.delete(&framed.name).await.unwrap();
    objects.delete(&framed.name).await.unwrap();
    assert!(matches!(
        objects.get(&framed.name).await,
        Err(Unreadable::Missing)
    ));
    objects.check().await.unwrap();
}

async fn a_damaged_object_is_told_and_written_over(objects: &Objects) {
    let mut framed = frame(ObjectKind::Volume, (0..200).collect::<Vec<u8>>().into());
    let sound = framed.clone();
    let mut payload = framed.payload.to_vec();
    payload[100] ^= 1;
    framed.payload = payload.into();
    objects.put(&framed).await.unwrap();
    assert!(matches!(
        objects.get(&framed.name).await,
        Err(Unreadable::Damaged(_))
    ));
    objects.put(&sound).await.unwrap();
    assert!(objects.get(&framed.name).await.is_ok());
}

async fn a_large_file_comes_back(objects: &Objects) {
    // Three parts, of which the last is short; with the header the second ends in the file's middle.
    for length in [0, 1, (16 << 20) - 72, 17_000_000] {
        let mut contents = vec![0; length];
        blake3::Hasher::new().finalize_xof().fill(&mut contents);
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), &contents).unwrap();
        let digest = blake3::hash(&contents);
        let name = super::ObjectName {
            kind: ObjectKind::SourceVolume,
            digest,
        };
        objects
            .put_file(&name, file.path(), length as u64)
            .await
            .unwrap();
        assert!(
            objects.get(&name).await.unwrap() == contents,
            "{length} bytes"
        );
    }
}
