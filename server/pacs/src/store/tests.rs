//! Work that never comes to an end; inspections, and copies from one store into another.

use std::path::PathBuf;
use std::time::Duration;

use crate::identity::Rejection;
use case::images::{Fingerprint, Image};
use case::series::{AccessionNumber, SeriesQuery, SeriesUids, Uid};
use case::{CaseId, Closed, JobKind, JobState, LayerParameters, Parameters};
use storage::tables::{Referred, layers, made};
use storage::testing::files_below;
use storage::testing::steps::{insert_case, pinned};
use storage::upkeep::{self, Copied, Defect};
use storage::{LayerName, LayerUpload, Made, ObjectName, Options, Store, StoreError, Upload};
use tempfile::TempDir;

use super::conformance::{Subject, new_result, open, queue};
use super::{CopiedStep, CopyCounts, PacsStore};
use crate::values::{
    ArrivalSource, ArrivalState, DueTerms, NewInstance, NewResult, Outcome, Reception, SEND,
    SERIES, TransferQuery,
};

const LEASE: Duration = Duration::from_secs(60);

const MAX_ATTEMPTS: u32 = 5;

/// Leases jobs of a kind, and lets their process die, until there is none; returns how often.
async fn die_each_time(subject: &Subject, kind: JobKind) -> u32 {
    let claim = async || {
        subject
            .store
            .store()
            .claim(kind, MAX_ATTEMPTS)
            .await
            .unwrap()
    };
    let mut attempts = 0;
    while claim().await.is_some() {
        attempts += 1;
        assert!(attempts <= MAX_ATTEMPTS);
        subject.pass(24 * 3600);
    }
    attempts
}

fn uid(text: &str) -> Uid {
    Uid::parse(text).unwrap()
}

fn series() -> SeriesUids {
    SeriesUids {
        study: uid("1.2.3"),
        series: uid("1.2.3.4"),
    }
}

#[tokio::test]
async fn a_series_whose_reader_dies_each_time_becomes_nothing() {
    let subject = Subject::in_memory().await;
    let store = &subject.store;
    let image = NewInstance {
        uids: series(),
        accession_number: None,
        digest: blake3::hash(b"an image"),
        sop_instance_uid: uid("1.2.3.4.5"),
        label: None,
        fingerprint: None,
    };
    let pins = pinned(store.store(), &[ObjectName::from(&image)]).await;
    let received = store
        .insert_images(&[image], &pins, ArrivalSource::CStore)
        .await;
    let Referred::Done(received) = received.unwrap() else {
        panic!("the pins are there");
    };
    assert_eq!(received, [Reception::New]);
    subject.pass(60);
    let terms = DueTerms {
        stable: LEASE,
        patience: LEASE,
    };
    assert_eq!(store.queue_due_series(&terms).await.unwrap(), 1);
    let attempts = die_each_time(&subject, SERIES).await;
    assert_eq!(store.queue_due_series(&terms).await.unwrap(), 0);
    let query = SeriesQuery::Study(uid("1.2.3"), None);
    let arrival = store.arrivals_of(&query).await.unwrap().pop().unwrap();
    assert_eq!(arrival.state, ArrivalState::Nothing);
    let words = arrival.reason.unwrap().detail;
    assert!(words.contains(&format!("{attempts} attempts")), "{words}");
}

#[tokio::test]
async fn a_result_whose_sender_dies_each_time_fails() {
    let subject = Subject::in_memory().await;
    let store = &subject.store;
    let case = insert_case(store.store(), "a", Some(Vec::new()), None).await;
    let queued = queue(store, &new_result(case, "pacs", "a result")).await;
    let attempts = die_each_time(&subject, SEND).await;
    let seen = store.result(&queued.id).await.unwrap().unwrap();
    let job = seen.job.unwrap();
    assert_eq!(job.state, JobState::Failed);
    let words = job.failure.unwrap().detail;
    assert!(words.contains(&format!("{attempts} attempts")), "{words}");
}

async fn store(directory: &TempDir) -> PacsStore {
    open(directory.path()).await
}

#[tokio::test]
async fn a_store_with_these_tables_is_not_opened_without_them() {
    let directory = tempfile::tempdir().unwrap();
    store(&directory).await.store().close().await;
    let error = Store::open(directory.path(), Options::default())
        .await
        .unwrap_err();
    assert!(matches!(error, StoreError::NewerSchema { .. }), "{error:?}");
    three_images(&store(&directory).await).await;
}

fn file_of(directory: &TempDir, name: &ObjectName) -> PathBuf {
    directory.path().join("objects").join(name.path().as_ref())
}

/// What an inspection finds.
async fn inspected(store: &Store) -> Vec<Defect> {
    let mut findings = Vec::new();
    let inspected = upkeep::inspect(store, &mut |finding| findings.push(finding)).await;
    inspected.unwrap();
    findings
}

/// Copies the cases.
async fn copied(from: &PacsStore, to: &PacsStore) -> Copied {
    from.copy_images_into(to).await.unwrap();
    upkeep::copy_into(from.store(), to.store(), &mut |_, _| {})
        .await
        .unwrap()
}

/// The fingerprint of an image of a series.
fn print(number: usize) -> Fingerprint {
    Fingerprint::new(&format!("{number:032}"), false, Vec::new()).unwrap()
}

/// Three images of a series.
async fn three_images(store: &PacsStore) -> [ObjectName; 3] {
    let mut images = Vec::new();
    for (number, content) in ["image 0", "image 1", "image 2"].into_iter().enumerate() {
        let file = store.store().spools().of(content.into()).await.unwrap();
        let new = NewInstance {
            uids: SeriesUids {
                study: uid("1.2"),
                series: uid("1.2.3"),
            },
            accession_number: AccessionNumber::parse("A7"),
            sop_instance_uid: uid(&format!("1.2.3.{number}")),
            digest: *file.digest(),
            label: None,
            fingerprint: Some(print(number)),
        };
        images.push((new, file));
    }
    let names = [0, 1, 2].map(|number| ObjectName::from(&images[number].0));
    let source = ArrivalSource::Stow;
    let received = store.receive(images, source).await.unwrap();
    assert_eq!(received, [Reception::New; 3]);
    names
}

#[tokio::test]
async fn an_inspection_reads_the_images_of_a_pacs() {
    let directory = tempfile::tempdir().unwrap();
    let store = store(&directory).await;
    let names = three_images(&store).await;
    let mut findings = Vec::new();
    let sound = upkeep::inspect(store.store(), &mut |finding| findings.push(finding)).await;
    let sound = sound.unwrap();
    assert_eq!((sound.cases, sound.objects, findings), (0, 3, vec![]));

    std::fs::write(file_of(&directory, &names[0]), b"damaged").unwrap();
    std::fs::remove_file(file_of(&directory, &names[1])).unwrap();
    let mut findings = inspected(store.store()).await;
    findings.sort_by_key(|finding| matches!(finding, Defect::Damaged(..)));
    let expected = [
        Defect::Missing(None, names[1]),
        Defect::Damaged(None, names[0]),
    ];
    assert_eq!(findings, expected);
}

/// Copies what came from a PACS, and returns the result with the objects that were not copied.
async fn copied_of_pacs(from: &PacsStore, to: &PacsStore) -> (Copied, CopyCounts, Vec<ObjectName>) {
    let (mut copied, mut lost) = (Copied::default(), Vec::new());
    let mut report = |step: CopiedStep, _: &CopyCounts| match step {
        CopiedStep::Lost(name) => lost.push(name),
        CopiedStep::Done => {}
    };
    let of_pacs = from.copy_series_into(to, &mut copied, &mut report).await;
    (copied, of_pacs.unwrap(), lost)
}

/// A case of three images that are kept, and a result of it that was sent.
async fn a_kept_series(store: &PacsStore) -> (CaseId, [ObjectName; 3], String) {
    let upload = Upload {
        volume: store.store().spools().of("volume".into()).await.unwrap(),
        mask: None,
        dicom: None,
        images: Vec::new(),
        series: None,
    };
    let submitted = store
        .store()
        .submit(upload, Parameters::default(), None, false)
        .await;
    let id = submitted.unwrap().case.id;
    let images = three_images(store).await;
    let terms = DueTerms {
        stable: Duration::ZERO,
        patience: Duration::ZERO,
    };
    assert_eq!(store.queue_due_series(&terms).await.unwrap(), 1);
    let due = store.store().claim(SERIES, 3).await.unwrap().unwrap();
    assert!(store.settle(&due, &Outcome::Case(id)).await.unwrap());
    let of = |number: usize| Image {
        uid: uid(&format!("1.2.3.{number}")),
        fingerprint: print(number),
        times: 0,
    };
    let of: Vec<_> = (0..3).map(of).collect();
    let (mut transaction, _) = store.store().write().await.unwrap();
    let made = Made::case(&id);
    made::make(&mut transaction, &made, &of).await.unwrap();
    transaction.commit().await.unwrap();
    let file = b"a result";
    let new = NewResult {
        study: uid("1.2"),
        ..new_result(id, "pacs", "a result")
    };
    let queued = store.queue_result(new, file[..].into()).await;
    let leased = store.store().claim(SEND, 3).await.unwrap().unwrap();
    assert!(store.store().finish(&leased, Ok(())).await.unwrap());
    (id, images, queued.unwrap().id)
}

#[tokio::test]
async fn a_copy_has_the_images_and_the_results_of_a_pacs() {
    let [here, there] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let (from, to) = (store(&here).await, store(&there).await);
    let (case, images, result) = a_kept_series(&from).await;
    copied(&from, &to).await;
    let (first, of_pacs, lost) = copied_of_pacs(&from, &to).await;
    let whole = CopyCounts {
        series: 1,
        images: 3,
        results: 1,
    };
    assert_eq!((of_pacs, first.objects, lost), (whole, 4, vec![]));
    assert_eq!(from.count().await.unwrap(), whole);
    assert_eq!(to.count().await.unwrap(), whole);

    let series = SeriesQuery::Study(uid("1.2"), None);
    let arrivals = to.arrivals_of(&series).await.unwrap();
    assert_eq!(arrivals, from.arrivals_of(&series).await.unwrap());
    assert_eq!(
        (arrivals[0].state, arrivals[0].case),
        (ArrivalState::Case, Some(case))
    );
    let number = SeriesQuery::AccessionNumber(AccessionNumber::parse("A7").unwrap());
    assert_eq!(to.arrivals_of(&number).await.unwrap(), arrivals);
    let sent = to.result(&result).await.unwrap().unwrap();
    assert_eq!(
        (
            sent.job.as_ref().unwrap().state,
            sent.what.case,
            sent.what.node.as_str()
        ),
        (JobState::Done, case, "pacs")
    );
    assert_eq!(
        &to.store().object(&sent.what.object()).await.unwrap()[..],
        b"a result"
    );
    assert_eq!(files_below(&there.path().join("uploads")).len(), 0);

    // Again, nothing is written and nothing is lost.
    let (again, of_pacs, _) = copied_of_pacs(&from, &to).await;
    assert_eq!((of_pacs, again.objects, again.kept), (whole, 0, 4));
    assert_eq!(inspected(to.store()).await, []);
    assert_eq!(to.result(&result).await.unwrap(), Some(sent));
    for name in images {
        to.store().object(&name).await.unwrap();
    }
}

#[tokio::test]
async fn a_copy_follows_what_was_corrected_and_rejected_since() {
    let [here, there] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let (from, to) = (store(&here).await, store(&there).await);
    let (case, ..) = a_kept_series(&from).await;
    let spooled = from.store().spools().of("a FLAIR".into()).await.unwrap();
    let upload = LayerUpload {
        case,
        volume: spooled,
        dicom: None,
        images: Vec::new(),
        series: Some(uid("1.2.7")),
        name: LayerName::Usual("FLAIR".to_owned()),
        parameters: LayerParameters::default(),
    };
    let layer = from.store().submit_layer(upload).await.unwrap().layer;
    copied(&from, &to).await;
    copied_of_pacs(&from, &to).await;
    // The series of a layer, by which it is found when the PACS rejects it, is copied too.
    let of_series = layers::of_series(&mut to.store().connect().await.unwrap(), &uid("1.2.7"))
        .await
        .unwrap();
    assert_eq!(of_series, [(case, layer.id)]);
    from.store().delete((&case, &layer.id)).await.unwrap();
    copied(&from, &to).await;
    assert_eq!(to.store().layers(&case).await.unwrap(), []);
    let study = SeriesQuery::Study(uid("1.2"), None);
    let arrival = from.arrivals_of(&study).await.unwrap().remove(0);
    let images = from.images_of(&arrival.uids).await.unwrap();
    let reject = async |may_return, instances: Vec<Uid>| {
        let rejection = Rejection {
            may_return,
            series: vec![(arrival.uids.clone(), instances)],
        };
        let rejected = from.reject(&rejection, ArrivalSource::Stow, "a peer");
        rejected.await.unwrap();
        copied(&from, &to).await;
        copied_of_pacs(&from, &to).await;
    };
    let first = images[0].0.clone();
    reject(false, vec![first.clone()]).await;
    let closed = async |store: &PacsStore| store.store().case(&case).await.unwrap().unwrap().closed;
    assert_eq!(closed(&from).await, Some(Closed::Rejected));
    assert_eq!(closed(&to).await, Some(Closed::Rejected));
    assert_eq!(to.images_of(&arrival.uids).await.unwrap(), images);
    assert_eq!(to.are_withdrawn(&[first]).await.unwrap(), [true]);
    assert_eq!(
        to.rejections(9).await.unwrap(),
        from.rejections(9).await.unwrap()
    );
    let left = from.arrivals_of(&study).await.unwrap();
    assert_eq!(to.arrivals_of(&study).await.unwrap(), left);
    // What was sent is known there also when nothing of it is kept.
    assert!(to.has_come(&images[0].0).await.unwrap());
    assert_eq!(inspected(to.store()).await, []);
}

#[tokio::test]
async fn what_was_withdrawn_is_copied_without_images_too() {
    let [here, there] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let (from, to) = (store(&here).await, store(&there).await);
    let withdrawn = [uid("1.2.3.4")];
    from.withdraw(&withdrawn).await.unwrap();
    copied(&from, &to).await;
    assert_eq!(to.are_withdrawn(&withdrawn).await.unwrap(), [true]);
}

#[tokio::test]
async fn what_is_damaged_is_named_and_the_rest_is_copied() {
    let [here, there] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let (from, to) = (store(&here).await, store(&there).await);
    let (_, images, _) = a_kept_series(&from).await;
    std::fs::write(file_of(&here, &images[1]), b"damaged").unwrap();
    // Without its case, the series is read again there, and a result has nothing to belong to.
    let (first, of_pacs, lost) = copied_of_pacs(&from, &to).await;
    assert_eq!((first.lost, of_pacs.images), (2, 2));
    assert_eq!(lost[0], images[1]);
    let series = SeriesQuery::Study(uid("1.2"), None);
    let arrival = to.arrivals_of(&series).await.unwrap().remove(0);
    assert_eq!(
        (arrival.state, arrival.case, arrival.instances),
        (ArrivalState::Receiving, None, 2)
    );
    let every = TransferQuery::default();
    assert_eq!(to.results(&every, None, 9).await.unwrap(), (vec![], None));
}
