//! What comes from a PACS.

use std::collections::HashSet;
use std::time::Duration;

use crate::identity::Rejection;
use case::images::{Fingerprint, Image};
use case::series::{AccessionNumber, SeriesQuery, SeriesUids, Uid};
use case::{CaseId, Closed, Failure, ObjectKind};
use storage::tables::Referred;
use storage::testing::failure;
use storage::testing::steps::{self, delete_rows, insert_case, pinned, unneeded};
use storage::upkeep::{Removal, Waiting};
use storage::{Claim, Cursor, ObjectName, Release};

use super::Subject;
use crate::refusal::Refusal;
use crate::store::PacsStore;
use crate::values::{
    ALL_REFUSED, ArrivalQuery, ArrivalSource, ArrivalState, BECAME_LAYER, DueSeries, DueTerms,
    INCOMPLETE_CORRECTION, MOVED, NO_CASE, NOT_T1, NewInstance, OTHER_OBJECTS, Outcome, REJECTED,
    Reception, SERIES, Taken, TakenAs,
};

const TERMS: DueTerms = DueTerms {
    stable: Duration::from_secs(20),
    patience: Duration::from_secs(200),
};

const DAY: u64 = 24 * 3600;

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
        label: Some(format!("T1 {number}% · 2026-01-02")),
        fingerprint: print(&name),
    }
}

/// The fingerprint of an image with these contents.
fn print(contents: &str) -> Option<Fingerprint> {
    let digest = blake3::hash(contents.as_bytes()).to_hex();
    Fingerprint::new(&digest[..32], false, vec![0.0; 9])
}

/// The same image with other contents.
fn corrected(of: NewInstance, contents: &str) -> NewInstance {
    NewInstance {
        digest: blake3::hash(contents.as_bytes()),
        fingerprint: print(contents),
        ..of
    }
}

/// What is made of images.
fn made_of(images: &[NewInstance]) -> Vec<Image> {
    let made = images.iter().map(|image| Image {
        uid: image.sop_instance_uid.clone(),
        fingerprint: image.fingerprint.clone().unwrap(),
        times: 0,
    });
    made.collect()
}

/// The same, if a PACS had sent each image once when they were read.
fn read_of(images: &[NewInstance]) -> Vec<Image> {
    let mut read = made_of(images);
    read.iter_mut().for_each(|image| image.times = 1);
    read
}

async fn receive(store: &PacsStore, images: &[NewInstance]) -> usize {
    let received = received(store, images).await.into_iter();
    received.filter(|became| *became == Reception::New).count()
}

async fn received(store: &PacsStore, images: &[NewInstance]) -> Vec<Reception> {
    let names: Vec<_> = images.iter().map(ObjectName::from).collect();
    let pinned = pinned(store.store(), &names).await;
    let source = ArrivalSource::Stow;
    match store.insert_images(images, &pinned, source).await.unwrap() {
        Referred::Done(received) => received,
        other => panic!("{other:?}"),
    }
}

/// Leases the job of a series that is due, and what it is to read.
async fn due(store: &PacsStore) -> Option<(Claim, DueSeries)> {
    store.queue_due_series(&TERMS).await.unwrap();
    let claim = store.store().claim(SERIES, 3).await.unwrap()?;
    let due = store.series_to_read(&claim).await.unwrap();
    Some((claim, due.expect("the series is there")))
}

async fn a_case(store: &PacsStore, contents: &str) -> CaseId {
    a_case_of(store, contents, &[]).await
}

/// A case that is made of these images.
async fn a_case_of(store: &PacsStore, contents: &str, images: &[NewInstance]) -> CaseId {
    a_version_of(store, contents, images, None).await
}

async fn a_version_of(
    store: &PacsStore,
    contents: &str,
    images: &[NewInstance],
    previous: Option<CaseId>,
) -> CaseId {
    insert_case(store.store(), contents, Some(made_of(images)), previous).await
}

async fn closed(store: &PacsStore, case: CaseId) -> Option<Closed> {
    store.store().case(&case).await.unwrap().unwrap().closed
}

/// The objects of all images, read one by one.
async fn listed(store: &PacsStore) -> HashSet<ObjectName> {
    let mut found = HashSet::new();
    let mut after = None;
    while let [name] =
        steps::objects_of_tables(store.store(), ObjectKind::Instance, after.as_ref(), 1)
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

pub(crate) async fn an_image_is_received_once(subject: &Subject) {
    let store = &subject.store;
    assert_eq!(receive(store, &[image(1, 1), image(1, 2)]).await, 2);
    assert_eq!(receive(store, &[image(1, 2), image(2, 1)]).await, 1);
    assert_eq!(
        listed(store).await,
        [image(1, 1), image(1, 2), image(2, 1)]
            .iter()
            .map(ObjectName::from)
            .collect()
    );
    // The same image in another file stays as it came first.
    let other = NewInstance {
        digest: blake3::hash(b"another"),
        ..image(1, 1)
    };
    assert_eq!(receive(store, std::slice::from_ref(&other)).await, 0);
    let arrivals = store.arrivals_of(&study()).await.unwrap();
    let counts: Vec<_> = arrivals.iter().map(|arrival| arrival.instances).collect();
    assert_eq!(counts, [2, 1]);
    assert!(
        arrivals
            .iter()
            .all(|arrival| arrival.state == ArrivalState::Receiving)
    );
    let number = SeriesQuery::AccessionNumber(AccessionNumber::parse("A1").unwrap());
    assert_eq!(store.arrivals_of(&number).await.unwrap(), arrivals);
    let both = [ObjectName::from(&image(1, 1)), ObjectName::from(&other)];
    let unneeded = unneeded(store.store(), &both).await.unwrap();
    assert_eq!(unneeded, [], "the other contents still have a pin");
    assert_eq!(steps::abandoned(store.store(), 10).await.unwrap().len(), 2);
    // Without pins nothing is received.
    let images = [image(3, 1)];
    let mut lost = pinned(store.store(), &[ObjectName::from(&images[0])]).await;
    lost.holder = "another".to_owned();
    let received = store
        .insert_images(&images, &lost, ArrivalSource::Stow)
        .await;
    assert_eq!(received.unwrap(), Referred::PinLost);
    assert_eq!(store.arrivals_of(&study()).await.unwrap().len(), 2);
}

pub(crate) async fn a_case_is_closed_while_the_last_image_is_another_one(subject: &Subject) {
    let store = &subject.store;
    let images = [image(1, 1), image(1, 2)];
    let uploaded = a_case_of(store, "uploaded", &[image(5, 1)]).await;
    receive(store, &images).await;
    subject.pass(21);
    let first = insert_case(store.store(), "a", Some(read_of(&images)), None).await;
    let (leased, _) = due(store).await.unwrap();
    assert!(store.settle(&leased, &Outcome::Case(first)).await.unwrap());
    let other = corrected(image(1, 2), "corrected");
    assert_eq!(
        received(store, std::slice::from_ref(&other)).await,
        [Reception::Corrected]
    );
    let arrival = store.arrivals_of(&study()).await.unwrap().remove(0);
    assert_eq!(
        (
            arrival.state,
            arrival.corrected,
            arrival.instances,
            arrival.case
        ),
        (ArrivalState::Receiving, 1, 2, None)
    );
    assert_eq!(closed(store, first).await, Some(Closed::Corrected));
    // What no PACS has sent closes nothing, and an upload of the former images is closed at once.
    assert_eq!(closed(store, uploaded).await, None);
    let again = a_case_of(store, "again", &images).await;
    assert_eq!(closed(store, again).await, Some(Closed::Corrected));
    // Rounding and loss make no other image, and what cannot be decoded takes nobody's place.
    let made = store.made_of_any(&made_of(&images)).await.unwrap();
    let come_again = |case| {
        let made = made.iter().find(|made| made.case == case).unwrap();
        made.images
            .iter()
            .map(|image| image.has_come_again)
            .collect::<Vec<_>>()
    };
    assert_eq!(come_again(first), [false, true]);
    assert_eq!(
        come_again(again),
        [true, true],
        "what was uploaded was never sent"
    );
    let is_received: Vec<_> = made.iter().map(|made| made.is_received).collect();
    assert_eq!(is_received, [false, true]);
    let undecodable = NewInstance {
        digest: blake3::hash(b"rubbish"),
        fingerprint: None,
        ..image(1, 2)
    };
    assert_eq!(received(store, &[undecodable]).await, [Reception::Refused]);
    // One that has lost something is the same in its own series, and has no place in another one.
    let lossy = |of: NewInstance| {
        let print = blake3::hash(b"lossy").to_hex();
        NewInstance {
            digest: blake3::hash(b"lossy"),
            fingerprint: Fingerprint::new(&print[..32], true, vec![0.0; 9]),
            ..of
        }
    };
    assert_eq!(
        received(store, &[lossy(image(1, 1))]).await,
        [Reception::Known]
    );
    let elsewhere = NewInstance {
        uids: series(7),
        ..lossy(image(1, 1))
    };
    assert_eq!(received(store, &[elsewhere]).await, [Reception::Refused]);
    // It is corrected back.
    assert_eq!(
        received(store, &[image(1, 2)]).await,
        [Reception::Corrected]
    );
    for case in [first, again] {
        assert_eq!(closed(store, case).await, None);
    }
    // A case that was closed and is made again of what came last is open.
    received(store, std::slice::from_ref(&other)).await;
    assert_eq!(closed(store, first).await, Some(Closed::Corrected));
    a_case_of(store, "a", &[image(1, 1), other]).await;
    assert_eq!(closed(store, first).await, None);
}

pub(crate) async fn an_unchanged_image_wakes_a_series_that_waits_for_it(subject: &Subject) {
    let store = &subject.store;
    let images = [image(1, 1), image(1, 2)];
    receive(store, &images).await;
    subject.pass(21);
    let case = a_case_of(store, "a", &images).await;
    let (leased, _) = due(store).await.unwrap();
    assert!(store.settle(&leased, &Outcome::Case(case)).await.unwrap());
    // What is sent twice is read once more, so that it has not come again when a correction comes.
    for outcome in [
        Outcome::Case(case),
        Outcome::Nothing(Failure::unusable(INCOMPLETE_CORRECTION, "words")),
        Outcome::Nothing(failure()),
    ] {
        assert_eq!(receive(store, &images[..1]).await, 0);
        let arrival = store.arrivals_of(&study()).await.unwrap().remove(0);
        assert_eq!(
            (arrival.state, arrival.case),
            (ArrivalState::Receiving, Some(case))
        );
        subject.pass(21);
        let (leased, _) = due(store).await.expect("it is read again");
        assert!(store.settle(&leased, &outcome).await.unwrap());
    }
    // A series that is nothing for another reason waits for no image that is here.
    assert_eq!(receive(store, &images[..1]).await, 0);
    subject.pass(21);
    assert!(due(store).await.is_none());
}

pub(crate) async fn what_replaces_a_closed_case_inherits_nothing(subject: &Subject) {
    let store = &subject.store;
    let findings = async |case: CaseId| store.store().findings(&case).await.unwrap().document;
    let images = [image(1, 1), image(1, 2)];
    let first = a_case_of(store, "a", &images[..1]).await;
    let none = store.store().findings(&first).await.unwrap().version;
    let marked = store
        .store()
        .replace_findings(&first, none, "[1]".to_owned());
    marked.await.unwrap();
    let grown = a_version_of(store, "b", &images, Some(first)).await;
    assert_eq!(findings(grown).await, "[1]");
    let other = corrected(image(1, 1), "corrected");
    receive(store, &[image(1, 1)]).await;
    received(store, std::slice::from_ref(&other)).await;
    for case in [first, grown] {
        assert_eq!(closed(store, case).await, Some(Closed::Corrected));
    }
    let corrected = a_version_of(store, "c", &[other, image(1, 2)], Some(first)).await;
    assert_eq!(
        (closed(store, corrected).await, findings(corrected).await),
        (None, "[]".to_owned())
    );
    // A version with another mask is of the same images, and closed with them.
    let masked = insert_case(store.store(), "d", None, Some(first)).await;
    assert_eq!(closed(store, masked).await, Some(Closed::Corrected));
    assert_eq!(findings(masked).await, "[1]");
}

pub(crate) async fn objects_that_are_not_kept_are_counted(subject: &Subject) {
    let store = &subject.store;
    let reason = Failure::unusable(OTHER_OBJECTS, "the series has no image");
    for _ in 0..2 {
        store
            .ignore(&series(1), ArrivalSource::CStore, &reason)
            .await
            .unwrap();
    }
    let arrival = store.arrivals_of(&study()).await.unwrap().remove(0);
    assert_eq!(
        (arrival.state, arrival.ignored, arrival.instances),
        (ArrivalState::Nothing, 2, 0)
    );
    assert_eq!(arrival.reason, Some(reason));
    subject.pass(21);
    assert!(due(store).await.is_none());
    receive(store, &[image(1, 1)]).await;
    let arrival = store.arrivals_of(&study()).await.unwrap().remove(0);
    assert_eq!(
        (arrival.state, arrival.ignored, arrival.instances),
        (ArrivalState::Receiving, 2, 1)
    );
}

pub(crate) async fn what_is_refused_is_counted_and_makes_few_rows(subject: &Subject) {
    let store = &subject.store;
    let refusal = Refusal::NOT_BETTER;
    let source = ArrivalSource::CStore;
    let refuse = async |number| {
        let uids = series(number);
        let refused = store.refuse(&[(uids, refusal.clone())], source).await;
        refused.unwrap();
        // The newest are kept.
        subject.pass(1);
    };
    for number in [1, 1, 2] {
        refuse(number).await;
    }
    let arrival = store.arrivals_of(&study()).await.unwrap().remove(0);
    assert_eq!(
        (arrival.state, arrival.refused_objects),
        (ArrivalState::Nothing, 2)
    );
    assert_eq!(arrival.reason.unwrap().name, ALL_REFUSED);
    assert_eq!(arrival.last_refusal, Some(refusal.why.to_string()));
    subject.pass(21);
    assert!(due(store).await.is_none());
    // One of which another object came says so.
    let other = Failure::unusable(OTHER_OBJECTS, "words");
    store.ignore(&series(2), source, &other).await.unwrap();
    let arrivals = store.arrivals_of(&study()).await.unwrap();
    let ignored = arrivals.iter().find(|each| each.uids == series(2)).unwrap();
    assert_eq!(ignored.reason, Some(other));
    // One that has an image is a series like others: it came with the image, and has the accession number of it.
    receive(store, &[image(1, 1)]).await;
    for number in 3..104 {
        refuse(number).await;
    }
    let mut arrivals = store.arrivals_of(&study()).await.unwrap();
    assert_eq!(arrivals.len(), 102);
    arrivals.retain(|each| each.uids != series(2));
    let arrival = arrivals.remove(0);
    assert_eq!(arrival.uids, series(1));
    assert_eq!((arrival.refused_objects, arrival.reason), (2, None));
    assert_eq!(arrival.source, ArrivalSource::Stow);
    assert_eq!(arrival.first_at, arrival.last_at);
    assert_eq!(arrival.accession_number, AccessionNumber::parse("A1"));
    assert_eq!(arrivals[0].uids, series(4), "the oldest is gone");
}

pub(crate) async fn an_image_that_comes_under_another_series_leaves_its_own(subject: &Subject) {
    let store = &subject.store;
    receive(store, &[image(1, 1), image(1, 2)]).await;
    subject.pass(21);
    let case = a_case_of(store, "a", &[image(1, 1), image(1, 2)]).await;
    let (leased, _) = due(store).await.unwrap();
    assert!(store.settle(&leased, &Outcome::Case(case)).await.unwrap());
    let moved = |number| NewInstance {
        uids: series(2),
        ..corrected(image(1, number), &format!("moved {number}"))
    };
    assert_eq!(received(store, &[moved(1)]).await, [Reception::Corrected]);
    assert_eq!(closed(store, case).await, Some(Closed::Corrected));
    let counts = async || {
        let arrivals = store.arrivals_of(&study()).await.unwrap();
        let counts = arrivals.iter().map(|each| (each.state, each.instances));
        counts.collect::<Vec<_>>()
    };
    let receiving = ArrivalState::Receiving;
    assert_eq!(counts().await, [(receiving, 1), (receiving, 1)]);
    assert_eq!(received(store, &[moved(2)]).await, [Reception::Corrected]);
    assert_eq!(counts().await, [(ArrivalState::Nothing, 0), (receiving, 2)]);
    let left = store.arrivals_of(&study()).await.unwrap().remove(0);
    assert_eq!(left.reason.unwrap().name, MOVED);
}

pub(crate) async fn what_is_made_of_rejected_images_is_closed_until_that_is_lifted(
    subject: &Subject,
) {
    let store = &subject.store;
    let images = [image(1, 1), image(1, 2)];
    receive(store, &images).await;
    subject.pass(21);
    let case = a_case_of(store, "a", &images).await;
    let (leased, _) = due(store).await.unwrap();
    assert!(store.settle(&leased, &Outcome::Case(case)).await.unwrap());
    receive(store, &[image(3, 1)]).await;
    subject.pass(21);
    let (layer, _) = due(store).await.unwrap();
    assert!(store.settle(&layer, &Outcome::Layer(case)).await.unwrap());
    let instance = |number, instance| image(number, instance).sop_instance_uid;
    let reject = async |may_return, number, instances: &[Uid]| {
        let rejection = Rejection {
            may_return,
            series: vec![(series(number), instances.to_vec())],
        };
        let rejected = store.reject(&rejection, ArrivalSource::Stow, "a peer");
        rejected.await.unwrap();
        let one = SeriesQuery::Study(uid("1.2.3"), Some(series(number).series));
        store.arrivals_of(&one).await.unwrap().remove(0)
    };
    // What is left is read again; the file of the other one stays.
    let left = reject(true, 1, &[instance(1, 1)]).await;
    assert_eq!((left.state, left.instances), (ArrivalState::Receiving, 2));
    assert_eq!(closed(store, case).await, Some(Closed::Rejected));
    // Another head of the study may have its layers, which are read again.
    let of_layer = SeriesQuery::Study(uid("1.2.3"), Some(series(3).series));
    let layer = store.arrivals_of(&of_layer).await.unwrap().remove(0);
    assert_eq!((layer.state, layer.reason), (ArrivalState::Receiving, None));
    subject.pass(21);
    let mut read = Vec::new();
    while let Some((leased, due)) = due(store).await {
        read.extend(due.images.into_iter().map(|image| image.uid));
        let nothing = Outcome::Nothing(failure());
        assert!(store.settle(&leased, &nothing).await.unwrap());
    }
    read.sort();
    assert_eq!(read, [instance(1, 2), instance(3, 1)]);
    // What was kept long enough counts when it comes again.
    assert_eq!(received(store, &[image(1, 1)]).await, [Reception::Known]);
    assert_eq!(closed(store, case).await, None);
    // A note may come before the images, and names them in its own study and series alone.
    let early = reject(false, 2, &[instance(2, 1), instance(3, 1)]).await;
    assert_eq!(
        (early.state, early.reason.unwrap().name.as_str()),
        (ArrivalState::Nothing, REJECTED)
    );
    let of_others = a_case_of(store, "b", &[image(3, 1)]).await;
    assert_eq!(closed(store, of_others).await, None);
    let of_early = a_case_of(store, "c", &[image(2, 1)]).await;
    assert_eq!(closed(store, of_early).await, Some(Closed::Rejected));
    received(store, &[image(2, 1)]).await;
    assert_eq!(closed(store, of_early).await, Some(Closed::Rejected));
    let listed = store.rejections(9).await.unwrap();
    let [rejected] = &listed[..] else {
        panic!("{listed:?}");
    };
    assert_eq!(
        (
            rejected.study.as_str(),
            rejected.series.as_str(),
            rejected.images,
            rejected.may_return,
            rejected.by.as_str()
        ),
        (
            series(2).study.as_str(),
            series(2).series.as_str(),
            2,
            false,
            "a peer"
        )
    );
    // It is remembered for as long as something is made of it.
    subject.pass(400 * DAY);
    store
        .forget(TERMS.stable, Removal::Confirmed)
        .await
        .unwrap();
    assert_eq!(closed(store, of_early).await, Some(Closed::Rejected));
    let id = store.rejections(9).await.unwrap().remove(0).id;
    assert!(store.lift(&id).await.unwrap());
    assert_eq!(closed(store, of_early).await, None);
    assert!(!store.lift(&id).await.unwrap());
    assert_eq!(store.rejections(9).await.unwrap(), []);
}

pub(crate) async fn what_a_pacs_has_sent_is_known_for_a_year_and_while_something_is_made_of_it(
    subject: &Subject,
) {
    let store = &subject.store;
    let images = [image(1, 1), image(2, 1)];
    receive(store, &images).await;
    let case = a_case_of(store, "a", &images[..1]).await;
    subject.pass(21);
    while let Some((leased, _)) = due(store).await {
        let nothing = Outcome::Nothing(failure());
        assert!(store.settle(&leased, &nothing).await.unwrap());
    }
    let knows = async |image: &NewInstance| store.has_come(&image.sop_instance_uid).await.unwrap();
    subject.pass(30 * DAY);
    store
        .forget(TERMS.stable, Removal::Confirmed)
        .await
        .unwrap();
    assert_eq!(store.arrivals_of(&study()).await.unwrap(), []);
    assert!(knows(&images[0]).await && knows(&images[1]).await);
    subject.pass(400 * DAY);
    store
        .forget(TERMS.stable, Removal::Confirmed)
        .await
        .unwrap();
    assert!(knows(&images[0]).await && !knows(&images[1]).await);
    // A correction counts although the images before it are forgotten.
    received(store, &[corrected(image(1, 1), "corrected")]).await;
    assert_eq!(closed(store, case).await, Some(Closed::Corrected));
    assert!(delete_rows(store.store(), &case).await.unwrap());
    assert!(knows(&images[0]).await);
}

pub(crate) async fn nothing_is_forgotten_by_a_wrong_clock_or_in_the_first_hour(subject: &Subject) {
    let store = &subject.store;
    let keep = Duration::from_secs(3 * DAY);
    let forget = async |keep, removal| store.forget(keep, removal).await.unwrap();
    let left = async || {
        let series = store.arrivals_of(&study()).await.unwrap();
        let images: usize = series.iter().map(|series| series.instances).sum();
        (images, store.rejections(9).await.unwrap().len())
    };
    assert_eq!(forget(keep, Removal::Automatic).await, None);
    // An image of a series that became nothing, and one that was rejected before it came.
    let rejection = Rejection {
        may_return: false,
        series: vec![(series(2), vec![image(2, 1).sop_instance_uid])],
    };
    let rejected = store.reject(&rejection, ArrivalSource::Stow, "a peer");
    rejected.await.unwrap();
    receive(store, &[image(1, 1)]).await;
    subject.pass(21);
    let (leased, _) = due(store).await.unwrap();
    let nothing = Outcome::Nothing(failure());
    assert!(store.settle(&leased, &nothing).await.unwrap());
    let first_hour = Some(Waiting::FirstHour);
    assert_eq!(forget(TERMS.stable, Removal::Automatic).await, first_hour);
    assert_eq!(forget(keep, Removal::Automatic).await, None);
    subject.pass(400 * DAY);
    for removal in [Removal::Automatic, Removal::Asked, Removal::Automatic] {
        assert_eq!(forget(keep, removal).await, Some(Waiting::Clock));
        subject.pass(3600);
    }
    assert_eq!(left().await, (1, 1));
    assert_eq!(store.too_old(keep).await.unwrap(), [2, 1]);
    assert_eq!(forget(keep, Removal::Confirmed).await, None);
    assert_eq!(left().await, (0, 0));
    // From then on it goes by itself.
    receive(store, &[image(1, 1)]).await;
    subject.pass(21);
    let (leased, _) = due(store).await.unwrap();
    assert!(store.settle(&leased, &nothing).await.unwrap());
    for _ in 0..2 {
        assert_eq!(forget(keep, Removal::Automatic).await, None);
        subject.pass(2 * DAY);
    }
    assert_eq!(forget(keep, Removal::Automatic).await, None);
    assert_eq!(store.arrivals_of(&study()).await.unwrap(), []);
}

pub(crate) async fn a_series_is_due_when_nothing_came_for_a_while(subject: &Subject) {
    let store = &subject.store;
    receive(store, &[image(1, 2)]).await;
    subject.pass(15);
    receive(store, &[image(1, 1)]).await;
    subject.pass(15);
    assert!(due(store).await.is_none());
    subject.pass(6);
    let (leased, read) = due(store).await.expect("it is due");
    assert_eq!(read.uids, series(1));
    let objects: Vec<_> = read.images.iter().map(|image| image.object).collect();
    assert_eq!(
        objects,
        [
            ObjectName::from(&image(1, 1)),
            ObjectName::from(&image(1, 2))
        ]
    );
    assert!(due(store).await.is_none(), "it is leased");
    let later = Release {
        after: Duration::from_secs(5),
        counts: true,
        failure: None,
    };
    assert!(store.store().release(&leased, &later).await.unwrap());
    assert!(due(store).await.is_none());
    subject.pass(6);
    let (first, _) = due(store).await.expect("it is due again");
    subject.pass(61);
    let (second, _) = due(store).await.expect("the lease has ended");
    let nothing = Outcome::Nothing(failure());
    assert!(!store.settle(&first, &nothing).await.unwrap());
    assert!(store.settle(&second, &nothing).await.unwrap());
    assert!(due(store).await.is_none());
    let arrival = &store.arrivals_of(&study()).await.unwrap()[0];
    assert_eq!(arrival.state, ArrivalState::Nothing);
    assert_eq!(arrival.reason, Some(failure()));
}

pub(crate) async fn a_series_with_all_announced_images_waits_no_longer(subject: &Subject) {
    let store = &subject.store;
    receive(store, &[image(1, 1), image(2, 1)]).await;
    store.expect(&series(1), 2).await.unwrap();
    store.expect(&series(2), 2).await.unwrap();
    assert!(due(store).await.is_none());
    receive(store, &[image(1, 2)]).await;
    let (_, read) = due(store).await.expect("all are there");
    assert_eq!(read.uids, series(1));
    // An announced image that does not come is waited for longer, and not for ever.
    subject.pass(25);
    assert!(due(store).await.is_none());
    subject.pass(180);
    let uids = due(store).await.map(|(_, read)| read.uids);
    assert!(uids == Some(series(2)) || uids == Some(series(1)));
}

pub(crate) async fn a_corrected_or_grown_series_waits_as_if_no_number_were_known(
    subject: &Subject,
) {
    let store = &subject.store;
    let case = a_case(store, "a").await;
    receive(store, &[image(1, 1), image(1, 2)]).await;
    store.expect(&series(1), 2).await.unwrap();
    let (read, of) = due(store).await.expect("all are there");
    assert_eq!(of.uids, series(1));
    assert!(store.settle(&read, &Outcome::Case(case)).await.unwrap());
    received(store, &[corrected(image(1, 1), "corrected")]).await;
    assert!(due(store).await.is_none());
    subject.pass(21);
    let (read, of) = due(store).await.expect("nothing came for a while");
    assert_eq!(of.uids, series(1));
    store.expect(&series(1), 2).await.unwrap();
    assert!(store.settle(&read, &Outcome::Case(case)).await.unwrap());
    receive(store, &[image(1, 3)]).await;
    assert!(due(store).await.is_none());
    subject.pass(21);
    let (read, _) = due(store).await.expect("nothing came for a while");
    assert!(store.settle(&read, &Outcome::Case(case)).await.unwrap());
}

pub(crate) async fn a_late_image_fences_the_reader_off_and_makes_the_series_due_again(
    subject: &Subject,
) {
    let store = &subject.store;
    let case = a_case(store, "a").await;
    receive(store, &[image(1, 1)]).await;
    subject.pass(21);
    let (leased, _) = due(store).await.unwrap();
    receive(store, &[image(1, 2)]).await;
    assert!(!store.settle(&leased, &Outcome::Case(case)).await.unwrap());
    subject.pass(21);
    let (leased, read) = due(store).await.unwrap();
    assert_eq!(read.images.len(), 2);
    assert!(store.settle(&leased, &Outcome::Case(case)).await.unwrap());
    receive(store, &[image(1, 3)]).await;
    subject.pass(21);
    let (leased, _) = due(store).await.expect("a late image came");
    let nothing = Outcome::Nothing(failure());
    assert!(store.settle(&leased, &nothing).await.unwrap());
    let arrival = &store.arrivals_of(&study()).await.unwrap()[0];
    assert_eq!(
        (arrival.state, arrival.case),
        (ArrivalState::Nothing, Some(case))
    );
    // A case that is gone is no outcome.
    receive(store, &[image(2, 1)]).await;
    subject.pass(21);
    let (leased, _) = due(store).await.unwrap();
    assert!(delete_rows(store.store(), &case).await.unwrap());
    assert!(!store.settle(&leased, &Outcome::Case(case)).await.unwrap());
}

pub(crate) async fn a_series_that_is_not_t1_waits_for_a_case_of_its_study(subject: &Subject) {
    let store = &subject.store;
    let case = a_case(store, "a").await;
    receive(store, &[image(1, 1)]).await;
    subject.pass(21);
    let (leased, _) = due(store).await.unwrap();
    let not_t1 = Outcome::Nothing(Failure::unusable(NOT_T1, "words"));
    assert!(store.settle(&leased, &not_t1).await.unwrap());
    assert!(due(store).await.is_none());
    // One that was taken as a layer waits for it, too.
    receive(store, &[image(3, 1)]).await;
    subject.pass(21);
    let (leased, _) = due(store).await.unwrap();
    let no_case = Outcome::Nothing(Failure::unusable(NO_CASE, "words"));
    assert!(store.settle(&leased, &no_case).await.unwrap());
    assert!(due(store).await.is_none());
    receive(store, &[image(2, 1)]).await;
    subject.pass(21);
    let (leased, _) = due(store).await.unwrap();
    assert!(store.settle(&leased, &Outcome::Case(case)).await.unwrap());
    let (again, read) = due(store).await.expect("there is a case now");
    assert_eq!(read.uids, series(1));
    assert!(store.settle(&again, &Outcome::Layer(case)).await.unwrap());
    let (again, read) = due(store).await.expect("there is a case now");
    assert_eq!(read.uids, series(3));
    assert!(store.settle(&again, &Outcome::Layer(case)).await.unwrap());
    assert!(due(store).await.is_none(), "a layer wakes nothing");
    let arrivals = store.arrivals_of(&study()).await.unwrap();
    let layer = arrivals.iter().find(|arrival| arrival.uids == series(1));
    let layer = layer.unwrap();
    assert_eq!(layer.case, Some(case));
    assert_eq!(layer.reason.as_ref().unwrap().name, BECAME_LAYER);
}

pub(crate) async fn an_image_is_kept_until_its_series_is_forgotten_or_its_case_deleted(
    subject: &Subject,
) {
    let store = &subject.store;
    let case = a_case(store, "a").await;
    receive(store, &[image(1, 1), image(2, 1), image(3, 1)]).await;
    let objects = [1, 2, 3].map(|number| ObjectName::from(&image(number, 1)));
    assert_eq!(unneeded(store.store(), &objects).await.unwrap(), []);
    subject.pass(21);
    for outcome in [Outcome::Case(case), Outcome::Nothing(failure())] {
        let (leased, _) = due(store).await.unwrap();
        assert!(store.settle(&leased, &outcome).await.unwrap());
    }
    let settled: Vec<_> = store.arrivals_of(&study()).await.unwrap();
    let becomes = |state| {
        let of_state = settled.iter().find(|arrival| arrival.state == state);
        of_state.unwrap().uids.series.as_str().to_owned()
    };
    let (of_case, of_nothing) = (becomes(ArrivalState::Case), becomes(ArrivalState::Nothing));
    let uids = |text: &str| SeriesUids {
        study: uid("1.2.3"),
        series: uid(text),
    };
    let images = store.images_of(&uids(&of_case)).await.unwrap();
    assert_eq!(images.len(), 1);
    assert!(objects.contains(&images[0].1));
    let forget = async |seconds| {
        let age = Duration::from_secs(seconds);
        store.forget(age, Removal::Confirmed).await.unwrap();
        store.arrivals_of(&study()).await.unwrap()
    };
    assert!(delete_rows(store.store(), &case).await.unwrap());
    assert_eq!(store.images_of(&uids(&of_case)).await.unwrap(), []);
    subject.pass(3600);
    assert_eq!(forget(7200).await.len(), 2);
    let left = forget(60).await;
    assert_eq!(left.len(), 1, "the one that still comes is kept");
    assert!(
        left.iter()
            .all(|arrival| arrival.uids.series.as_str() != of_nothing)
    );
    let left = store.arrivals_of(&study()).await.unwrap();
    assert!(
        left.iter()
            .all(|arrival| arrival.uids.series.as_str() != of_case)
    );
    assert_eq!(left.len(), 1);
    let lease = Duration::from_secs(60);
    // That of the forgotten series is gone already.
    assert_eq!(
        steps::mark(store.store(), &objects, "sweep", lease)
            .await
            .unwrap()
            .len(),
        2
    );
    assert!(objects.iter().all(|name| name.kind == ObjectKind::Instance));
}

pub(crate) async fn images_that_have_changed_do_not_go_with_the_case_that_was_made_before(
    subject: &Subject,
) {
    let store = &subject.store;
    let of = async |number| {
        let one = SeriesQuery::Study(uid("1.2.3"), Some(series(number).series));
        store.arrivals_of(&one).await.unwrap().remove(0)
    };
    let case = a_case(store, "a").await;
    for number in 1..=5 {
        receive(store, &[image(number, 1), image(number, 2)]).await;
        subject.pass(21);
        let (leased, _) = due(store).await.unwrap();
        let outcome = match number {
            1 => Outcome::Case(case),
            _ => Outcome::Layer(case),
        };
        assert!(store.settle(&leased, &outcome).await.unwrap());
        assert_eq!(of(number).await.case, Some(case));
    }
    let changed = |number| corrected(image(number, 1), &format!("corrected {number}"));
    received(store, &[changed(1)]).await;
    received(store, &[changed(2)]).await;
    let moved = NewInstance {
        uids: series(9),
        ..changed(3)
    };
    received(store, &[moved]).await;
    let rejection = Rejection {
        may_return: false,
        series: vec![(series(4), vec![image(4, 1).sop_instance_uid])],
    };
    let rejected = store.reject(&rejection, ArrivalSource::Stow, "a peer");
    assert_eq!(rejected.await.unwrap(), 1);
    for number in 1..=4 {
        assert_eq!(of(number).await.case, None, "{number}");
    }
    assert!(delete_rows(store.store(), &case).await.unwrap());
    for (number, instances) in [(1, 2), (2, 2), (3, 1), (4, 2), (9, 1)] {
        assert_eq!(of(number).await.instances, instances, "{number}");
    }
    // What has not changed goes with its case.
    let left = SeriesQuery::Study(uid("1.2.3"), Some(series(5).series));
    assert_eq!(store.arrivals_of(&left).await.unwrap(), []);
}

pub(crate) async fn series_are_listed_newest_first_in_pages(subject: &Subject) {
    let store = &subject.store;
    for number in 1..=5 {
        receive(store, &[image(number, 1)]).await;
        subject.pass(1);
    }
    let mut seen = Vec::new();
    let mut after: Option<Cursor> = None;
    loop {
        let (page, next) = store
            .arrivals(&ArrivalQuery::default(), after.as_ref(), 2)
            .await
            .unwrap();
        assert!(page.len() <= 2);
        seen.extend(page.into_iter().map(|arrival| arrival.uids));
        let Some(next) = next else { break };
        after = Cursor::parse(&next.to_string());
        assert!(after.is_some());
        assert_eq!(store.arrival(&next.id).await.unwrap().unwrap().id, next.id);
    }
    assert_eq!(seen, [5, 4, 3, 2, 1].map(series));
}

pub(crate) async fn series_are_listed_by_state_case_label_and_time(subject: &Subject) {
    let store = &subject.store;
    for number in 1..=4 {
        receive(store, &[image(number, 1)]).await;
        subject.pass(60);
    }
    let case = a_case(store, "a").await;
    for outcome in [
        Outcome::Case(case),
        Outcome::Layer(case),
        Outcome::Nothing(failure()),
    ] {
        let (leased, _) = due(store).await.unwrap();
        assert!(store.settle(&leased, &outcome).await.unwrap());
    }
    let listed = async |query: ArrivalQuery| {
        let (found, _) = store.arrivals(&query, None, 10).await.unwrap();
        let uids = found.into_iter().map(|arrival| arrival.uids);
        uids.collect::<Vec<_>>()
    };
    let with = |state| ArrivalQuery {
        state: Some(state),
        ..ArrivalQuery::default()
    };
    for (status, number) in [
        (ArrivalState::Case, 1),
        (ArrivalState::Layer, 2),
        (ArrivalState::Nothing, 3),
        (ArrivalState::Receiving, 4),
    ] {
        assert_eq!(listed(with(status)).await, [series(number)], "{status:?}");
    }
    let of_case = ArrivalQuery {
        case: Some(case),
        ..ArrivalQuery::default()
    };
    assert_eq!(listed(of_case).await, [2, 1].map(series));
    let labelled = |text: &str| ArrivalQuery {
        text: Some(text.to_owned()),
        ..ArrivalQuery::default()
    };
    assert_eq!(listed(labelled("t1 3%")).await, [series(3)]);
    assert_eq!(listed(labelled("t1_")).await, [], "no wildcards");
    assert_eq!(listed(labelled("2026-01-02")).await.len(), 4);
    let second = store.arrivals_of(&study()).await.unwrap().remove(1);
    let times = ArrivalQuery {
        since: Some(second.first_at),
        until: Some(second.first_at + Duration::from_secs(60)),
        ..ArrivalQuery::default()
    };
    assert_eq!(listed(times).await, [series(2)]);
}

pub(crate) async fn a_series_that_was_refused_is_taken_and_the_reason_stays(subject: &Subject) {
    let store = &subject.store;
    receive(store, &[image(1, 1)]).await;
    subject.pass(21);
    let (leased, read) = due(store).await.unwrap();
    assert_eq!(read.taken, None);
    let refused = Outcome::Nothing(failure());
    assert!(store.settle(&leased, &refused).await.unwrap());
    let taken = Taken {
        kind: TakenAs::Case,
        allow_gaps: true,
    };
    store.take(&leased.key, &taken).await.unwrap();
    let seen = async || store.arrival(&leased.key).await.unwrap().unwrap();
    let arrival = seen().await;
    assert_eq!(
        (arrival.state, &arrival.reason, &arrival.refused),
        (ArrivalState::Receiving, &None, &Some(failure()))
    );
    let (again, read) = due(store).await.unwrap();
    assert_eq!(read.taken, Some(taken));
    let case = a_case(store, "a").await;
    assert!(store.settle(&again, &Outcome::Case(case)).await.unwrap());
    let arrival = seen().await;
    assert_eq!(
        (arrival.state, arrival.refused, arrival.taken),
        (ArrivalState::Case, Some(failure()), Some(taken))
    );
    assert!(!read.is_corrected);
    // A correction is another question than the one that was answered, until that is taken, too.
    receive(store, &[corrected(image(1, 1), "after")]).await;
    subject.pass(21);
    let (leased, read) = due(store).await.unwrap();
    assert!(read.is_corrected && read.taken == Some(taken));
    assert!(store.settle(&leased, &refused).await.unwrap());
    store.take(&leased.key, &taken).await.unwrap();
    let (leased, read) = due(store).await.unwrap();
    assert!(!read.is_corrected);
    assert!(store.settle(&leased, &Outcome::Case(case)).await.unwrap());
    // Whoever reads it at the moment when it is taken does not decide.
    receive(store, &[image(1, 2)]).await;
    subject.pass(21);
    let (leased, _) = due(store).await.unwrap();
    store.take(&leased.key, &taken).await.unwrap();
    assert!(!store.settle(&leased, &refused).await.unwrap());
}
