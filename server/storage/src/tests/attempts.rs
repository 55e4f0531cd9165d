//! Work that never comes to an end: it is tried so many times, and then fails in words.

use std::time::Duration;

use crate::arrivals::{
    ArrivalSource, ArrivalState, DueTerms, NewInstance, Reception, SeriesQuery, SeriesUids, Uid,
};
use crate::conformance::Subject;
use crate::rows::Referred;
use crate::testing::{new_case, new_result, pinned};
use crate::{NewJob, ObjectName};
use case::{JobKind, JobState};

const LEASE: Duration = Duration::from_secs(60);

const MAX_ATTEMPTS: u32 = 5;

/// Leases jobs of a kind, and lets their process die, until there is none; returns how often.
async fn die_each_time(subject: &Subject, kind: JobKind) -> u32 {
    let claim = async || subject.store.claim(kind, MAX_ATTEMPTS).await.unwrap();
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
    let pins = pinned(store, &[ObjectName::from(&image)]).await;
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
    let attempts = die_each_time(&subject, JobKind::SERIES).await;
    assert_eq!(store.queue_due_series(&terms).await.unwrap(), 0);
    let query = SeriesQuery::Study(uid("1.2.3"), None);
    let arrival = store.arrivals_of(&query).await.unwrap().pop().unwrap();
    assert_eq!(arrival.state, ArrivalState::Nothing);
    let words = arrival.reason.unwrap().detail;
    assert!(words.contains(&format!("{attempts} attempts")), "{words}");
}

#[tokio::test]
async fn a_job_of_any_kind_whose_worker_dies_each_time_fails() {
    const FETCH: JobKind = JobKind::new("fetch", "retrieval");
    let subject = Subject::in_memory().await;
    let store = &subject.store;
    let new = NewJob::new(FETCH, "a series");
    let job = store.enqueue(&new).await.unwrap().unwrap();
    let attempts = die_each_time(&subject, FETCH).await;
    let job = store.job(&job.id).await.unwrap().unwrap();
    assert_eq!((job.state, job.attempts), (JobState::Failed, 5));
    let words = job.failure.unwrap().detail;
    assert!(words.contains(&format!("{attempts} attempts")), "{words}");
}

#[tokio::test]
async fn a_result_whose_sender_dies_each_time_fails() {
    let subject = Subject::in_memory().await;
    let store = &subject.store;
    let case = new_case(store, "a").await;
    store.insert_case(&case).await.unwrap();
    let new = new_result(case.id, "pacs", "a result");
    let pins = pinned(store, &[new.object()]).await;
    let send = JobKind::new("send", "delivery");
    let queued = store.insert_result(&new, send, &pins).await.unwrap();
    let Referred::Done(queued) = queued else {
        panic!("the pin is there");
    };
    let attempts = die_each_time(&subject, send).await;
    let seen = store.result(&queued.id).await.unwrap().unwrap();
    let job = seen.job.unwrap();
    assert_eq!(job.state, JobState::Failed);
    let words = job.failure.unwrap().detail;
    assert!(words.contains(&format!("{attempts} attempts")), "{words}");
}
