//! Checks of a store: one suite, for SQLite in memory and in a file, and for PostgreSQL.

mod findings;
mod layers;
mod objects;
mod preferences;
mod readings;
mod series;
mod worklist;

use std::sync::Arc;
use std::time::Duration;

use case::{
    CaseFacts, CaseId, CaseState, JobKind, JobState, ObjectKind, Parameters, Progress, Stage,
    VoxelFacts,
};

pub(crate) use self::findings::*;
pub(crate) use self::layers::*;
pub(crate) use self::preferences::*;
pub(crate) use self::readings::*;
pub(crate) use self::series::*;
pub(crate) use self::worklist::*;

use super::jobs::{JobQuery, NewJob, Release};
use super::label::Label;
use super::objects::Objects;
use super::rows::{NewCase, Pinned, Published, Referred, Sweep};
use super::sql::Rows;
use super::tables::{cases, jobs};
use super::testing::{claim, facts, failure, job, keep, name, new_case, pinned, rename, waiting};
use super::upkeep::{self, Aged, Allowance, Removal};
use super::{CaseQuery, Listed, ObjectName, Options, Store, StoreError};

/// The lease of jobs in these checks.
const LEASE: Duration = Duration::from_secs(30);

/// A store to check.
pub(crate) struct Subject {
    /// The store, empty.
    pub(crate) store: Store,
    /// A resource that must live as long.
    _keep: Box<dyn std::any::Any + Send + Sync>,
}

impl Subject {
    /// On these rows, with objects in memory.
    pub(crate) async fn new(rows: Rows, keep: impl Send + Sync + 'static) -> Self {
        let objects = Objects::new(Arc::new(object_store::memory::InMemory::new()));
        if let Some(id) = rows.store_id().await.unwrap() {
            // Rows of before, whose objects have ended.
            objects.put_label(&Label::Id(id)).await.unwrap();
        }
        Self {
            store: Store::on(rows, objects, Options::default()).await.unwrap(),
            _keep: Box::new(keep),
        }
    }

    pub(crate) async fn in_memory() -> Self {
        Self::new(Rows::in_memory(Arc::new(())).await.unwrap(), ()).await
    }

    async fn in_a_file() -> Self {
        let directory = tempfile::tempdir().unwrap();
        let rows = Rows::sqlite(&directory.path().join("rows.sqlite"), Arc::new(())).await;
        Self::new(rows.unwrap(), directory).await
    }

    pub(crate) fn pass(&self, seconds: u64) {
        self.store.pass_time(Duration::from_secs(seconds));
    }
}

/// `conformance! { a_name: make_subject }` writes a test for each check; `conformance! { in_turn make_subject }` is a
/// block that awaits all of them, for a database that is slow to start.
macro_rules! conformance {
    ($($implementation:ident: $make:path),+ $(,)?) => {$(
        mod $implementation {
            use super::*;
            $crate::conformance::conformance! { @list tests $make }
        }
    )+};
    (in_turn $make:expr) => {
        $crate::conformance::conformance! { @list in_turn $make }
    };
    (@list $how:ident $make:tt) => {
            $crate::conformance::conformance! { @$how $make;
                a_case_is_inserted_once
                a_case_is_renamed
                cases_are_listed_newest_first_in_pages
                no_more_jobs_wait_than_may
                one_client_takes_a_quarter_of_the_queue
                a_failed_case_is_queued_again
                without_its_pins_nothing_is_inserted_or_published
                jobs_are_leased_in_their_order_and_once
                an_ended_lease_goes_to_another_and_fences_the_first_off
                a_job_fails_after_so_many_attempts
                a_lease_handed_back_need_not_count
                clients_take_turns_with_their_preparations
                a_published_case_is_ready_and_its_job_is_gone
                progress_is_told_and_a_lease_renewed
                what_two_cases_need_goes_with_the_second
                a_case_expires_unless_it_is_kept_or_uploaded_again
                as_many_cases_expire_in_a_day_as_may
                a_clock_that_jumps_is_doubted_until_somebody_says_that_it_is_right
                a_pin_protects_until_it_expires
                what_is_being_removed_cannot_be_pinned
                a_sweep_that_was_killed_is_finished_by_another
                a_sweep_buries_its_own_tombstones_alone
                a_deleted_case_cannot_be_published
                a_ready_case_gets_other_objects_or_fails
                a_job_is_open_once_and_its_end_is_kept_for_a_while
                jobs_are_listed_and_counted_by_kind_and_state
                a_job_that_needs_a_case_waits_for_it_and_goes_with_it
                a_case_of_another_store_is_copied_as_it_is_there
                ready_cases_are_found_by_their_voxels
                what_nobody_needs_is_told
                holders_that_are_dead_hold_nothing
                cases_are_found_by_their_series
                a_case_and_its_series_are_written_together_and_what_is_lost_of_it_comes_again
                cases_are_searched_by_what_they_are_and_whose
                a_list_states_what_is_to_be_done_and_is_sorted_by_it
                a_list_is_paged_by_position_and_leaves_the_trash_out
                cases_are_found_by_the_rating_of_their_masks
                a_layer_is_inserted_once_and_as_many_as_may
                layers_are_named_and_ordered
                a_layer_is_leased_once_its_case_is_ready
                a_layer_that_waits_fails_with_its_case
                a_layer_fails_and_is_queued_again
                a_lost_object_of_a_layer_is_made_again_and_its_place_stays
                a_version_keeps_the_layers_of_its_case
                a_layer_of_a_deleted_case_cannot_be_published
                a_layer_of_another_store_is_copied_as_it_is_there
                findings_are_replaced_by_whoever_knows_them
                findings_go_with_their_case
                a_version_begins_with_the_findings_of_its_case
                a_change_of_findings_makes_a_case_young_again
                damaged_findings_are_never_shown
                a_reading_is_changed_until_it_is_signed_and_corrected_by_its_next_version
                readings_belong_to_their_readers_and_go_with_their_case
                a_damaged_reading_is_never_shown
                preferences_are_of_one_user_and_replaced_by_whoever_knows_them
            }
    };
    (@in_turn $make:expr; $($check:ident)+) => {{
        $(
            println!("{}", stringify!($check));
            // In a box: all of them in one future would not fit into the stack.
            Box::pin(async { $crate::conformance::$check(&$make().await).await }).await;
        )+
    }};
    (@tests $make:path; $($check:ident)+) => {$(
        #[tokio::test]
        async fn $check() {
            $crate::conformance::$check(&$make().await).await;
        }
    )+};
}

pub(crate) use conformance;

conformance! {
    memory: Subject::in_memory,
    file: Subject::in_a_file,
}

async fn insert(store: &Store, contents: &str) -> NewCase {
    let new = new_case(store, contents).await;
    assert!(matches!(
        store.insert_case(&new).await.unwrap(),
        Referred::Done(_)
    ));
    new
}

async fn derived(store: &Store, contents: &str) -> Pinned {
    let names = ObjectKind::DERIVED.map(|kind| name(kind, contents));
    pinned(store, &names).await
}

async fn state(store: &Store, new: &NewCase) -> Option<CaseState> {
    store.case(&new.id).await.unwrap().map(|case| case.state)
}

pub(crate) async fn a_case_is_inserted_once(subject: &Subject) {
    let store = &subject.store;
    let mut new = new_case(store, "a").await;
    new.parameters = Parameters {
        closing_radius_mm: 7.5,
        mask_kind: case::MaskKind::Envelope,
        offset_mm: -0.3,
        name: Some("näme".to_owned()),
        ..Parameters::default()
    };
    assert!(matches!(
        store.insert_case(&new).await.unwrap(),
        Referred::Done(_)
    ));
    assert!(matches!(
        store.insert_case(&new).await.unwrap(),
        Referred::Unneeded(_)
    ));
    let case = store.case(&new.id).await.unwrap().unwrap();
    assert_eq!(case.state, CaseState::Queued);
    assert_eq!(case.parameters, new.parameters);
    assert_eq!(
        (case.progress, case.failure, case.facts),
        (None, None, None)
    );
    assert_eq!(store.objects_of(&new.id).await.unwrap(), new.sources.names);
    assert_eq!(waiting(store, JobKind::PREPARE).await, 1);
}

pub(crate) async fn a_case_is_renamed(subject: &Subject) {
    let store = &subject.store;
    let new = insert(store, "one").await;
    rename(store, &new.id, "another name").await;
    let case = store.case(&new.id).await.unwrap().expect("the case");
    assert_eq!(case.parameters.name.as_deref(), Some("another name"));
    rename(store, &insert(store, "two").await.id, "its own").await;
    let case = store.case(&new.id).await.unwrap().expect("the case");
    assert_eq!(case.parameters.name.as_deref(), Some("another name"));
}

pub(crate) async fn cases_are_listed_newest_first_in_pages(subject: &Subject) {
    let store = &subject.store;
    let mut expected = Vec::new();
    for number in 0..7i64 {
        let id = insert(store, &number.to_string()).await.id;
        let case = store.case(&id).await.unwrap().unwrap();
        expected.push((case.created_at, id));
        // Some may be of the same moment.
        if number % 2 == 1 {
            subject.pass(1);
        }
    }
    expected.sort_by_key(|&new| std::cmp::Reverse(new));
    let mut listed = Vec::new();
    let mut cursor = None;
    for length in [3, 3, 1] {
        let page = store
            .cases(&CaseQuery::default(), cursor.as_ref(), 3)
            .await
            .unwrap();
        assert_eq!(page.cases.len(), length);
        listed.extend(
            page.cases
                .into_iter()
                .map(|Listed { case, .. }| (case.created_at, case.id)),
        );
        cursor = page.next;
    }
    assert_eq!(cursor, None);
    assert_eq!(listed, expected);
}

pub(crate) async fn no_more_jobs_wait_than_may(subject: &Subject) {
    let store = &subject.store;
    insert(store, "a").await;
    let mut new = new_case(store, "b").await;
    new.queue_limit = 1;
    let full = store.insert_case(&new).await;
    assert!(matches!(full, Err(StoreError::QueueFull(_))));
    assert_eq!(state(store, &new).await, None);
    // A leased job does not wait.
    claim(store).await.unwrap();
    assert!(matches!(
        store.insert_case(&new).await.unwrap(),
        Referred::Done(_)
    ));
}

pub(crate) async fn one_client_takes_a_quarter_of_the_queue(subject: &Subject) {
    let store = &subject.store;
    let insert = async |contents: String, client: &str| {
        let new = NewCase {
            client: client.to_owned(),
            queue_limit: 8,
            ..new_case(store, &contents).await
        };
        store.insert_case(&new).await
    };
    let wait_of =
        async |contents: &str, client: &str| match insert(contents.to_owned(), client).await {
            Err(StoreError::QueueFull(wait)) => wait.as_secs(),
            other => panic!("{other:?}"),
        };
    let [greedy, other] = ["greedy", "other"];
    for number in 0..2 {
        insert(format!("greedy {number}"), greedy).await.unwrap();
    }
    subject.pass(10);
    // Nothing has ended yet, and the first has waited for so long.
    // The clock of a database goes on by itself.
    assert!((10..13).contains(&wait_of("third", greedy).await));
    insert("other".to_owned(), other).await.unwrap();
    subject.pass(20);
    for _ in 0..2 {
        let leased = claim(store).await.unwrap();
        assert!(store.finish(&leased, Err(&failure())).await.unwrap());
        subject.pass(5);
    }
    // One of this client and the one of the other have ended meanwhile, and one waits.
    insert("third".to_owned(), greedy).await.unwrap();
    assert!((30..33).contains(&wait_of("fourth", greedy).await));
    // Two of eight are taken.
    for number in 0..6 {
        let name = format!("another {number}");
        insert(name.clone(), &name).await.unwrap();
    }
    wait_of("late", "late").await;
    wait_of("late", "").await;
}

pub(crate) async fn a_failed_case_is_queued_again(subject: &Subject) {
    let store = &subject.store;
    let new = insert(store, "a").await;
    let created_at = store.case(&new.id).await.unwrap().unwrap().created_at;
    let leased = claim(store).await.unwrap();
    assert!(store.finish(&leased, Err(&failure())).await.unwrap());
    let failed = store.case(&new.id).await.unwrap().unwrap();
    assert_eq!(
        (failed.state, failed.failure),
        (CaseState::Failed, Some(failure()))
    );
    assert_eq!(claim(store).await, None);
    subject.pass(3);
    insert(store, "a").await;
    let queued = store.case(&new.id).await.unwrap().unwrap();
    assert_eq!(
        (queued.state, queued.failure, queued.created_at),
        (CaseState::Queued, None, created_at)
    );
    assert_eq!(claim(store).await.unwrap().attempt, 1);
}

pub(crate) async fn without_its_pins_nothing_is_inserted_or_published(subject: &Subject) {
    let store = &subject.store;
    let new = new_case(store, "a").await;
    store.unpin(&new.sources).await.unwrap();
    assert_eq!(removed(store, &new.sources.names).await, new.sources.names);
    assert_eq!(store.insert_case(&new).await.unwrap(), Referred::PinLost);
    assert_eq!(state(store, &new).await, None);

    insert(store, "a").await;
    let leased = claim(store).await.unwrap();
    let unpinned = Pinned {
        holder: "nobody has pinned it".to_owned(),
        names: ObjectKind::DERIVED.map(|kind| name(kind, "a")).into(),
    };
    let published = store
        .make_case_ready(&leased, &unpinned, &facts(), &[])
        .await
        .unwrap();
    assert_eq!(published, Referred::PinLost);
    assert_eq!(state(store, &new).await, Some(CaseState::Preparing));
    assert!(store.renew(&leased, None).await.unwrap());
}

pub(crate) async fn jobs_are_leased_in_their_order_and_once(subject: &Subject) {
    let store = &subject.store;
    let first = insert(store, "a").await;
    subject.pass(1);
    let second = insert(store, "b").await;
    let leased = claim(store).await.unwrap();
    assert_eq!((leased.case, leased.attempt), (Some(first.id), 1));
    assert_eq!(state(store, &first).await, Some(CaseState::Preparing));
    assert_eq!(claim(store).await.unwrap().case.unwrap(), second.id);
    assert_eq!(claim(store).await, None);
}

pub(crate) async fn an_ended_lease_goes_to_another_and_fences_the_first_off(subject: &Subject) {
    let store = &subject.store;
    let new = insert(store, "a").await;
    let first = claim(store).await.unwrap();
    subject.pass(29);
    assert_eq!(claim(store).await, None);
    subject.pass(1);
    let second = claim(store).await.unwrap();
    assert!(second.fence > first.fence && second.attempt == 2);

    let release = Release {
        after: Duration::ZERO,
        counts: true,
        failure: None,
    };
    assert!(!store.renew(&first, None).await.unwrap());
    assert!(!store.release(&first, &release).await.unwrap());
    assert!(!store.finish(&first, Err(&failure())).await.unwrap());
    let late = derived(store, "a").await;
    let published = store
        .make_case_ready(&first, &late, &facts(), &[])
        .await
        .unwrap();
    assert_eq!(published, Referred::Unneeded(Published::Fenced));
    assert_eq!(state(store, &new).await, Some(CaseState::Preparing));

    let published = store
        .make_case_ready(&second, &late, &facts(), &[])
        .await
        .unwrap();
    assert_eq!(published, Referred::Done(Published::Done));
}

pub(crate) async fn a_job_fails_after_so_many_attempts(subject: &Subject) {
    let store = &subject.store;
    let new = insert(store, "a").await;
    subject.pass(1);
    let other = insert(store, "b").await;
    for attempt in 1..=3 {
        let leased = claim(store).await.unwrap();
        assert_eq!((leased.case, leased.attempt), (Some(new.id), attempt));
        subject.pass(100);
    }
    // The next look gives it up and goes on.
    assert_eq!(claim(store).await.unwrap().case.unwrap(), other.id);
    let failed = store.case(&new.id).await.unwrap().unwrap();
    assert_eq!(failed.state, CaseState::Failed);
    assert_eq!(failed.failure.unwrap().name, "preparation-interrupted");
}

pub(crate) async fn a_lease_handed_back_need_not_count(subject: &Subject) {
    let store = &subject.store;
    let new = insert(store, "a").await;
    for (counts, attempt) in [(false, 1), (true, 1), (false, 2), (true, 2)] {
        let leased = claim(store).await.unwrap();
        assert_eq!(leased.attempt, attempt);
        let release = Release {
            after: Duration::from_secs(5),
            counts,
            failure: None,
        };
        assert!(store.release(&leased, &release).await.unwrap());
        assert_eq!(state(store, &new).await, Some(CaseState::Queued));
        assert!(!store.renew(&leased, None).await.unwrap());
        // Not before its time.
        subject.pass(4);
        assert_eq!(claim(store).await, None);
        subject.pass(1);
    }
}

pub(crate) async fn clients_take_turns_with_their_preparations(subject: &Subject) {
    let store = &subject.store;
    let mut cases = Vec::new();
    for (contents, client) in [
        ("a", "one"),
        ("b", "one"),
        ("c", "one"),
        ("d", "two"),
        ("e", ""),
    ] {
        let new = NewCase {
            client: client.to_owned(),
            ..new_case(store, contents).await
        };
        let inserted = store.insert_case(&new).await.unwrap();
        assert!(matches!(inserted, Referred::Done(_)));
        cases.push(new.id.to_string());
        subject.pass(1);
    }
    let mut order = Vec::new();
    for _ in 0..cases.len() {
        let leased = claim(store).await.unwrap();
        order.push(cases.iter().position(|case| *case == leased.key).unwrap());
        assert!(store.finish(&leased, Err(&failure())).await.unwrap());
        subject.pass(1);
    }
    assert_eq!(order, [0, 3, 4, 1, 2]);
}

pub(crate) async fn a_published_case_is_ready_and_its_job_is_gone(subject: &Subject) {
    let store = &subject.store;
    let new = insert(store, "a").await;
    let leased = claim(store).await.unwrap();
    let derived = derived(store, "a").await;
    let published = store
        .make_case_ready(&leased, &derived, &facts(), &[])
        .await
        .unwrap();
    assert_eq!(published, Referred::Done(Published::Done));
    let case = store.case(&new.id).await.unwrap().unwrap();
    assert_eq!(
        (case.state, case.facts, case.progress),
        (CaseState::Ready, Some(facts()), None)
    );
    let objects = store.objects_of(&new.id).await.unwrap();
    assert_eq!(objects.len(), 1 + ObjectKind::DERIVED.len());
    assert!(derived.names.iter().all(|name| objects.contains(name)));
    subject.pass(100_000);
    assert_eq!(claim(store).await, None);
    assert!(store.abandoned(10).await.unwrap().is_empty());
}

pub(crate) async fn progress_is_told_and_a_lease_renewed(subject: &Subject) {
    let store = &subject.store;
    let new = insert(store, "a").await;
    let leased = claim(store).await.unwrap();
    let progress = Progress {
        stage: Stage::Forest,
        fraction: 0.5,
    };
    subject.pass(20);
    let json = serde_json::to_string(&progress).unwrap();
    assert!(store.renew(&leased, Some(&json)).await.unwrap());
    assert_eq!(
        store.case(&new.id).await.unwrap().unwrap().progress,
        Some(progress)
    );
    subject.pass(29);
    // What is not told does not change.
    assert!(store.renew(&leased, None).await.unwrap());
    let case = store.case(&new.id).await.unwrap().unwrap();
    assert_eq!(case.progress, Some(progress));
    subject.pass(29);
    assert_eq!(claim(store).await, None);
    subject.pass(1);
    assert!(claim(store).await.is_some());
    assert_eq!(store.case(&new.id).await.unwrap().unwrap().progress, None);
}

/// A sweep that may take a minute.
fn sweep(holder: &str) -> Sweep {
    Sweep {
        holder: holder.to_owned(),
        lease: Duration::from_secs(60),
    }
}

/// What a whole sweep of these objects removes.
async fn removed(store: &Store, names: &[ObjectName]) -> Vec<ObjectName> {
    let marked = store.mark(names, &sweep("a sweep")).await.unwrap();
    store.remove_tombstones("a sweep").await.unwrap();
    marked
}

pub(crate) async fn what_two_cases_need_goes_with_the_second(subject: &Subject) {
    let store = &subject.store;
    let first = insert(store, "a").await;
    let mut second = new_case(store, "a").await;
    let other_radius = Parameters {
        closing_radius_mm: 5.0,
        ..Parameters::default()
    };
    second.id = case::CaseId::of(&second.sources.names[0].digest, None, &other_radius);
    assert!(matches!(
        store.insert_case(&second).await.unwrap(),
        Referred::Done(_)
    ));

    assert!(store.delete_rows(&first.id).await.unwrap());
    assert!(!store.delete_rows(&first.id).await.unwrap());
    let looked_at = store.abandoned(10).await.unwrap();
    assert_eq!(looked_at, first.sources.names);
    assert_eq!(removed(store, &looked_at).await, []);
    assert!(store.abandoned(10).await.unwrap().is_empty());

    assert!(store.delete_rows(&second.id).await.unwrap());
    let looked_at = store.abandoned(10).await.unwrap();
    assert_eq!(removed(store, &looked_at).await, first.sources.names);
    assert!(store.abandoned(10).await.unwrap().is_empty());
}

pub(crate) async fn a_case_expires_unless_it_is_kept_or_uploaded_again(subject: &Subject) {
    let store = &subject.store;
    let age = Duration::from_secs(86_400);
    let mut cases = Vec::new();
    for name in ["old", "kept", "again", "queued", "failed"] {
        cases.push(insert(store, name).await);
        subject.pass(1);
    }
    for name in ["old", "kept", "again"] {
        let claim = claim(store).await.unwrap();
        let derived = derived(store, name).await;
        let published = store
            .make_case_ready(&claim, &derived, &facts(), &[])
            .await
            .unwrap();
        assert_eq!(published, Referred::Done(Published::Done));
    }
    // The last one is leased and fails; the one before it is leased and goes on.
    let _at_work = claim(store).await.unwrap();
    let failing = claim(store).await.unwrap();
    assert!(store.finish(&failing, Err(&failure())).await.unwrap());
    let [old, kept, again, queued, failed] = [0, 1, 2, 3, 4].map(|number| cases[number].id);
    assert!(keep(store, &kept, true).await);
    assert!(store.case(&kept).await.unwrap().unwrap().kept);
    assert_eq!(upkeep::expired(store, age, 10).await.unwrap(), []);

    subject.pass(86_400 - 60);
    let new = new_case(store, "again").await;
    assert!(matches!(
        store.insert_case(&new).await.unwrap(),
        Referred::Unneeded(_)
    ));
    assert!(store.uploaded_again(&new).await.unwrap().is_some());
    let case = store.case(&again).await.unwrap().unwrap();
    assert!(case.uploaded_at > case.created_at);
    subject.pass(120);
    assert_eq!(
        upkeep::expired(store, age, 10).await.unwrap(),
        [old, failed]
    );
    assert_eq!(upkeep::expired(store, age, 1).await.unwrap(), [old]);
    for (id, is_deleted) in [
        (old, true),
        (kept, false),
        (again, false),
        (queued, false),
        (old, false),
    ] {
        assert_eq!(
            store
                .delete_expired(&id, age, Allowance::All)
                .await
                .unwrap(),
            Some(is_deleted),
            "{id}"
        );
    }
    assert_eq!(store.objects_of(&old).await.unwrap(), []);

    // No longer kept, it is as old as it is.
    assert!(keep(store, &kept, false).await);
    assert_eq!(
        upkeep::expired(store, age, 10).await.unwrap(),
        [kept, failed]
    );
    assert!(!keep(store, &old, true).await, "it is gone");
}

/// Failed cases, in any number.
async fn failed_cases(store: &Store, numbers: std::ops::Range<usize>) -> Vec<CaseId> {
    let mut cases = Vec::new();
    for number in numbers {
        cases.push(insert(store, &format!("case {number}")).await.id);
        let failing = claim(store).await.unwrap();
        assert!(store.finish(&failing, Err(&failure())).await.unwrap());
    }
    cases
}

pub(crate) async fn as_many_cases_expire_in_a_day_as_may(subject: &Subject) {
    let (store, day) = (&subject.store, Duration::from_secs(86_400));
    let allowed = async || {
        let allowed = store.allow_removals(Aged::Cases, day, Removal::Automatic);
        allowed.await.unwrap()
    };
    let cases = failed_cases(store, 0..3).await;
    assert_eq!(allowed().await, Allowance::ADay(10), "twice three are less");
    let cases = [cases, failed_cases(store, 3..7).await].concat();
    // They may have come on two days, if it is midnight.
    let two = Allowance::ADay(2);
    subject.pass(3 * 86_400);
    let delete = async |case: &CaseId| store.delete_expired(case, day, two).await.unwrap();
    assert_eq!(delete(&cases[0]).await, Some(true));
    assert_eq!(delete(&cases[0]).await, Some(false));
    assert!(store.has_room_today(two).await.unwrap());
    assert_eq!(delete(&cases[1]).await, Some(true));
    assert!(!store.has_room_today(two).await.unwrap());
    assert!(store.has_room_today(Allowance::All).await.unwrap());
    assert_eq!(delete(&cases[2]).await, None);
    assert!(store.case(&cases[2]).await.unwrap().is_some());
    subject.pass(86_400);
    assert!(store.has_room_today(two).await.unwrap());
    assert_eq!(delete(&cases[2]).await, Some(true));
}

pub(crate) async fn a_clock_that_jumps_is_doubted_until_somebody_says_that_it_is_right(
    subject: &Subject,
) {
    const DAY: u64 = 86_400;
    let store = &subject.store;
    let allowed = async |keep_days, removal| {
        let keep = Duration::from_secs(keep_days * DAY);
        let allowed = store.allow_removals(Aged::Cases, keep, removal);
        allowed.await.unwrap()
    };
    let usual = Allowance::ADay(10);
    // The first time is that of the latest row.
    failed_cases(store, 0..1).await;
    subject.pass(8 * DAY);
    assert_eq!(allowed(1, Removal::Automatic).await, Allowance::None);
    // Half of the time for which cases are kept is believed.
    assert_eq!(allowed(20, Removal::Automatic).await, usual);
    for jump in [1, 6, 7] {
        subject.pass(jump * DAY - 60);
        assert_eq!(allowed(1, Removal::Asked).await, usual, "{jump}");
    }
    subject.pass(46 * DAY);
    // A case that comes meanwhile has the wrong time, too.
    failed_cases(store, 1..2).await;
    for removal in [Removal::Automatic, Removal::Asked, Removal::Automatic] {
        assert_eq!(allowed(90, removal).await, Allowance::None);
    }
    assert_eq!(allowed(90, Removal::Confirmed).await, Allowance::All);
    assert_eq!(allowed(90, Removal::Automatic).await, usual);
    // What is kept for three days does not go by a jump that is small beside 90 days; and whoever says that the clock is right says
    // so of all.
    let received = async |removal| {
        let keep = Duration::from_secs(3 * DAY);
        let allowed = store.allow_removals(Aged::Received, keep, removal);
        allowed.await.unwrap()
    };
    assert_eq!(received(Removal::Automatic).await, Allowance::All);
    subject.pass(40 * DAY);
    assert_eq!(allowed(90, Removal::Automatic).await, usual);
    for removal in [Removal::Automatic, Removal::Asked, Removal::Automatic] {
        assert_eq!(received(removal).await, Allowance::None);
    }
    assert_eq!(allowed(90, Removal::Confirmed).await, Allowance::All);
    assert_eq!(received(Removal::Automatic).await, Allowance::All);
}

pub(crate) async fn a_pin_protects_until_it_expires(subject: &Subject) {
    let store = &subject.store;
    let names = [name(ObjectKind::Volume, "a")];
    pinned(store, &names).await;
    let shorter = pinned(store, &names).await;
    store.unpin(&shorter).await.unwrap();
    // One of two pins has expired.
    assert_eq!(store.abandoned(10).await.unwrap(), names);
    assert_eq!(removed(store, &names).await, []);
    assert!(store.abandoned(10).await.unwrap().is_empty());
    subject.pass(3600);
    assert_eq!(store.abandoned(10).await.unwrap(), names);
    assert_eq!(removed(store, &names).await, names);
}

pub(crate) async fn what_is_being_removed_cannot_be_pinned(subject: &Subject) {
    let store = &subject.store;
    let names = [name(ObjectKind::Volume, "a")];
    store.unpin(&pinned(store, &names).await).await.unwrap();
    assert_eq!(store.mark(&names, &sweep("a")).await.unwrap(), names);
    let again = Pinned {
        holder: "a writer".to_owned(),
        names: vec![name(ObjectKind::Forest, "b"), names[0]],
    };
    assert!(!store.try_pin(&again, LEASE).await.unwrap());
    // None of them was pinned.
    subject.pass(31);
    assert!(store.abandoned(10).await.unwrap().is_empty());
    store.remove_tombstones("a").await.unwrap();
    assert!(store.try_pin(&again, LEASE).await.unwrap());
    // What is pinned gets no tombstone.
    assert_eq!(store.mark(&names, &sweep("b")).await.unwrap(), []);
}

pub(crate) async fn a_sweep_that_was_killed_is_finished_by_another(subject: &Subject) {
    let store = &subject.store;
    let names = [name(ObjectKind::Volume, "a")];
    store.unpin(&pinned(store, &names).await).await.unwrap();
    assert_eq!(store.mark(&names, &sweep("killed")).await.unwrap(), names);
    // As long as it may live, its tombstones are its own.
    subject.pass(59);
    assert!(store.abandoned(10).await.unwrap().is_empty());
    assert_eq!(store.mark(&names, &sweep("next")).await.unwrap(), []);
    subject.pass(1);
    assert_eq!(store.abandoned(10).await.unwrap(), names);
    assert_eq!(store.mark(&names, &sweep("next")).await.unwrap(), names);
    store.remove_tombstones("next").await.unwrap();
    assert!(store.abandoned(10).await.unwrap().is_empty());
    pinned(store, &names).await;
}

pub(crate) async fn a_sweep_buries_its_own_tombstones_alone(subject: &Subject) {
    let store = &subject.store;
    let names = [name(ObjectKind::Volume, "a")];
    store.unpin(&pinned(store, &names).await).await.unwrap();
    store.mark(&names, &sweep("slow")).await.unwrap();
    subject.pass(60);
    assert_eq!(store.mark(&names, &sweep("next")).await.unwrap(), names);
    // The first one comes back after its lease: the tombstone is not its own any more.
    store.remove_tombstones("slow").await.unwrap();
    let writer = Pinned {
        holder: "a writer".to_owned(),
        names: names.to_vec(),
    };
    assert!(!store.try_pin(&writer, LEASE).await.unwrap());
    store.remove_tombstones("next").await.unwrap();
    assert!(store.try_pin(&writer, LEASE).await.unwrap());
}

pub(crate) async fn a_deleted_case_cannot_be_published(subject: &Subject) {
    let store = &subject.store;
    let new = insert(store, "a").await;
    let leased = claim(store).await.unwrap();
    assert!(store.delete_rows(&new.id).await.unwrap());
    assert!(!store.renew(&leased, None).await.unwrap());
    // The same again is another job: the first one's lease has nothing to do with it.
    insert(store, "a").await;
    claim(store).await.unwrap();
    let late = derived(store, "a").await;
    let published = store
        .make_case_ready(&leased, &late, &facts(), &[])
        .await
        .unwrap();
    assert_eq!(published, Referred::Unneeded(Published::Fenced));
}

pub(crate) async fn a_ready_case_gets_other_objects_or_fails(subject: &Subject) {
    let store = &subject.store;
    let new = insert(store, "a").await;
    let others = derived(store, "b").await;
    assert_eq!(
        store.refer((&new.id).into(), &others, true).await.unwrap(),
        Referred::Unneeded(Published::Fenced)
    );
    assert!(!store.make_case_failed(&new.id, &failure()).await.unwrap());

    let leased = claim(store).await.unwrap();
    let first = derived(store, "a").await;
    store
        .make_case_ready(&leased, &first, &facts(), &[])
        .await
        .unwrap();
    assert_eq!(
        store.refer((&new.id).into(), &others, true).await.unwrap(),
        Referred::Done(Published::Done)
    );
    let objects = store.objects_of(&new.id).await.unwrap();
    assert!(others.names.iter().all(|name| objects.contains(name)));
    let mut dropped = store.abandoned(10).await.unwrap();
    dropped.sort_by_key(|name| name.kind);
    assert_eq!(dropped, first.names);

    assert!(store.make_case_failed(&new.id, &failure()).await.unwrap());
    assert_eq!(state(store, &new).await, Some(CaseState::Failed));
}

pub(crate) async fn a_job_is_open_once_and_its_end_is_kept_for_a_while(subject: &Subject) {
    const KIND: JobKind = JobKind::new("a kind", "work");
    let store = &subject.store;
    let new = NewJob {
        payload: "[7]".to_owned(),
        ..NewJob::new(KIND, "a key")
    };
    let claim = async || store.claim(KIND, 3).await.unwrap();
    let first = store.enqueue(&new).await.unwrap().unwrap();
    assert_eq!(first.payload, "[7]");
    assert_eq!(store.enqueue(&new).await.unwrap(), Some(first.clone()));
    assert_eq!(waiting(store, KIND).await, 1);
    assert_eq!(store.claim(JobKind::MAPS, 3).await.unwrap(), None);
    let leased = claim().await.unwrap();
    assert_eq!((&leased.id, &*leased.payload), (&first.id, "[7]"));
    assert_eq!(waiting(store, KIND).await, 0);
    let running = store.enqueue(&new).await.unwrap().unwrap();
    assert_eq!(
        (running.id, running.state),
        (first.id.clone(), JobState::Running)
    );
    // Another attempt, and its reason.
    let release = Release {
        after: Duration::from_secs(5),
        counts: true,
        failure: Some(failure()),
    };
    assert!(store.release(&leased, &release).await.unwrap());
    let waiting = job(store, &first.id).await.unwrap();
    assert_eq!(
        (waiting.state, waiting.failure, waiting.attempts),
        (JobState::Queued, Some(failure()), 1)
    );
    subject.pass(5);
    let leased = claim().await.unwrap();
    assert!(store.finish(&leased, Ok(())).await.unwrap());
    assert!(!store.finish(&leased, Ok(())).await.unwrap());
    assert_eq!(claim().await, None);
    let done = job(store, &first.id).await.unwrap();
    assert_eq!((done.state, done.attempts), (JobState::Done, 2));
    assert!(done.ended_at.is_some());
    // The same again is another job.
    let again = store.enqueue(&new).await.unwrap().unwrap();
    assert_ne!(again.id, first.id);
    let leased = claim().await.unwrap();
    assert!(store.finish(&leased, Err(&failure())).await.unwrap());
    let failed = jobs::latest(&mut store.connect().await.unwrap(), KIND, "a key")
        .await
        .unwrap()
        .unwrap();
    assert_eq!(
        (failed.id, failed.state, failed.failure),
        (again.id.clone(), JobState::Failed, Some(failure()))
    );
    subject.pass(3600);
    store.forget_jobs(Duration::from_secs(7200)).await.unwrap();
    assert!(job(store, &first.id).await.is_some());
    store.forget_jobs(Duration::from_secs(60)).await.unwrap();
    assert_eq!(job(store, &first.id).await, None);
    assert_eq!(job(store, &again.id).await, None);
}

pub(crate) async fn jobs_are_listed_and_counted_by_kind_and_state(subject: &Subject) {
    const KIND: JobKind = JobKind::new("a kind", "work");
    const OTHER: JobKind = JobKind::new("another kind", "work");
    let store = &subject.store;
    for (kind, key) in [(KIND, "1 1"), (KIND, "1 2"), (KIND, "12 3"), (OTHER, "1 4")] {
        let new = NewJob::new(kind, key);
        store.enqueue(&new).await.unwrap();
        subject.pass(1);
    }
    let first = store.claim(KIND, 3).await.unwrap().unwrap();
    assert!(store.finish(&first, Ok(())).await.unwrap());
    let keys = async |state: Option<JobState>, key_prefix: &str| {
        let query = JobQuery {
            kind: KIND,
            state,
            key_prefix: key_prefix.to_owned(),
        };
        // In pages of one.
        let (mut keys, mut after) = (Vec::new(), None);
        loop {
            let (page, next) = jobs::page(
                &mut store.connect().await.unwrap(),
                &query,
                after.as_ref(),
                1,
            )
            .await
            .unwrap();
            keys.extend(page.into_iter().map(|job| job.key));
            match next {
                Some(next) => after = Some(next),
                None => return keys,
            }
        }
    };
    assert_eq!(keys(None, "").await, ["12 3", "1 2", "1 1"]);
    assert_eq!(keys(None, "1 ").await, ["1 2", "1 1"]);
    assert_eq!(keys(Some(JobState::Done), "").await, ["1 1"]);
    assert_eq!(keys(Some(JobState::Queued), "1 ").await, ["1 2"]);
    assert!(keys(Some(JobState::Failed), "").await.is_empty());

    subject.pass(100);
    let counts = upkeep::row_counts(store).await.unwrap();
    let count = |kind: &str, state: &str, number| {
        let row = ("jobs".to_owned(), kind.to_owned(), state.to_owned(), number);
        assert!(counts.by_state.contains(&row), "{row:?}: {counts:?}");
    };
    count("a kind", "done", 1);
    count("a kind", "queued", 2);
    count("another kind", "queued", 1);
    let ages = counts.oldest.iter();
    let ages: Vec<_> = ages
        .map(|(kind, age)| (kind.as_str(), age.as_secs()))
        .collect();
    // The job that is done counts no longer.
    assert_eq!(ages, [("a kind", 103), ("another kind", 101)]);
}

pub(crate) async fn a_job_that_needs_a_case_waits_for_it_and_goes_with_it(subject: &Subject) {
    let store = &subject.store;
    let new = insert(store, "a").await;
    let maps = NewJob::about(JobKind::MAPS, &new.id);
    let queued = store.enqueue(&maps).await.unwrap().unwrap();
    assert_eq!(store.claim(JobKind::MAPS, 3).await.unwrap(), None);
    let leased = claim(store).await.unwrap();
    let derived = derived(store, "a").await;
    let next = [JobKind::MAPS];
    let facts = facts();
    let published = store.make_case_ready(&leased, &derived, &facts, &next);
    assert_eq!(published.await.unwrap(), Referred::Done(Published::Done));
    let leased = store.claim(JobKind::MAPS, 3).await.unwrap().unwrap();
    assert_eq!((&leased.id, leased.case), (&queued.id, Some(new.id)));
    store.delete_rows(&new.id).await.unwrap();
    assert!(!store.finish(&leased, Ok(())).await.unwrap());
    assert_eq!(job(store, &queued.id).await, None);
    assert_eq!(
        store.enqueue(&maps).await.unwrap(),
        None,
        "there is no case"
    );
}

pub(crate) async fn a_case_of_another_store_is_copied_as_it_is_there(subject: &Subject) {
    let store = &subject.store;
    let new = insert(store, "a").await;
    let leased = claim(store).await.unwrap();
    let preparing = store.case(&new.id).await.unwrap().unwrap();
    let published = derived(store, "a").await;
    store
        .make_case_ready(&leased, &published, &facts(), &[])
        .await
        .unwrap();
    let mut ready = store.case(&new.id).await.unwrap().unwrap();
    let names = store.objects_of(&new.id).await.unwrap();
    // What is ready here is not made otherwise.
    let again = pinned(store, &names).await;
    assert!(!store.write_copied_case(&preparing, &again).await.unwrap());
    assert_eq!(store.case(&new.id).await.unwrap().unwrap(), ready);
    store.unpin(&again).await.unwrap();

    store.delete_rows(&new.id).await.unwrap();
    let sources = pinned(store, &new.sources.names).await;
    assert!(store.write_copied_case(&preparing, &sources).await.unwrap());
    let queued = store.case(&new.id).await.unwrap().unwrap();
    assert_eq!(
        (queued.state, queued.created_at),
        (CaseState::Queued, ready.created_at)
    );
    assert_eq!(waiting(store, JobKind::PREPARE).await, 1);

    ready.parameters.name = Some("another".to_owned());
    assert!(
        store
            .write_copied_case(&ready, &pinned(store, &names).await)
            .await
            .unwrap()
    );
    assert_eq!(store.case(&new.id).await.unwrap().unwrap(), ready);
    assert_eq!(store.objects_of(&new.id).await.unwrap(), names);
    assert_eq!(waiting(store, JobKind::PREPARE).await, 0);
}

pub(crate) async fn ready_cases_are_found_by_their_voxels(subject: &Subject) {
    let store = &subject.store;
    let of = |values: &str| CaseFacts {
        voxels: Some(VoxelFacts {
            values: values.to_owned(),
            profiles: [[1, 2], [3, 4], [5, 6]],
            not_finite: 0,
            clipped: 0,
        }),
        ..facts()
    };
    let mut ids = Vec::new();
    for (contents, values) in [("a", "same"), ("b", "other"), ("c", "same"), ("d", "same")] {
        let new = insert(store, contents).await;
        let leased = claim(store).await.unwrap();
        let published = derived(store, contents).await;
        store
            .make_case_ready(&leased, &published, &of(values), &[])
            .await
            .unwrap();
        ids.push(new.id);
        subject.pass(1);
    }
    let found = async |values: &str, limit| {
        let cases = cases::with_voxels(&mut store.connect().await.unwrap(), values, limit)
            .await
            .unwrap();
        cases.into_iter().map(|case| case.id).collect::<Vec<_>>()
    };
    assert_eq!(found("same", 10).await, [ids[3], ids[2], ids[0]]);
    assert_eq!(found("same", 1).await, [ids[3]]);
    assert_eq!(found("none", 10).await, []);
    store.make_case_failed(&ids[3], &failure()).await.unwrap();
    assert_eq!(found("same", 10).await, [ids[2], ids[0]]);

    let ready = store.case(&ids[0]).await.unwrap().unwrap();
    let names = store.objects_of(&ids[0]).await.unwrap();
    store.delete_rows(&ids[0]).await.unwrap();
    assert_eq!(found("same", 10).await, [ids[2]]);
    let again = pinned(store, &names).await;
    assert!(store.write_copied_case(&ready, &again).await.unwrap());
    assert_eq!(found("same", 10).await, [ids[2], ids[0]]);
}

pub(crate) async fn what_nobody_needs_is_told(subject: &Subject) {
    let store = &subject.store;
    let needed = insert(store, "needed").await.sources.names[0];
    let [unknown, pin, marked] =
        ["unknown", "pin", "marked"].map(|of| name(ObjectKind::Volume, of));
    pinned(store, &[pin]).await;
    store.mark(&[marked], &sweep("a sweep")).await.unwrap();
    let unneeded = store
        .unneeded(&[needed, unknown, pin, marked])
        .await
        .unwrap();
    assert_eq!(unneeded, [unknown]);
    store.rows().database.check_file().await.unwrap();
}

pub(crate) async fn holders_that_are_dead_hold_nothing(subject: &Subject) {
    let store = &subject.store;
    let new = insert(store, "a").await;
    claim(store).await.unwrap();
    let names = [name(ObjectKind::Volume, "a"), name(ObjectKind::Volume, "b")];
    pinned(store, &names[..1]).await;
    store
        .unpin(&pinned(store, &names[1..]).await)
        .await
        .unwrap();
    store.mark(&names[1..], &sweep("dead")).await.unwrap();
    store.rows().forget_holders().await.unwrap();
    assert_eq!(claim(store).await.unwrap().case.unwrap(), new.id);
    let mut abandoned = store.abandoned(10).await.unwrap();
    abandoned.sort_by_key(|name| name.digest.to_string());
    let mut expected = names.to_vec();
    expected.sort_by_key(|name| name.digest.to_string());
    assert_eq!(abandoned, expected);
}
