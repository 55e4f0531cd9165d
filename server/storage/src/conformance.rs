//! Checks that every implementation of the rows and every object store must pass: one suite, for the back ends of this
//! crate and of others.
//!
//! A back end writes `storage::rows_conformance! { name: make }` into its tests, in which `make` is an async function
//! that returns a [`RowsSubject`] on an empty database.
#![expect(missing_docs, reason = "the names of the checks are sentences")]

mod arrivals;
mod layers;
mod objects;
mod results;

use std::sync::Arc;
use std::time::Duration;

use case::{CaseFacts, CaseState, ObjectKind, Parameters, Progress, Stage, VoxelFacts};

pub use self::arrivals::*;
pub use self::layers::*;
pub use self::objects::objects_do_what_they_must;
pub use self::results::*;

use super::ObjectName;
use super::rows::{CaseRows, Inserted, NewCase, Pinned, Published, Release, Sweep};
use super::testing::{claim, facts, failure, name, new_case, pinned};

/// The lease of jobs in these checks.
const LEASE: Duration = Duration::from_secs(30);

/// Rows to check.
pub struct RowsSubject {
    /// The rows, empty.
    pub rows: Arc<dyn CaseRows>,
    /// Lets time pass on their clock.
    pub pass_time: Box<dyn Fn(Duration) + Send + Sync>,
    /// A resource that must live as long.
    pub keep: Box<dyn std::any::Any + Send + Sync>,
}

impl RowsSubject {
    fn pass(&self, seconds: u64) {
        (self.pass_time)(Duration::from_secs(seconds));
    }
}

/// Tests an implementation of the rows: `rows_conformance! { a_name: make_subject }` writes a test for each check;
/// `rows_conformance! { in_turn make_subject }` is a block that awaits all of them, for back ends that are slow to
/// start.
#[macro_export]
macro_rules! rows_conformance {
    ($($implementation:ident: $make:path),+ $(,)?) => {$(
        mod $implementation {
            $crate::rows_conformance! { @list tests $make }
        }
    )+};
    (in_turn $make:expr) => {
        $crate::rows_conformance! { @list in_turn $make }
    };
    (@list $how:ident $make:tt) => {
            $crate::rows_conformance! { @$how $make;
                a_case_is_inserted_once
                a_case_is_renamed
                cases_are_listed_newest_first_in_pages
                no_more_jobs_wait_than_may
                a_failed_case_is_queued_again
                without_its_pins_nothing_is_inserted_or_published
                jobs_are_leased_in_their_order_and_once
                an_ended_lease_goes_to_another_and_fences_the_first_off
                a_job_fails_after_so_many_attempts
                a_lease_handed_back_need_not_count
                a_published_case_is_ready_and_its_job_is_gone
                progress_is_told_and_a_lease_renewed
                what_two_cases_need_goes_with_the_second
                a_case_expires_unless_it_is_kept_or_uploaded_again
                a_pin_protects_until_it_expires
                what_is_being_removed_cannot_be_pinned
                a_sweep_that_was_killed_is_finished_by_another
                a_sweep_buries_its_own_tombstones_alone
                a_deleted_case_cannot_be_published
                a_ready_case_gets_other_objects_or_fails
                a_rebuild_is_one_process_s_until_its_lease_ends
                a_case_of_another_store_is_adopted_as_it_is_there
                ready_cases_are_found_by_their_voxels
                what_nobody_needs_is_told
                holders_that_are_dead_hold_nothing
                an_image_is_received_once
                an_image_that_replaces_another_supersedes_the_cases_of_its_series
                objects_that_are_not_kept_are_counted
                a_series_is_due_when_nothing_came_for_a_while
                a_series_with_all_announced_images_waits_no_longer
                a_late_image_fences_the_reader_off_and_makes_the_series_due_again
                a_series_that_is_not_t1_waits_for_a_case_of_its_study
                an_image_is_kept_until_its_series_is_forgotten_or_its_case_deleted
                cases_are_found_by_their_series
                series_are_listed_newest_first_in_pages
                a_retrieval_is_queued_once_and_leased_until_it_ends
                a_result_is_queued_once_for_a_node_and_sent_until_it_is_there
                a_result_is_kept_until_it_is_forgotten_or_its_case_deleted
                results_are_listed_by_case_and_state_in_pages
                a_layer_is_inserted_once_and_as_many_as_may
                layers_are_named_and_ordered
                a_layer_is_leased_once_its_case_is_ready
                a_layer_that_waits_fails_with_its_case
                a_layer_fails_and_is_queued_again
                a_lost_object_of_a_layer_is_made_again_and_its_place_stays
                a_version_keeps_the_layers_of_its_case
                a_layer_of_a_deleted_case_cannot_be_published
                a_layer_of_another_store_is_adopted_as_it_is_there
            }
    };
    (@in_turn $make:expr; $($check:ident)+) => {{
        $(
            println!("{}", stringify!($check));
            $crate::conformance::$check(&$make().await).await;
        )+
    }};
    (@tests $make:path; $($check:ident)+) => {$(
        #[tokio::test]
        async fn $check() {
            $crate::conformance::$check(&$make().await).await;
        }
    )+};
}

async fn insert(rows: &dyn CaseRows, contents: &str) -> NewCase {
    let new = new_case(rows, contents).await;
    assert_eq!(rows.insert(&new).await.unwrap(), Inserted::Created);
    new
}

async fn derived(rows: &dyn CaseRows, contents: &str) -> Pinned {
    let names = ObjectKind::DERIVED.map(|kind| name(kind, contents));
    pinned(rows, &names).await
}

async fn state(rows: &dyn CaseRows, new: &NewCase) -> Option<CaseState> {
    rows.case(&new.id).await.unwrap().map(|case| case.state)
}

pub async fn a_case_is_inserted_once(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let mut new = new_case(rows, "a").await;
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
    assert_eq!(case.state, CaseState::Queued);
    assert_eq!(case.parameters, new.parameters);
    assert_eq!(
        (case.progress, case.failure, case.facts),
        (None, None, None)
    );
    assert_eq!(rows.objects(&new.id).await.unwrap(), new.sources.names);
    assert_eq!(rows.waiting().await.unwrap(), 1);
}

pub async fn a_case_is_renamed(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let new = insert(rows, "one").await;
    rows.rename(&new.id, "another name").await.unwrap();
    let case = rows.case(&new.id).await.unwrap().expect("the case");
    assert_eq!(case.parameters.name.as_deref(), Some("another name"));
    rows.rename(&insert(rows, "two").await.id, "its own")
        .await
        .unwrap();
    let case = rows.case(&new.id).await.unwrap().expect("the case");
    assert_eq!(case.parameters.name.as_deref(), Some("another name"));
}

pub async fn cases_are_listed_newest_first_in_pages(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let mut expected = Vec::new();
    for number in 0..7i64 {
        let id = insert(rows, &number.to_string()).await.id;
        let case = rows.case(&id).await.unwrap().unwrap();
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
        let page = rows.cases(cursor.as_ref(), 3).await.unwrap();
        assert_eq!(page.cases.len(), length);
        listed.extend(
            page.cases
                .into_iter()
                .map(|case| (case.created_at, case.id)),
        );
        cursor = page.next;
    }
    assert_eq!(cursor, None);
    assert_eq!(listed, expected);
}

pub async fn no_more_jobs_wait_than_may(subject: &RowsSubject) {
    let rows = &*subject.rows;
    insert(rows, "a").await;
    let mut new = new_case(rows, "b").await;
    new.queue_limit = 1;
    assert_eq!(rows.insert(&new).await.unwrap(), Inserted::QueueFull);
    assert_eq!(state(rows, &new).await, None);
    // A leased job does not wait.
    claim(rows).await.unwrap();
    assert_eq!(rows.insert(&new).await.unwrap(), Inserted::Created);
}

pub async fn a_failed_case_is_queued_again(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let new = insert(rows, "a").await;
    let created_at = rows.case(&new.id).await.unwrap().unwrap().created_at;
    let leased = claim(rows).await.unwrap();
    assert!(rows.fail(&leased, &failure()).await.unwrap());
    let failed = rows.case(&new.id).await.unwrap().unwrap();
    assert_eq!(
        (failed.state, failed.failure),
        (CaseState::Failed, Some(failure()))
    );
    assert_eq!(claim(rows).await, None);
    subject.pass(3);
    let again = new_case(rows, "a").await;
    assert_eq!(rows.insert(&again).await.unwrap(), Inserted::Requeued);
    let queued = rows.case(&new.id).await.unwrap().unwrap();
    assert_eq!(
        (queued.state, queued.failure, queued.created_at),
        (CaseState::Queued, None, created_at)
    );
    assert_eq!(claim(rows).await.unwrap().attempt, 1);
}

pub async fn without_its_pins_nothing_is_inserted_or_published(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let new = new_case(rows, "a").await;
    rows.unpin(&new.sources).await.unwrap();
    assert_eq!(removed(rows, &new.sources.names).await, new.sources.names);
    assert_eq!(rows.insert(&new).await.unwrap(), Inserted::PinLost);
    assert_eq!(state(rows, &new).await, None);

    insert(rows, "a").await;
    let leased = claim(rows).await.unwrap();
    let unpinned = Pinned {
        holder: "nobody has pinned it".to_owned(),
        names: ObjectKind::DERIVED.map(|kind| name(kind, "a")).into(),
    };
    let published = rows.publish(&leased, &unpinned, &facts()).await.unwrap();
    assert_eq!(published, Published::PinLost);
    assert_eq!(state(rows, &new).await, Some(CaseState::Preparing));
    assert!(rows.renew(&leased, LEASE, None).await.unwrap());
}

pub async fn jobs_are_leased_in_their_order_and_once(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let first = insert(rows, "a").await;
    subject.pass(1);
    let second = insert(rows, "b").await;
    let leased = claim(rows).await.unwrap();
    assert_eq!((leased.id, leased.attempt), (first.id, 1));
    assert_eq!(
        (leased.parameters, leased.sources),
        (first.parameters.clone(), first.sources.names.clone())
    );
    assert_eq!(state(rows, &first).await, Some(CaseState::Preparing));
    assert_eq!(claim(rows).await.unwrap().id, second.id);
    assert_eq!(claim(rows).await, None);
}

pub async fn an_ended_lease_goes_to_another_and_fences_the_first_off(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let new = insert(rows, "a").await;
    let first = claim(rows).await.unwrap();
    subject.pass(29);
    assert_eq!(claim(rows).await, None);
    subject.pass(1);
    let second = claim(rows).await.unwrap();
    assert!(second.fence > first.fence && second.attempt == 2);

    let release = Release {
        after: Duration::ZERO,
        counts: true,
    };
    assert!(!rows.renew(&first, LEASE, None).await.unwrap());
    assert!(!rows.release(&first, release).await.unwrap());
    assert!(!rows.fail(&first, &failure()).await.unwrap());
    let late = derived(rows, "a").await;
    let published = rows.publish(&first, &late, &facts()).await.unwrap();
    assert_eq!(published, Published::Fenced);
    assert_eq!(state(rows, &new).await, Some(CaseState::Preparing));

    let published = rows.publish(&second, &late, &facts()).await.unwrap();
    assert_eq!(published, Published::Done);
}

pub async fn a_job_fails_after_so_many_attempts(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let new = insert(rows, "a").await;
    subject.pass(1);
    let other = insert(rows, "b").await;
    for attempt in 1..=3 {
        let leased = claim(rows).await.unwrap();
        assert_eq!((leased.id, leased.attempt), (new.id, attempt));
        subject.pass(100);
    }
    // The next look gives it up and goes on.
    assert_eq!(claim(rows).await.unwrap().id, other.id);
    let failed = rows.case(&new.id).await.unwrap().unwrap();
    assert_eq!(failed.state, CaseState::Failed);
    assert_eq!(failed.failure.unwrap().name, "preparation-interrupted");
}

pub async fn a_lease_handed_back_need_not_count(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let new = insert(rows, "a").await;
    for (counts, attempt) in [(false, 1), (true, 1), (false, 2), (true, 2)] {
        let leased = claim(rows).await.unwrap();
        assert_eq!(leased.attempt, attempt);
        let release = Release {
            after: Duration::from_secs(5),
            counts,
        };
        assert!(rows.release(&leased, release).await.unwrap());
        assert_eq!(state(rows, &new).await, Some(CaseState::Queued));
        assert!(!rows.renew(&leased, LEASE, None).await.unwrap());
        // Not before its time.
        subject.pass(4);
        assert_eq!(claim(rows).await, None);
        subject.pass(1);
    }
}

pub async fn a_published_case_is_ready_and_its_job_is_gone(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let new = insert(rows, "a").await;
    let leased = claim(rows).await.unwrap();
    let derived = derived(rows, "a").await;
    let published = rows.publish(&leased, &derived, &facts()).await.unwrap();
    assert_eq!(published, Published::Done);
    let case = rows.case(&new.id).await.unwrap().unwrap();
    assert_eq!(
        (case.state, case.facts, case.progress),
        (CaseState::Ready, Some(facts()), None)
    );
    let objects = rows.objects(&new.id).await.unwrap();
    assert_eq!(objects.len(), 1 + ObjectKind::DERIVED.len());
    assert!(derived.names.iter().all(|name| objects.contains(name)));
    subject.pass(100_000);
    assert_eq!(claim(rows).await, None);
    assert!(rows.abandoned(10).await.unwrap().is_empty());
}

pub async fn progress_is_told_and_a_lease_renewed(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let new = insert(rows, "a").await;
    let leased = claim(rows).await.unwrap();
    let progress = Progress {
        stage: Stage::Forest,
        fraction: 0.5,
    };
    assert!(
        rows.renew(&leased, 2 * LEASE, Some(progress))
            .await
            .unwrap()
    );
    assert_eq!(
        rows.case(&new.id).await.unwrap().unwrap().progress,
        Some(progress)
    );
    subject.pass(59);
    assert_eq!(claim(rows).await, None);
    subject.pass(1);
    assert!(claim(rows).await.is_some());
    assert_eq!(rows.case(&new.id).await.unwrap().unwrap().progress, None);
}

/// A sweep that may take a minute.
fn sweep(holder: &str) -> Sweep {
    Sweep {
        holder: holder.to_owned(),
        lease: Duration::from_secs(60),
    }
}

/// What a whole sweep of these objects removes.
async fn removed(rows: &dyn CaseRows, names: &[ObjectName]) -> Vec<ObjectName> {
    let marked = rows.mark(names, &sweep("a sweep")).await.unwrap();
    rows.bury("a sweep").await.unwrap();
    marked
}

pub async fn what_two_cases_need_goes_with_the_second(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let first = insert(rows, "a").await;
    let mut second = new_case(rows, "a").await;
    let other_radius = Parameters {
        closing_radius_mm: 5.0,
        ..Parameters::default()
    };
    second.id = case::CaseId::of(&second.sources.names[0].digest, None, &other_radius);
    assert_eq!(rows.insert(&second).await.unwrap(), Inserted::Created);

    assert!(rows.delete(&first.id).await.unwrap());
    assert!(!rows.delete(&first.id).await.unwrap());
    let looked_at = rows.abandoned(10).await.unwrap();
    assert_eq!(looked_at, first.sources.names);
    assert_eq!(removed(rows, &looked_at).await, []);
    assert!(rows.abandoned(10).await.unwrap().is_empty());

    assert!(rows.delete(&second.id).await.unwrap());
    let looked_at = rows.abandoned(10).await.unwrap();
    assert_eq!(removed(rows, &looked_at).await, first.sources.names);
    assert!(rows.abandoned(10).await.unwrap().is_empty());
}

pub async fn a_case_expires_unless_it_is_kept_or_uploaded_again(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let age = Duration::from_secs(86_400);
    let mut cases = Vec::new();
    for name in ["old", "kept", "again", "queued", "failed"] {
        cases.push(insert(rows, name).await);
        subject.pass(1);
    }
    for name in ["old", "kept", "again"] {
        let claim = claim(rows).await.unwrap();
        let derived = derived(rows, name).await;
        let published = rows.publish(&claim, &derived, &facts()).await.unwrap();
        assert_eq!(published, Published::Done);
    }
    // The last one is leased and fails; the one before it is leased and goes on.
    let _at_work = claim(rows).await.unwrap();
    let failing = claim(rows).await.unwrap();
    assert!(rows.fail(&failing, &failure()).await.unwrap());
    let [old, kept, again, queued, failed] = [0, 1, 2, 3, 4].map(|number| cases[number].id);
    assert!(rows.keep(&kept, true).await.unwrap());
    assert!(rows.case(&kept).await.unwrap().unwrap().kept);
    assert_eq!(rows.expired(age, 10).await.unwrap(), []);

    subject.pass(86_400 - 60);
    let new = new_case(rows, "again").await;
    assert_eq!(rows.insert(&new).await.unwrap(), Inserted::Exists);
    assert!(rows.uploaded_again(&again).await.unwrap());
    let case = rows.case(&again).await.unwrap().unwrap();
    assert!(case.uploaded_at > case.created_at);
    subject.pass(120);
    assert_eq!(rows.expired(age, 10).await.unwrap(), [old, failed]);
    assert_eq!(rows.expired(age, 1).await.unwrap(), [old]);
    for (id, is_deleted) in [
        (old, true),
        (kept, false),
        (again, false),
        (queued, false),
        (old, false),
    ] {
        assert_eq!(
            rows.delete_expired(&id, age).await.unwrap(),
            is_deleted,
            "{id}"
        );
    }
    assert_eq!(rows.objects(&old).await.unwrap(), []);

    // No longer kept, it is as old as it is.
    assert!(rows.keep(&kept, false).await.unwrap());
    assert_eq!(rows.expired(age, 10).await.unwrap(), [kept, failed]);
    assert!(!rows.keep(&old, true).await.unwrap(), "it is gone");
}

pub async fn a_pin_protects_until_it_expires(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let names = [name(ObjectKind::Volume, "a")];
    pinned(rows, &names).await;
    let shorter = pinned(rows, &names).await;
    rows.unpin(&shorter).await.unwrap();
    // One of two pins has expired.
    assert_eq!(rows.abandoned(10).await.unwrap(), names);
    assert_eq!(removed(rows, &names).await, []);
    assert!(rows.abandoned(10).await.unwrap().is_empty());
    subject.pass(3600);
    assert_eq!(rows.abandoned(10).await.unwrap(), names);
    assert_eq!(removed(rows, &names).await, names);
}

pub async fn what_is_being_removed_cannot_be_pinned(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let names = [name(ObjectKind::Volume, "a")];
    rows.unpin(&pinned(rows, &names).await).await.unwrap();
    assert_eq!(rows.mark(&names, &sweep("a")).await.unwrap(), names);
    let again = Pinned {
        holder: "a writer".to_owned(),
        names: vec![name(ObjectKind::Forest, "b"), names[0]],
    };
    assert!(!rows.pin(&again, LEASE).await.unwrap());
    // None of them was pinned.
    subject.pass(31);
    assert!(rows.abandoned(10).await.unwrap().is_empty());
    rows.bury("a").await.unwrap();
    assert!(rows.pin(&again, LEASE).await.unwrap());
    // What is pinned gets no tombstone.
    assert_eq!(rows.mark(&names, &sweep("b")).await.unwrap(), []);
}

pub async fn a_sweep_that_was_killed_is_finished_by_another(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let names = [name(ObjectKind::Volume, "a")];
    rows.unpin(&pinned(rows, &names).await).await.unwrap();
    assert_eq!(rows.mark(&names, &sweep("killed")).await.unwrap(), names);
    // As long as it may live, its tombstones are its own.
    subject.pass(59);
    assert!(rows.abandoned(10).await.unwrap().is_empty());
    assert_eq!(rows.mark(&names, &sweep("next")).await.unwrap(), []);
    subject.pass(1);
    assert_eq!(rows.abandoned(10).await.unwrap(), names);
    assert_eq!(rows.mark(&names, &sweep("next")).await.unwrap(), names);
    rows.bury("next").await.unwrap();
    assert!(rows.abandoned(10).await.unwrap().is_empty());
    pinned(rows, &names).await;
}

pub async fn a_sweep_buries_its_own_tombstones_alone(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let names = [name(ObjectKind::Volume, "a")];
    rows.unpin(&pinned(rows, &names).await).await.unwrap();
    rows.mark(&names, &sweep("slow")).await.unwrap();
    subject.pass(60);
    assert_eq!(rows.mark(&names, &sweep("next")).await.unwrap(), names);
    // The first one comes back after its lease: the tombstone is not its own any more.
    rows.bury("slow").await.unwrap();
    let writer = Pinned {
        holder: "a writer".to_owned(),
        names: names.to_vec(),
    };
    assert!(!rows.pin(&writer, LEASE).await.unwrap());
    rows.bury("next").await.unwrap();
    assert!(rows.pin(&writer, LEASE).await.unwrap());
}

pub async fn a_deleted_case_cannot_be_published(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let new = insert(rows, "a").await;
    let leased = claim(rows).await.unwrap();
    assert!(rows.delete(&new.id).await.unwrap());
    assert!(!rows.renew(&leased, LEASE, None).await.unwrap());
    // The same again is another job: the first one's lease has nothing to do with it.
    insert(rows, "a").await;
    claim(rows).await.unwrap();
    let late = derived(rows, "a").await;
    let published = rows.publish(&leased, &late, &facts()).await.unwrap();
    assert_eq!(published, Published::Fenced);
}

pub async fn a_ready_case_gets_other_objects_or_fails(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let new = insert(rows, "a").await;
    let others = derived(rows, "b").await;
    assert_eq!(
        rows.replace(&new.id, &others).await.unwrap(),
        Published::Fenced
    );
    assert!(!rows.condemn(&new.id, &failure()).await.unwrap());

    let leased = claim(rows).await.unwrap();
    let first = derived(rows, "a").await;
    rows.publish(&leased, &first, &facts()).await.unwrap();
    assert_eq!(
        rows.replace(&new.id, &others).await.unwrap(),
        Published::Done
    );
    let objects = rows.objects(&new.id).await.unwrap();
    assert!(others.names.iter().all(|name| objects.contains(name)));
    let mut dropped = rows.abandoned(10).await.unwrap();
    dropped.sort_by_key(|name| name.kind);
    assert_eq!(dropped, first.names);

    assert!(rows.condemn(&new.id, &failure()).await.unwrap());
    assert_eq!(state(rows, &new).await, Some(CaseState::Failed));
}

pub async fn a_rebuild_is_one_process_s_until_its_lease_ends(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let new = insert(rows, "a").await;
    let begin = async |holder| rows.begin_rebuild(&new.id, holder, LEASE).await.unwrap();
    assert!(begin("first").await);
    assert!(!begin("second").await);
    subject.pass(29);
    // It goes on.
    assert!(begin("first").await);
    subject.pass(29);
    assert!(!begin("second").await);
    rows.end_rebuild(&new.id, "second").await.unwrap();
    assert!(!begin("second").await);
    rows.end_rebuild(&new.id, "first").await.unwrap();
    assert!(begin("second").await);
    subject.pass(30);
    assert!(begin("third").await);
    rows.delete(&new.id).await.unwrap();
    assert!(!begin("third").await);
}

pub async fn a_case_of_another_store_is_adopted_as_it_is_there(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let new = insert(rows, "a").await;
    let leased = claim(rows).await.unwrap();
    let preparing = rows.case(&new.id).await.unwrap().unwrap();
    let published = derived(rows, "a").await;
    rows.publish(&leased, &published, &facts()).await.unwrap();
    let mut ready = rows.case(&new.id).await.unwrap().unwrap();
    let names = rows.objects(&new.id).await.unwrap();
    // What is ready here is not made otherwise.
    let again = pinned(rows, &names).await;
    assert!(!rows.adopt(&preparing, &again).await.unwrap());
    assert_eq!(rows.case(&new.id).await.unwrap().unwrap(), ready);
    rows.unpin(&again).await.unwrap();

    rows.delete(&new.id).await.unwrap();
    let sources = pinned(rows, &new.sources.names).await;
    assert!(rows.adopt(&preparing, &sources).await.unwrap());
    let queued = rows.case(&new.id).await.unwrap().unwrap();
    assert_eq!(
        (queued.state, queued.created_at),
        (CaseState::Queued, ready.created_at)
    );
    assert_eq!(rows.waiting().await.unwrap(), 1);

    ready.parameters.name = Some("another".to_owned());
    assert!(
        rows.adopt(&ready, &pinned(rows, &names).await)
            .await
            .unwrap()
    );
    assert_eq!(rows.case(&new.id).await.unwrap().unwrap(), ready);
    assert_eq!(rows.objects(&new.id).await.unwrap(), names);
    assert_eq!(rows.waiting().await.unwrap(), 0);
}

pub async fn ready_cases_are_found_by_their_voxels(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let of = |values: &str| CaseFacts {
        voxels: Some(VoxelFacts {
            values: values.to_owned(),
            moments: [1, 2, 3],
        }),
        ..facts()
    };
    let mut ids = Vec::new();
    for (contents, values) in [("a", "same"), ("b", "other"), ("c", "same"), ("d", "same")] {
        let new = insert(rows, contents).await;
        let leased = claim(rows).await.unwrap();
        let published = derived(rows, contents).await;
        rows.publish(&leased, &published, &of(values))
            .await
            .unwrap();
        ids.push(new.id);
        subject.pass(1);
    }
    let found = async |values: &str, limit| {
        let cases = rows.cases_with_voxels(values, limit).await.unwrap();
        cases.into_iter().map(|case| case.id).collect::<Vec<_>>()
    };
    assert_eq!(found("same", 10).await, [ids[3], ids[2], ids[0]]);
    assert_eq!(found("same", 1).await, [ids[3]]);
    assert_eq!(found("none", 10).await, []);
    rows.condemn(&ids[3], &failure()).await.unwrap();
    assert_eq!(found("same", 10).await, [ids[2], ids[0]]);

    let ready = rows.case(&ids[0]).await.unwrap().unwrap();
    let names = rows.objects(&ids[0]).await.unwrap();
    rows.delete(&ids[0]).await.unwrap();
    assert_eq!(found("same", 10).await, [ids[2]]);
    let again = pinned(rows, &names).await;
    assert!(rows.adopt(&ready, &again).await.unwrap());
    assert_eq!(found("same", 10).await, [ids[2], ids[0]]);
}

pub async fn what_nobody_needs_is_told(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let needed = insert(rows, "needed").await.sources.names[0];
    let [unknown, pin, marked] =
        ["unknown", "pin", "marked"].map(|of| name(ObjectKind::Volume, of));
    pinned(rows, &[pin]).await;
    rows.mark(&[marked], &sweep("a sweep")).await.unwrap();
    let unneeded = rows
        .unneeded(&[needed, unknown, pin, marked])
        .await
        .unwrap();
    assert_eq!(unneeded, [unknown]);
    rows.inspect().await.unwrap();
}

pub async fn holders_that_are_dead_hold_nothing(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let new = insert(rows, "a").await;
    claim(rows).await.unwrap();
    let names = [name(ObjectKind::Volume, "a"), name(ObjectKind::Volume, "b")];
    pinned(rows, &names[..1]).await;
    rows.unpin(&pinned(rows, &names[1..]).await).await.unwrap();
    rows.mark(&names[1..], &sweep("dead")).await.unwrap();
    assert!(rows.begin_rebuild(&new.id, "dead", LEASE).await.unwrap());
    rows.forget_holders().await.unwrap();
    assert_eq!(claim(rows).await.unwrap().id, new.id);
    assert!(rows.begin_rebuild(&new.id, "alive", LEASE).await.unwrap());
    let mut abandoned = rows.abandoned(10).await.unwrap();
    abandoned.sort_by_key(|name| name.digest.to_string());
    let mut expected = names.to_vec();
    expected.sort_by_key(|name| name.digest.to_string());
    assert_eq!(abandoned, expected);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SqlRows;

    fn subject(rows: SqlRows, keep: impl Send + Sync + 'static) -> RowsSubject {
        let clock = rows.clone();
        RowsSubject {
            rows: Arc::new(rows),
            pass_time: Box::new(move |by| clock.pass_time(by)),
            keep: Box::new(keep),
        }
    }

    async fn rows_in_memory() -> RowsSubject {
        subject(SqlRows::in_memory().await.unwrap(), ())
    }

    async fn rows_in_a_file() -> RowsSubject {
        let directory = tempfile::tempdir().unwrap();
        let rows = SqlRows::sqlite(&directory.path().join("rows.sqlite")).await;
        subject(rows.unwrap(), directory)
    }

    crate::rows_conformance! {
        memory: super::rows_in_memory,
        file: super::rows_in_a_file,
    }
}
