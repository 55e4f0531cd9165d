//! What comes from a PACS.

use std::collections::HashSet;
use std::time::Duration;

use case::{CaseId, Failure, ObjectKind};

use super::RowsSubject;
use crate::ObjectName;
use crate::arrivals::{
    AccessionNumber, ArrivalCursor, ArrivalSource, ArrivalState, BECAME_LAYER, CaseSeries, Change,
    DueTerms, NOT_T1, NewInstance, OTHER_OBJECTS, Outcome, Received, SeriesQuery, SeriesUids,
    TransferEnd, TransferState, Uid,
};
use crate::rows::{CaseRows, DueSeries, Sweep};
use crate::testing::{failure, new_case, pinned};

const TERMS: DueTerms = DueTerms {
    stable: Duration::from_secs(20),
    patience: Duration::from_secs(200),
    lease: Duration::from_secs(60),
};

fn uid(text: &str) -> Uid {
    Uid::parse(text).unwrap()
}

fn series(number: u32) -> SeriesUids {
    SeriesUids {
        study: uid("1.2.3"),
        series: uid(&format!("1.2.3.{number}")),
    }
}

/// An image of a series, whose file has other contents for each image.
fn image(number: u32, image: u32) -> NewInstance {
    let name = format!("1.2.3.{number}.{image}");
    NewInstance {
        uids: series(number),
        accession_number: AccessionNumber::parse("A1"),
        digest: blake3::hash(name.as_bytes()),
        sop_instance_uid: uid(&name),
        replaces: None,
    }
}

async fn receive(rows: &dyn CaseRows, images: &[NewInstance]) -> usize {
    received(rows, images).await.new
}

async fn received(rows: &dyn CaseRows, images: &[NewInstance]) -> Received {
    let names: Vec<_> = images.iter().map(ObjectName::from).collect();
    let pinned = pinned(rows, &names).await;
    let received = rows.receive(images, &pinned, ArrivalSource::Stow).await;
    received.unwrap().expect("the pins are there")
}

async fn due(rows: &dyn CaseRows) -> Option<DueSeries> {
    rows.lease_due(&TERMS).await.unwrap()
}

async fn a_case(rows: &dyn CaseRows, contents: &str) -> CaseId {
    let new = new_case(rows, contents).await;
    rows.insert(&new).await.unwrap();
    new.id
}

/// The objects of all images, read one by one.
async fn listed(rows: &dyn CaseRows) -> HashSet<ObjectName> {
    let mut found = HashSet::new();
    let mut after = None;
    while let [name] = rows
        .pacs_objects(ObjectKind::Instance, after.as_ref(), 1)
        .await
        .unwrap()[..]
    {
        assert!(found.insert(name), "each comes once");
        after = Some(name);
    }
    found
}

fn study() -> SeriesQuery {
    SeriesQuery::Study(uid("1.2.3"), None)
}

pub async fn an_image_is_received_once(subject: &RowsSubject) {
    let rows = &*subject.rows;
    assert_eq!(receive(rows, &[image(1, 1), image(1, 2)]).await, 2);
    assert_eq!(receive(rows, &[image(1, 2), image(2, 1)]).await, 1);
    assert_eq!(
        listed(rows).await,
        [image(1, 1), image(1, 2), image(2, 1)]
            .iter()
            .map(ObjectName::from)
            .collect()
    );
    // The same image with other contents stays as it came first.
    let other = NewInstance {
        digest: blake3::hash(b"another"),
        ..image(1, 1)
    };
    assert_eq!(receive(rows, std::slice::from_ref(&other)).await, 0);
    let arrivals = rows.arrivals_of(&study()).await.unwrap();
    let counts: Vec<_> = arrivals.iter().map(|arrival| arrival.instances).collect();
    assert_eq!(counts, [2, 1]);
    assert!(
        arrivals
            .iter()
            .all(|arrival| arrival.state == ArrivalState::Receiving)
    );
    let unneeded = rows
        .unneeded(&[ObjectName::from(&image(1, 1)), ObjectName::from(&other)])
        .await
        .unwrap();
    assert_eq!(unneeded, [], "the other contents still have a pin");
    assert_eq!(rows.abandoned(10).await.unwrap().len(), 2);
    // Without pins nothing is received.
    let images = [image(3, 1)];
    let mut lost = pinned(rows, &[ObjectName::from(&images[0])]).await;
    lost.holder = "another".to_owned();
    let received = rows.receive(&images, &lost, ArrivalSource::Stow).await;
    assert_eq!(received.unwrap(), None);
    assert_eq!(rows.arrivals_of(&study()).await.unwrap().len(), 2);
}

pub async fn an_image_that_replaces_another_supersedes_the_cases_of_its_series(
    subject: &RowsSubject,
) {
    let rows = &*subject.rows;
    receive(rows, &[image(1, 1), image(1, 2)]).await;
    subject.pass(21);
    let first = a_case(rows, "a").await;
    let leased = due(rows).await.unwrap();
    assert!(rows.settle(&leased, &Outcome::Case(first)).await.unwrap());
    let corrected = |number: u32, change| NewInstance {
        digest: blake3::hash(format!("corrected {number}").as_bytes()),
        replaces: Some(change),
        ..image(1, number)
    };
    let known = rows.known(&[image(1, 1), image(1, 3)]).await.unwrap();
    assert_eq!(known, [Some(ObjectName::from(&image(1, 1))), None]);
    // Other pixels are no reason to distrust the patient of the case.
    let pixels = received(rows, &[corrected(1, Change::Pixels)]).await;
    let arrival = rows.arrivals_of(&study()).await.unwrap().remove(0);
    assert_eq!(pixels.corrected, [arrival.id.as_str()]);
    assert_eq!(
        (arrival.state, arrival.superseded, arrival.instances),
        (ArrivalState::Receiving, 1, 2)
    );
    assert!(!rows.series_of(&first).await.unwrap().unwrap().is_superseded);
    // Of each series, only the first image is reported.
    let owner = received(rows, &[corrected(2, Change::Owner)]).await;
    assert_eq!((owner.new, owner.corrected.len()), (0, 0));
    assert!(rows.series_of(&first).await.unwrap().unwrap().is_superseded);
    let old = [image(1, 1), image(1, 2)].map(|image| ObjectName::from(&image));
    let abandoned = rows.abandoned(10).await.unwrap();
    assert!(old.iter().all(|name| abandoned.contains(name)));
    // The new case is not superseded, and a correction that is taken back leads to the first one again.
    subject.pass(21);
    let second = a_case(rows, "b").await;
    let leased = due(rows).await.unwrap();
    assert_eq!(leased.previous, Some(first));
    assert!(rows.settle(&leased, &Outcome::Case(second)).await.unwrap());
    assert!(
        !rows
            .series_of(&second)
            .await
            .unwrap()
            .unwrap()
            .is_superseded
    );
    let back = NewInstance {
        replaces: Some(Change::Owner),
        ..image(1, 2)
    };
    assert_eq!(received(rows, &[back]).await.corrected.len(), 1);
    subject.pass(21);
    let leased = due(rows).await.unwrap();
    assert!(rows.settle(&leased, &Outcome::Case(first)).await.unwrap());
    let is_superseded = async |case| rows.series_of(case).await.unwrap().unwrap().is_superseded;
    assert!(!is_superseded(&first).await && is_superseded(&second).await);
}

pub async fn objects_that_are_not_kept_are_counted(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let reason = Failure::unusable(OTHER_OBJECTS, "the series has no image");
    for _ in 0..2 {
        rows.ignore(&series(1), ArrivalSource::CStore, &reason)
            .await
            .unwrap();
    }
    let arrival = rows.arrivals_of(&study()).await.unwrap().remove(0);
    assert_eq!(
        (arrival.state, arrival.ignored, arrival.instances),
        (ArrivalState::Nothing, 2, 0)
    );
    assert_eq!(arrival.reason, Some(reason));
    subject.pass(21);
    assert!(due(rows).await.is_none());
    receive(rows, &[image(1, 1)]).await;
    let arrival = rows.arrivals_of(&study()).await.unwrap().remove(0);
    assert_eq!(
        (arrival.state, arrival.ignored, arrival.instances),
        (ArrivalState::Receiving, 2, 1)
    );
}

pub async fn a_series_is_due_when_nothing_came_for_a_while(subject: &RowsSubject) {
    let rows = &*subject.rows;
    receive(rows, &[image(1, 2)]).await;
    subject.pass(15);
    receive(rows, &[image(1, 1)]).await;
    subject.pass(15);
    assert!(due(rows).await.is_none());
    subject.pass(6);
    let leased = due(rows).await.expect("it is due");
    assert_eq!(leased.uids, series(1));
    assert_eq!(
        leased.instances,
        [
            ObjectName::from(&image(1, 1)),
            ObjectName::from(&image(1, 2))
        ]
    );
    assert!(due(rows).await.is_none(), "it is leased");
    let later = Outcome::Later(Duration::from_secs(5));
    assert!(rows.settle(&leased, &later).await.unwrap());
    assert!(due(rows).await.is_none());
    subject.pass(6);
    let first = due(rows).await.expect("it is due again");
    subject.pass(61);
    let second = due(rows).await.expect("the lease has ended");
    let nothing = Outcome::Nothing(failure());
    assert!(!rows.settle(&first, &nothing).await.unwrap());
    assert!(rows.settle(&second, &nothing).await.unwrap());
    assert!(due(rows).await.is_none());
    let arrival = &rows.arrivals_of(&study()).await.unwrap()[0];
    assert_eq!(arrival.state, ArrivalState::Nothing);
    assert_eq!(arrival.reason, Some(failure()));
}

pub async fn a_series_with_all_announced_images_waits_no_longer(subject: &RowsSubject) {
    let rows = &*subject.rows;
    receive(rows, &[image(1, 1), image(2, 1)]).await;
    rows.expect(&series(1), 2).await.unwrap();
    rows.expect(&series(2), 2).await.unwrap();
    assert!(due(rows).await.is_none());
    receive(rows, &[image(1, 2)]).await;
    assert_eq!(due(rows).await.expect("all are there").uids, series(1));
    // An announced image that does not come is waited for longer, and not for ever.
    subject.pass(25);
    assert!(due(rows).await.is_none());
    subject.pass(180);
    let uids = due(rows).await.map(|leased| leased.uids);
    assert!(uids == Some(series(2)) || uids == Some(series(1)));
}

pub async fn a_late_image_fences_the_reader_off_and_makes_the_series_due_again(
    subject: &RowsSubject,
) {
    let rows = &*subject.rows;
    let case = a_case(rows, "a").await;
    receive(rows, &[image(1, 1)]).await;
    subject.pass(21);
    let leased = due(rows).await.unwrap();
    receive(rows, &[image(1, 2)]).await;
    assert!(!rows.settle(&leased, &Outcome::Case(case)).await.unwrap());
    subject.pass(21);
    let leased = due(rows).await.unwrap();
    assert_eq!(leased.instances.len(), 2);
    assert_eq!(leased.previous, None);
    assert!(rows.settle(&leased, &Outcome::Case(case)).await.unwrap());
    receive(rows, &[image(1, 3)]).await;
    subject.pass(21);
    let leased = due(rows).await.expect("a late image came");
    assert_eq!(leased.previous, Some(case));
    let nothing = Outcome::Nothing(failure());
    assert!(rows.settle(&leased, &nothing).await.unwrap());
    let arrival = &rows.arrivals_of(&study()).await.unwrap()[0];
    assert_eq!(
        (arrival.state, arrival.case),
        (ArrivalState::Nothing, Some(case))
    );
    // A case that is gone is no outcome.
    receive(rows, &[image(2, 1)]).await;
    subject.pass(21);
    let leased = due(rows).await.unwrap();
    assert!(rows.delete(&case).await.unwrap());
    assert!(!rows.settle(&leased, &Outcome::Case(case)).await.unwrap());
}

pub async fn a_series_that_is_not_t1_waits_for_a_case_of_its_study(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let case = a_case(rows, "a").await;
    receive(rows, &[image(1, 1)]).await;
    subject.pass(21);
    let leased = due(rows).await.unwrap();
    let not_t1 = Outcome::Nothing(Failure::unusable(NOT_T1, "words"));
    assert!(rows.settle(&leased, &not_t1).await.unwrap());
    assert!(due(rows).await.is_none());
    receive(rows, &[image(2, 1)]).await;
    subject.pass(21);
    let leased = due(rows).await.unwrap();
    assert!(rows.settle(&leased, &Outcome::Case(case)).await.unwrap());
    let again = due(rows).await.expect("there is a case now");
    assert_eq!(again.uids, series(1));
    assert!(rows.settle(&again, &Outcome::Layer(case)).await.unwrap());
    assert!(due(rows).await.is_none(), "a layer wakes nothing");
    let arrivals = rows.arrivals_of(&study()).await.unwrap();
    let layer = arrivals.iter().find(|arrival| arrival.uids == series(1));
    let layer = layer.unwrap();
    assert_eq!(layer.case, Some(case));
    assert_eq!(layer.reason.as_ref().unwrap().name, BECAME_LAYER);
    // The series of the case is still the one that it was made of.
    let indexed = rows.series_of(&case).await.unwrap().unwrap();
    assert_eq!(indexed.uids, series(2));
}

pub async fn an_image_is_kept_until_its_series_is_forgotten_or_its_case_deleted(
    subject: &RowsSubject,
) {
    let rows = &*subject.rows;
    let case = a_case(rows, "a").await;
    receive(rows, &[image(1, 1), image(2, 1), image(3, 1)]).await;
    let objects = [1, 2, 3].map(|number| ObjectName::from(&image(number, 1)));
    assert_eq!(rows.unneeded(&objects).await.unwrap(), []);
    subject.pass(21);
    for outcome in [Outcome::Case(case), Outcome::Nothing(failure())] {
        let leased = due(rows).await.unwrap();
        assert!(rows.settle(&leased, &outcome).await.unwrap());
    }
    let settled: Vec<_> = rows.arrivals_of(&study()).await.unwrap();
    let becomes = |state| {
        let of_state = settled.iter().find(|arrival| arrival.state == state);
        of_state.unwrap().uids.series.as_str().to_owned()
    };
    let (of_case, of_nothing) = (becomes(ArrivalState::Case), becomes(ArrivalState::Nothing));
    let uids = |text: &str| SeriesUids {
        study: uid("1.2.3"),
        series: uid(text),
    };
    let images = rows.images_of(&uids(&of_case)).await.unwrap();
    assert_eq!(images.len(), 1);
    assert!(objects.contains(&images[0].1));
    assert_eq!(rows.studies(0, 9).await.unwrap(), [uid("1.2.3")]);
    assert_eq!(rows.studies(1, 9).await.unwrap(), []);
    subject.pass(3600);
    let forgotten = rows.forget_arrivals(Duration::from_secs(7200), false).await;
    assert_eq!(forgotten.unwrap(), 0);
    let forgotten = rows.forget_arrivals(Duration::from_secs(60), true).await;
    assert_eq!(
        forgotten.unwrap(),
        1,
        "the one that still comes is kept, and that of the case"
    );
    let left = rows.arrivals_of(&study()).await.unwrap();
    assert!(
        left.iter()
            .all(|arrival| arrival.uids.series.as_str() != of_nothing)
    );
    assert!(rows.delete(&case).await.unwrap());
    assert_eq!(rows.images_of(&uids(&of_case)).await.unwrap(), []);
    assert_eq!(rows.studies(0, 9).await.unwrap(), []);
    let left = rows.arrivals_of(&study()).await.unwrap();
    assert!(
        left.iter()
            .all(|arrival| arrival.uids.series.as_str() != of_case)
    );
    assert_eq!(left.len(), 1);
    let sweep = Sweep {
        holder: "sweep".to_owned(),
        lease: Duration::from_secs(60),
    };
    assert_eq!(rows.mark(&objects, &sweep).await.unwrap().len(), 2);
    assert!(objects.iter().all(|name| name.kind == ObjectKind::Instance));
}

pub async fn cases_are_found_by_their_series(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let [first, second] = [a_case(rows, "a").await, a_case(rows, "b").await];
    receive(rows, &[image(1, 1)]).await;
    subject.pass(21);
    let leased = due(rows).await.unwrap();
    assert!(rows.settle(&leased, &Outcome::Case(first)).await.unwrap());
    let of_second = CaseSeries {
        case: second,
        uids: series(2),
        accession_number: AccessionNumber::parse("A2"),
        is_superseded: false,
    };
    for _ in 0..2 {
        rows.index_series(&of_second).await.unwrap();
    }
    assert_eq!(rows.series_of(&second).await.unwrap(), Some(of_second));
    let found = async |query| {
        let found = rows.cases_of(&query).await.unwrap();
        found
            .into_iter()
            .map(|series| series.case)
            .collect::<Vec<_>>()
    };
    let mut both = found(study()).await;
    both.sort_by_key(|id| *id == second);
    assert_eq!(both, [first, second]);
    let one = SeriesQuery::Study(uid("1.2.3"), Some(uid("1.2.3.1")));
    assert_eq!(found(one).await, [first]);
    let number = |text| SeriesQuery::AccessionNumber(AccessionNumber::parse(text).unwrap());
    assert_eq!(found(number("A1")).await, [first]);
    assert_eq!(found(number("A2")).await, [second]);
    assert_eq!(found(number("A")).await, []);
    rows.delete(&second).await.unwrap();
    assert_eq!(found(number("A2")).await, []);
    let arrivals = rows.arrivals_of(&number("A1")).await.unwrap();
    assert_eq!(arrivals.len(), 1);
}

pub async fn series_are_listed_newest_first_in_pages(subject: &RowsSubject) {
    let rows = &*subject.rows;
    for number in 1..=5 {
        receive(rows, &[image(number, 1)]).await;
        subject.pass(1);
    }
    let mut seen = Vec::new();
    let mut after: Option<ArrivalCursor> = None;
    loop {
        let (page, next) = rows.arrivals(after.as_ref(), 2).await.unwrap();
        assert!(page.len() <= 2);
        seen.extend(page.into_iter().map(|arrival| arrival.uids));
        let Some(next) = next else { break };
        after = ArrivalCursor::parse(&next.to_string());
        assert!(after.is_some());
        assert_eq!(rows.arrival(&next.id).await.unwrap().unwrap().id, next.id);
    }
    assert_eq!(seen, [5, 4, 3, 2, 1].map(series));
}

pub async fn a_retrieval_is_queued_once_and_leased_until_it_ends(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let lease = Duration::from_secs(30);
    let first = rows.request("pacs", &series(1)).await.unwrap();
    assert_eq!(first.state, TransferState::Queued);
    let again = rows.request("pacs", &series(1)).await.unwrap();
    assert_eq!(again.id, first.id);
    let other = rows.request("other", &series(1)).await.unwrap();
    assert_ne!(other.id, first.id);
    let leased = rows.lease_retrieval(lease).await.unwrap().unwrap();
    assert_eq!(
        (leased.id.as_str(), leased.attempts),
        (first.id.as_str(), 1)
    );
    assert!(rows.progress(&leased, 3, Some(9), lease).await.unwrap());
    let seen = rows.retrieval(&first.id).await.unwrap().unwrap();
    assert_eq!(
        (seen.state, seen.received, seen.expected),
        (TransferState::Running, 3, Some(9))
    );
    // A request while it is fetched may be about images that came since it began.
    let third = rows.request("pacs", &series(1)).await.unwrap();
    assert_ne!(third.id, first.id);
    subject.pass(31);
    let stolen = rows.lease_retrieval(lease).await.unwrap().unwrap();
    assert_eq!(
        (stolen.id.as_str(), stolen.attempts),
        (first.id.as_str(), 2)
    );
    assert!(!rows.progress(&leased, 4, None, lease).await.unwrap());
    assert!(
        !rows
            .end_retrieval(&leased, &TransferEnd::Done)
            .await
            .unwrap()
    );
    let later = TransferEnd::Later(Duration::from_secs(10));
    assert!(rows.end_retrieval(&stolen, &later).await.unwrap());
    let next = rows.lease_retrieval(lease).await.unwrap().unwrap();
    assert_eq!(next.id, other.id);
    let failed = TransferEnd::Failed(failure());
    assert!(rows.end_retrieval(&next, &failed).await.unwrap());
    let failed = rows.retrieval(&other.id).await.unwrap().unwrap();
    assert_eq!(
        (failed.state, failed.reason),
        (TransferState::Failed, Some(failure()))
    );
    assert_eq!(rows.retrieval(&"0".repeat(32)).await.unwrap(), None);
    rows.forget_holders().await.unwrap();
}
