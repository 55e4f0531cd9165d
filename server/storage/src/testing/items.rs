//! Cases without files, for checks of the rows.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

#[cfg(test)]
use case::JobKind;
use case::{CaseId, ObjectKind, Parameters};

use super::name;
#[cfg(test)]
use crate::Claim;
use crate::rows::{NewCase, Pinned};
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
        sources: pinned(store, &[source]).await,
        queue_limit: 100,
        client: String::new(),
    }
}

/// Leases a preparation for 30 s; it fails at its fourth attempt.
#[cfg(test)]
pub(crate) async fn claim(store: &Store) -> Option<Claim> {
    store.claim(JobKind::PREPARE, 3).await.unwrap()
}
