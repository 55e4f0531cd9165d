//! Cases without files, for checks of the rows.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use case::{CaseId, JobKind, ObjectKind, Parameters};

use super::name;
use crate::arrivals::Uid;
use crate::results::{NewResult, ResultSeries};
use crate::rows::{NewCase, Pinned};
use crate::{Claim, ObjectName, Store};

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
pub(crate) async fn claim(store: &Store) -> Option<Claim> {
    store.claim(JobKind::PREPARE, 3).await.unwrap()
}

/// A result of a case of the study 1.2.3, to be sent to a node. Its contents are told apart by their digest alone.
pub(crate) fn new_result(case: CaseId, node: &str, contents: &str) -> NewResult {
    let uid = |text| Uid::parse(text).expect("a UID");
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
