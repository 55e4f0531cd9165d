//! Work that never comes to an end: it is tried so many times, and then fails in words.

use crate::NewJob;
use crate::conformance::Subject;
use crate::testing::job;
use case::{JobKind, JobState};

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

#[tokio::test]
async fn a_job_of_any_kind_whose_worker_dies_each_time_fails() {
    const FETCH: JobKind = JobKind::new("fetch", "retrieval");
    let subject = Subject::in_memory().await;
    let store = &subject.store;
    let new = NewJob::new(FETCH, "a series");
    let queued = store.enqueue(&new).await.unwrap().unwrap();
    let attempts = die_each_time(&subject, FETCH).await;
    let job = job(store, &queued.id).await.unwrap();
    assert_eq!((job.state, job.attempts), (JobState::Failed, 5));
    let words = job.failure.unwrap().detail;
    assert!(words.contains(&format!("{attempts} attempts")), "{words}");
}
