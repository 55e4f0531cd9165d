//! Work that never comes to an end: it is tried so many times, and then fails in words.

use std::time::Duration;

use crate::arrivals::{
    ArrivalSource, ArrivalState, DueTerms, NewInstance, SeriesQuery, SeriesUids, TransferState, Uid,
};
use crate::conformance::RowsSubject;
use crate::results::{NewResult, ResultSeries};
use crate::rows::CaseRows;
use crate::testing::{new_case, pinned};
use crate::{ObjectName, SqlRows};

const LEASE: Duration = Duration::from_secs(60);

/// More than anything is tried.
const MANY: usize = 100;

async fn subject() -> RowsSubject {
    let rows = SqlRows::in_memory().await.unwrap();
    let clock = rows.clone();
    RowsSubject {
        rows: std::sync::Arc::new(rows),
        pass_time: Box::new(move |by| clock.pass_time(by)),
        keep: Box::new(()),
    }
}

/// Leases work, and lets its process die, until there is none; returns how often.
async fn die_each_time(subject: &RowsSubject, lease: impl AsyncFn(&dyn CaseRows) -> bool) -> usize {
    for attempt in 0..MANY {
        if !lease(&*subject.rows).await {
            return attempt;
        }
        (subject.pass_time)(24 * 60 * LEASE);
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
    let subject = subject().await;
    let rows = &*subject.rows;
    let image = NewInstance {
        uids: series(),
        accession_number: None,
        digest: blake3::hash(b"an image"),
        sop_instance_uid: uid("1.2.3.4.5"),
    };
    let pins = pinned(rows, &[ObjectName::from(&image)]).await;
    let received = rows.receive(&[image], &pins, ArrivalSource::CStore).await;
    assert_eq!(received.unwrap(), Some(1));
    (subject.pass_time)(LEASE);
    let terms = DueTerms {
        stable: LEASE,
        patience: LEASE,
        lease: LEASE,
    };
    let lease = async |rows: &dyn CaseRows| rows.lease_due(&terms).await.unwrap().is_some();
    let attempts = die_each_time(&subject, lease).await;
    let query = SeriesQuery::Study(uid("1.2.3"), None);
    let arrival = rows.arrivals_of(&query).await.unwrap().pop().unwrap();
    assert_eq!(arrival.state, ArrivalState::Nothing);
    let words = arrival.reason.unwrap().detail;
    assert!(words.contains(&format!("{attempts} attempts")), "{words}");
}

#[tokio::test]
#[ignore = "step 4"]
async fn a_retrieval_whose_worker_dies_each_time_fails() {
    let subject = subject().await;
    let retrieval = subject.rows.request("pacs", &series()).await.unwrap();
    let lease = async |rows: &dyn CaseRows| rows.lease_retrieval(LEASE).await.unwrap().is_some();
    let attempts = die_each_time(&subject, lease).await;
    let seen = subject.rows.retrieval(&retrieval.id).await.unwrap();
    let seen = seen.unwrap();
    assert_eq!(seen.state, TransferState::Failed);
    let words = seen.reason.unwrap().detail;
    assert!(words.contains(&format!("{attempts} attempts")), "{words}");
}

#[tokio::test]
#[ignore = "step 4"]
async fn a_result_whose_sender_dies_each_time_fails() {
    let subject = subject().await;
    let rows = &*subject.rows;
    let case = new_case(rows, "a").await;
    rows.insert(&case).await.unwrap();
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
    let pins = pinned(rows, &[new.object()]).await;
    let queued = rows.queue_result(&new, &pins).await.unwrap().unwrap();
    let lease = async |rows: &dyn CaseRows| rows.lease_result(LEASE).await.unwrap().is_some();
    let attempts = die_each_time(&subject, lease).await;
    let seen = rows.result(&queued.id).await.unwrap().unwrap();
    assert_eq!(seen.state, TransferState::Failed);
    let words = seen.reason.unwrap().detail;
    assert!(words.contains(&format!("{attempts} attempts")), "{words}");
}
