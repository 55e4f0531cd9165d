//! Work that never comes to an end: it is tried so many times, and then fails in words.

use std::time::Duration;

use crate::arrivals::{
    ArrivalSource, ArrivalState, DueTerms, NewInstance, SeriesQuery, SeriesUids, TransferState, Uid,
};
use crate::conformance::Subject;
use crate::results::{NewResult, ResultSeries};
use crate::testing::{new_case, pinned};
use crate::{ObjectName, Store};

const LEASE: Duration = Duration::from_secs(60);

/// More than anything is tried.
const MANY: usize = 100;

/// Leases work, and lets its process die, until there is none; returns how often.
async fn die_each_time(subject: &Subject, lease: impl AsyncFn(&Store) -> bool) -> usize {
    for attempt in 0..MANY {
        if !lease(&subject.store).await {
            return attempt;
        }
        subject.pass(24 * 3600);
    }
    MANY
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
#[ignore = "step 4"]
async fn a_series_whose_reader_dies_each_time_becomes_nothing() {
    let subject = Subject::in_memory().await;
    let store = &subject.store;
    let image = NewInstance {
        uids: series(),
        accession_number: None,
        digest: blake3::hash(b"an image"),
        sop_instance_uid: uid("1.2.3.4.5"),
        label: None,
        replaces: None,
    };
    let pins = pinned(store, &[ObjectName::from(&image)]).await;
    let received = store
        .insert_images(&[image], &pins, ArrivalSource::CStore)
        .await;
    assert_eq!(received.unwrap().map(|received| received.new), Some(1));
    subject.pass(60);
    let terms = DueTerms {
        stable: LEASE,
        patience: LEASE,
        lease: LEASE,
    };
    let lease = async |store: &Store| store.lease_due(&terms).await.unwrap().is_some();
    let attempts = die_each_time(&subject, lease).await;
    let query = SeriesQuery::Study(uid("1.2.3"), None);
    let arrival = store.arrivals_of(&query).await.unwrap().pop().unwrap();
    assert_eq!(arrival.state, ArrivalState::Nothing);
    let words = arrival.reason.unwrap().detail;
    assert!(words.contains(&format!("{attempts} attempts")), "{words}");
}

#[tokio::test]
#[ignore = "step 4"]
async fn a_retrieval_whose_worker_dies_each_time_fails() {
    let subject = Subject::in_memory().await;
    let retrieval = subject
        .store
        .request_retrieval("pacs", &series())
        .await
        .unwrap();
    let lease = async |store: &Store| store.lease_retrieval(LEASE).await.unwrap().is_some();
    let attempts = die_each_time(&subject, lease).await;
    let seen = subject.store.retrieval(&retrieval.id).await.unwrap();
    let seen = seen.unwrap();
    assert_eq!(seen.state, TransferState::Failed);
    let words = seen.reason.unwrap().detail;
    assert!(words.contains(&format!("{attempts} attempts")), "{words}");
}

#[tokio::test]
#[ignore = "step 4"]
async fn a_result_whose_sender_dies_each_time_fails() {
    let subject = Subject::in_memory().await;
    let store = &subject.store;
    let case = new_case(store, "a").await;
    store.insert_case(&case).await.unwrap();
    let new = NewResult {
        case: case.id,
        node: "pacs".to_owned(),
        study: uid("1.2.3"),
        series: ResultSeries {
            sop_class_uid: uid("1.2.840.10008.5.1.4.1.1.7"),
            series_uid: uid("2.25.8"),
            number: 9001,
            description: "a view".to_owned(),
        },
        instance: uid("2.25.7"),
        digest: blake3::hash(b"a result"),
    };
    let pins = pinned(store, &[new.object()]).await;
    let queued = store.insert_result(&new, &pins).await.unwrap().unwrap();
    let lease = async |store: &Store| store.lease_result(LEASE).await.unwrap().is_some();
    let attempts = die_each_time(&subject, lease).await;
    let seen = store.result(&queued.id).await.unwrap().unwrap();
    assert_eq!(seen.state, TransferState::Failed);
    let words = seen.reason.unwrap().detail;
    assert!(words.contains(&format!("{attempts} attempts")), "{words}");
}
