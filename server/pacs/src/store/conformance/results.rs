//! Results that are sent to a node.

use std::time::Duration;

use case::images::{Fingerprint, Image};
use case::series::{SeriesUids, Uid};
use case::{CaseId, Closed, JobState, LayerId, LayerParameters, ObjectKind};
use storage::tables::{Referred, made};
use storage::testing::failure;
use storage::testing::steps::{
    delete_rows, insert_case, mark, objects_of_tables, pinned, unneeded, unpin,
};
use storage::upkeep::Removal;
use storage::{Claim, Cursor, LayerName, LayerUpload, Made, ObjectName, StoreError};

use super::Subject;
use crate::store::PacsStore;
use crate::values::{ArrivalSource, NewInstance, TransferQuery};
use crate::values::{NewResult, ResultSeries, SEND, SentResult};

const LEASE: Duration = Duration::from_secs(30);

fn uid(text: &str) -> Uid {
    Uid::parse(text).unwrap()
}

async fn a_case(store: &PacsStore) -> CaseId {
    insert_case(store.store(), "a", Some(Vec::new()), None).await
}

/// A result of a case of the study 1.2.3, to be sent to a node. Its contents are told apart by their digest alone.
pub(crate) fn new_result(case: CaseId, node: &str, contents: &str) -> NewResult {
    NewResult {
        case,
        node: node.to_owned(),
        study: uid("1.2.3"),
        series: ResultSeries {
            sop_class_uid: uid("1.2.840.10008.5.1.4.1.1.7"),
            series_uid: uid("2.25.8"),
        },
        instance: uid("2.25.7"),
        layers: Vec::new(),
        digest: blake3::hash(contents.as_bytes()),
    }
}

/// A layer that is made of this image.
async fn a_layer_of(store: &PacsStore, case: CaseId, image: Image) -> LayerId {
    let upload = LayerUpload {
        case,
        volume: store.store().spools().of("a layer".into()).await.unwrap(),
        dicom: None,
        images: vec![image],
        series: None,
        name: LayerName::Usual("a layer".to_owned()),
        parameters: LayerParameters::default(),
    };
    store.store().submit_layer(upload).await.unwrap().layer.id
}

pub(crate) async fn queue(store: &PacsStore, new: &NewResult) -> SentResult {
    let pinned = pinned(store.store(), &[new.object()]).await;
    match store.insert_result(new, &pinned).await.unwrap() {
        Referred::Done(queued) => queued,
        other => panic!("{other:?}"),
    }
}

async fn claim(store: &PacsStore) -> Option<Claim> {
    store.store().claim(SEND, 3).await.unwrap()
}

async fn state(store: &PacsStore, result: &SentResult) -> JobState {
    let found = store.result(&result.id).await.unwrap();
    found.unwrap().job.unwrap().state
}

pub(crate) async fn a_result_is_queued_once_for_a_node_and_sent_until_it_is_there(
    subject: &Subject,
) {
    let store = &subject.store;
    let case = a_case(store).await;
    assert_eq!(claim(store).await, None);
    let first = queue(store, &new_result(case, "pacs", "one")).await;
    assert_eq!(state(store, &first).await, JobState::Queued);
    assert_eq!(store.result(&first.id).await.unwrap(), Some(first.clone()));
    // The same result, although its file was made again: the first file counts.
    let again = queue(store, &new_result(case, "pacs", "two")).await;
    assert_eq!(again, first);
    let known = store.object_of_result(&uid("2.25.7")).await.unwrap();
    assert_eq!(known, Some(first.what.object()));
    assert_eq!(store.object_of_result(&uid("2.25.8")).await.unwrap(), None);
    let listed = async |kind| {
        objects_of_tables(store.store(), kind, None, 9)
            .await
            .unwrap()
    };
    assert_eq!(listed(ObjectKind::Result).await, [first.what.object()]);
    assert_eq!(listed(ObjectKind::Volume).await, []);
    let gone = pinned(store.store(), &[first.what.object()]).await;
    unpin(store.store(), &gone).await.unwrap();
    let two = new_result(case, "pacs", "two").object();
    assert_eq!(
        mark(store.store(), &[first.what.object(), two], "sweep", LEASE)
            .await
            .unwrap(),
        [two]
    );

    let leased = claim(store).await.unwrap();
    assert_eq!((&leased.key, leased.attempt), (&first.id, 1));
    assert_eq!(state(store, &first).await, JobState::Running);
    assert!(
        store
            .store()
            .finish(&leased, Err(&failure()))
            .await
            .unwrap()
    );
    let seen = store.result(&first.id).await.unwrap().unwrap();
    let job = seen.job.unwrap();
    assert_eq!(
        (job.state, job.failure),
        (JobState::Failed, Some(failure()))
    );
    // Whoever requests it again wants it sent again.
    let again = queue(store, &new_result(case, "pacs", "one")).await;
    let job = again.job.unwrap();
    assert_eq!(
        (again.id, job.state, job.attempts, job.failure),
        (first.id, JobState::Queued, 0, None)
    );
}

pub(crate) async fn a_result_is_kept_until_it_is_forgotten_or_its_case_deleted(subject: &Subject) {
    let store = &subject.store;
    let case = a_case(store).await;
    let [one, other] = ["pacs", "other"].map(|node| new_result(case, node, "one"));
    let sent = queue(store, &one).await;
    let leased = claim(store).await.unwrap();
    assert!(store.store().finish(&leased, Ok(())).await.unwrap());
    queue(store, &other).await;
    // It is there once, though it goes to two nodes.
    let of_study = store.results_of(&uid("1.2.3")).await.unwrap();
    assert_eq!(of_study, [(one.instance.clone(), one.series.clone())]);
    assert_eq!(store.results_of(&uid("1.2.4")).await.unwrap(), []);
    let objects = [one.object()];
    assert_eq!(objects[0].kind, ObjectKind::Result);
    subject.pass(3600);
    store
        .forget(Duration::from_secs(7200), Removal::Confirmed)
        .await
        .unwrap();
    assert!(store.result(&sent.id).await.unwrap().is_some());
    store
        .forget(Duration::from_secs(60), Removal::Confirmed)
        .await
        .unwrap();
    assert_eq!(store.result(&sent.id).await.unwrap(), None);
    // The other node still waits for the same object.
    assert_eq!(unneeded(store.store(), &objects).await.unwrap(), []);
    delete_rows(store.store(), &case).await.unwrap();
    assert_eq!(claim(store).await, None);
    subject.pass(1);
    assert_eq!(
        mark(store.store(), &objects, "sweep", LEASE).await.unwrap(),
        objects
    );
    // A case that is gone gets no results.
    let pinned = pinned(store.store(), &[new_result(case, "pacs", "three").object()]).await;
    let late = new_result(case, "pacs", "three");
    assert!(store.insert_result(&late, &pinned).await.is_err());
}

pub(crate) async fn results_are_listed_by_case_and_state_in_pages(subject: &Subject) {
    let store = &subject.store;
    let case = a_case(store).await;
    let mut ids = Vec::new();
    for node in ["first", "second", "third"] {
        subject.pass(1);
        ids.push(queue(store, &new_result(case, node, "one")).await.id);
    }
    ids.reverse();
    let list = async |query: &TransferQuery, after: Option<&Cursor>, limit| {
        let (page, next) = store.results(query, after, limit).await.unwrap();
        let ids: Vec<_> = page.into_iter().map(|result| result.id).collect();
        (ids, next)
    };
    let every = TransferQuery::default();
    assert_eq!(list(&every, None, 9).await, (ids.clone(), None));
    let (page, next) = list(&every, None, 2).await;
    assert_eq!(page, ids[..2]);
    assert_eq!(
        list(&every, next.as_ref(), 2).await,
        (ids[2..].to_vec(), None)
    );
    let leased = claim(store).await.unwrap();
    let of = |case, state| TransferQuery { case, state };
    let running = Some(JobState::Running);
    assert_eq!(
        list(&of(Some(case), running), None, 9).await.0,
        [leased.key]
    );
    assert_eq!(
        list(&of(None, Some(JobState::Queued)), None, 9)
            .await
            .0
            .len(),
        2
    );
    let other = CaseId::parse(&"0".repeat(case.to_string().len()));
    assert!(other.is_some() && list(&of(other, None), None, 9).await.0.is_empty());
}

pub(crate) async fn a_result_does_not_count_while_what_it_shows_is_closed(subject: &Subject) {
    let store = &subject.store;
    let case = a_case(store).await;
    let layer = a_layer_of(store, case, image("one")).await;
    let of = |node, layers| NewResult {
        layers,
        ..new_result(case, node, "one")
    };
    let plain = NewResult {
        instance: uid("2.25.9"),
        ..of("pacs", Vec::new())
    };
    let plain = queue(store, &plain).await;
    let sent = queue(store, &of("pacs", vec![layer])).await;
    for _ in 0..2 {
        let leased = claim(store).await.unwrap();
        assert!(store.store().finish(&leased, Ok(())).await.unwrap());
    }
    let waiting = queue(store, &of("other", vec![layer])).await;
    let note = NewResult {
        series: ResultSeries {
            sop_class_uid: uid(super::super::REJECTION_NOTE),
            series_uid: uid("2.25.8"),
        },
        instance: uid("2.25.10"),
        ..of("pacs", vec![layer])
    };
    let note = queue(store, &note).await;
    let is_valid = async |result: &SentResult| {
        let result = store.result(&result.id).await.unwrap().unwrap();
        result.not_valid.is_none()
    };
    assert!(is_valid(&sent).await);
    come(store, &image("one")).await;
    assert!(is_valid(&sent).await, "it is the same image");
    come(store, &image("another")).await;
    assert!(is_valid(&plain).await && !is_valid(&sent).await && !is_valid(&waiting).await);
    assert_eq!(
        store.store().layers(&case).await.unwrap()[0].closed,
        Some(Closed::Corrected)
    );
    // It has failed for good when it would be sent; a rejection note leaves all the same.
    let leased = claim(store).await.unwrap();
    assert_eq!(leased.key, note.id);
    assert!(store.store().finish(&leased, Ok(())).await.unwrap());
    assert!(claim(store).await.is_none());
    let failed = store
        .result(&waiting.id)
        .await
        .unwrap()
        .unwrap()
        .job
        .unwrap();
    assert_eq!(
        (failed.state, failed.failure.unwrap().name.as_str()),
        (JobState::Failed, "closed")
    );
    // It is known of which images the layer was made, also when that is gone.
    assert!(store.store().delete((&case, &layer)).await.unwrap());
    assert!(!is_valid(&sent).await);
    let made = Made::result(&case, &sent.id);
    let made_of = made::of(&mut store.store().connect().await.unwrap(), &made).await;
    assert_eq!(made_of.unwrap(), [image("one")]);
    // What shows a layer that is gone by now is not queued.
    let late = NewResult {
        instance: uid("1.2.99"),
        ..of("late", vec![layer])
    };
    let pinned = pinned(store.store(), &[late.object()]).await;
    let queued = store.insert_result(&late, &pinned).await;
    assert!(matches!(queued, Err(StoreError::NoSuchLayer)), "{queued:?}");
    come(store, &image("one")).await;
    assert!(is_valid(&sent).await && is_valid(&waiting).await);
}

/// An image with these contents.
fn image(contents: &str) -> Image {
    let digest = blake3::hash(contents.as_bytes()).to_hex();
    Image {
        uid: uid("1.2.3.4"),
        fingerprint: Fingerprint::new(&digest[..32], false, Vec::new()).unwrap(),
        times: 0,
    }
}

/// Lets a PACS send an image.
async fn come(store: &PacsStore, image: &Image) {
    let new = NewInstance {
        uids: SeriesUids {
            study: uid("1.2"),
            series: uid("1.2.3"),
        },
        accession_number: None,
        sop_instance_uid: image.uid.clone(),
        digest: blake3::hash(image.fingerprint.to_string().as_bytes()),
        label: None,
        fingerprint: Some(image.fingerprint.clone()),
    };
    let pinned = pinned(store.store(), &[ObjectName::from(&new)]).await;
    let images = [new];
    let received = store.insert_images(&images, &pinned, ArrivalSource::CStore);
    received.await.unwrap();
}
