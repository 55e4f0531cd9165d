//! Cases without files, for checks of the rows.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

#[cfg(test)]
use case::{CaseChange, JobKind};
use case::{CaseId, ObjectKind, Parameters};

use super::name;
use crate::rows::{NewCase, Pinned, Relabel};
#[cfg(test)]
use crate::tables::jobs;
#[cfg(test)]
use crate::{Claim, Job};
use crate::{ObjectName, Store};

/// Objects pinned for an hour.
pub(crate) async fn pinned(store: &Store, names: &[ObjectName]) -> Pinned {
    static HOLDERS: AtomicUsize = AtomicUsize::new(0);
    let holder = format!("test-{}", HOLDERS.fetch_add(1, Ordering::Relaxed));
    let pinned = Pinned {
        holder,
        names: names.to_vec(),
    };
    let hour = Duration::from_secs(3600);
    assert!(store.try_pin(&pinned, hour).await.unwrap());
    pinned
}

/// A case of the volume `contents`, whose source is pinned.
pub(crate) async fn new_case(store: &Store, contents: &str) -> NewCase {
    let source = name(ObjectKind::SourceVolume, contents);
    NewCase {
        id: CaseId::of(&source.digest, None, &Parameters::default()),
        parameters: Parameters::default(),
        previous: None,
        images: Some(Vec::new()),
        series: None,
        relabel: Relabel::Any,
        sources: pinned(store, &[source]).await,
        queue_limit: 100,
        client: String::new(),
    }
}

/// The number of jobs of a kind that wait for a lease.
#[cfg(test)]
pub(crate) async fn waiting(store: &Store, kind: JobKind) -> u64 {
    let counts = crate::upkeep::row_counts(store)
        .await
        .unwrap()
        .by_state
        .into_iter();
    let mut jobs = counts.filter(|(what, ..)| what == "jobs");
    let waiting = jobs.find(|(_, of, state, _)| of == kind.name() && state == "queued");
    waiting.map_or(0, |(.., count)| count)
}

#[cfg(test)]
pub(crate) async fn job(store: &Store, id: &str) -> Option<Job> {
    let mut connection = store.connect().await.unwrap();
    jobs::one(&mut connection, id).await.unwrap()
}

#[cfg(test)]
pub(crate) async fn rename(store: &Store, id: &CaseId, name: &str) {
    let change = CaseChange {
        name: Some(name.to_owned()),
        ..CaseChange::default()
    };
    store.change_case(id, &change).await.unwrap();
}

/// Keeps a case for good, or no longer; whether it exists.
#[cfg(test)]
pub(crate) async fn keep(store: &Store, id: &CaseId, kept: bool) -> bool {
    let change = CaseChange {
        kept: Some(kept),
        ..CaseChange::default()
    };
    store.change_case(id, &change).await.unwrap()
}

/// Leases a preparation for 30 s; it fails at its fourth attempt.
#[cfg(test)]
pub(crate) async fn claim(store: &Store) -> Option<Claim> {
    store.claim(JobKind::PREPARE, 3).await.unwrap()
}
