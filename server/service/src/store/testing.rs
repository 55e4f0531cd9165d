//! What the tests of the store and of the workers share.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use bytes::Bytes;
use jiff::Timestamp;

use super::rows::{CaseRows, Claim, LeaseTerms, NewCase, Pinned};
use super::{ObjectKind, ObjectName, Options, Store};
use crate::case::{
    Case, CaseFacts, CaseId, CaseState, Failure, Parameters, Progress, SphereFacts, Stage,
    WindowFacts,
};
use crate::prepare::{Derived, Limits, Preparation, Source};

/// A moment, in seconds after an arbitrary start.
pub(crate) fn at(seconds: i64) -> Timestamp {
    Timestamp::from_second(1_700_000_000 + seconds).unwrap()
}

pub(crate) fn facts() -> CaseFacts {
    CaseFacts {
        grid_size: [1, 2, 3],
        spacing_mm: 1.0,
        patient_from_voxel: [[0.0; 4]; 4],
        native_size: [1, 2, 3],
        native_spacing_mm: [1.0; 3],
        native_patient_from_voxel: [[0.0; 4]; 4],
        envelope_sphere: SphereFacts {
            center_in_patient: [0.0; 3],
            radius_mm: 1.0,
        },
        max_depth_mm: 10.0,
        envelope_ml: 100.0,
        intensity_min: 0.0,
        intensity_max: 1.0,
        window: WindowFacts {
            center: 0.5,
            width: 1.0,
        },
        midsagittal: None,
        quality: None,
        dicom: None,
        timings: vec![(Stage::Reading, 1.0)],
    }
}

pub(crate) fn failure() -> Failure {
    Failure::unprocessable("mask-empty", "the mask is empty".to_owned())
}

pub(crate) fn name(kind: ObjectKind, contents: &str) -> ObjectName {
    ObjectName {
        kind,
        digest: blake3::hash(contents.as_bytes()),
    }
}

/// Objects pinned from now (0 s) for an hour.
pub(crate) async fn pinned(rows: &dyn CaseRows, names: &[ObjectName]) -> Pinned {
    static HOLDERS: AtomicUsize = AtomicUsize::new(0);
    let holder = format!("test-{}", HOLDERS.fetch_add(1, Ordering::Relaxed));
    let pinned = Pinned {
        holder,
        names: names.to_vec(),
    };
    rows.pin(&pinned, at(3600)).await.unwrap();
    pinned
}

/// A case of the volume `contents`, whose source is pinned.
pub(crate) async fn new_case(rows: &dyn CaseRows, contents: &str, now: Timestamp) -> NewCase {
    let source = name(ObjectKind::SourceVolume, contents);
    NewCase {
        id: CaseId::of(&source.digest, None, &Parameters::default()),
        parameters: Parameters::default(),
        previous: None,
        sources: pinned(rows, &[source]).await,
        now,
        queue_limit: 100,
    }
}

/// Leases a job at a second, for 30 s.
pub(crate) async fn claim(rows: &dyn CaseRows, second: i64) -> Option<Claim> {
    let terms = LeaseTerms {
        now: at(second),
        until: at(second + 30),
        max_attempts: 3,
    };
    rows.claim(&terms).await.unwrap()
}

/// A preparation that takes as long as it is told, and whose results are made of the source's bytes.
#[derive(Debug, Default)]
pub(crate) struct Fake {
    /// Volumes that were prepared, in order.
    pub(crate) runs: Mutex<Vec<Bytes>>,
    /// While raised, preparations go on until they are cancelled or it is lowered.
    pub(crate) hold: AtomicBool,
    /// Preparations at work.
    pub(crate) active: AtomicUsize,
}

impl Fake {
    pub(crate) fn run_count(&self) -> usize {
        self.runs.lock().unwrap().len()
    }

    pub(crate) fn hold(&self, hold: bool) {
        self.hold.store(hold, Ordering::Relaxed);
    }

    pub(crate) async fn until_active(&self) {
        while self.active.load(Ordering::Relaxed) == 0 {
            tokio::time::sleep(Duration::from_millis(2)).await;
        }
    }
}

impl Preparation for Fake {
    fn has_network(&self) -> bool {
        true
    }

    fn run(
        &self,
        source: &Source,
        _: &Parameters,
        _: &Limits,
        observe: &(dyn Fn(Progress) + Sync),
        cancelled: &AtomicBool,
    ) -> Result<Derived, Failure> {
        self.runs.lock().unwrap().push(source.volume.clone());
        self.active.fetch_add(1, Ordering::Relaxed);
        observe(Progress::at(Stage::Forest));
        while self.hold.load(Ordering::Relaxed) && !cancelled.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(1));
        }
        self.active.fetch_sub(1, Ordering::Relaxed);
        if cancelled.load(Ordering::Relaxed) {
            return Err(Failure::unprocessable("cancelled", "cancelled".to_owned()));
        }
        match &source.volume[..] {
            b"bad" => Err(failure()),
            b"panic" => panic!("a fault of the program, on purpose"),
            volume => Ok(Derived {
                objects: fake_objects(volume),
                facts: facts(),
            }),
        }
    }
}

pub(crate) fn fake_objects(volume: &[u8]) -> Vec<(ObjectKind, Bytes)> {
    let payload = |kind: ObjectKind| [kind.name().as_bytes(), volume, &[0; 999]].concat().into();
    ObjectKind::DERIVED.map(|kind| (kind, payload(kind))).into()
}

/// Options with a fake preparation, quick to look for work.
pub(crate) fn options(fake: &Arc<Fake>) -> Options {
    Options {
        preparation: fake.clone(),
        heartbeat: Duration::from_millis(20),
        poll: Duration::from_millis(20),
        retry_after: Duration::from_millis(20),
        ..Options::default()
    }
}

pub(crate) fn source(volume: &str) -> Source {
    Source {
        volume: Bytes::copy_from_slice(volume.as_bytes()),
        ..Source::default()
    }
}

/// Submits a volume without a mask.
pub(crate) async fn submit(store: &Store, volume: &str) -> Case {
    store
        .submit(source(volume), Parameters::default())
        .await
        .unwrap()
        .case
}

/// Waits until a case is ready or failed, or gone.
pub(crate) async fn settled(store: &Store, id: &CaseId) -> Option<Case> {
    let mut watch = store.subscribe(id);
    let wait = async {
        loop {
            let case = watch.next().await.unwrap();
            if case.as_ref().is_none_or(|case| case.state.is_final()) {
                return case;
            }
        }
    };
    tokio::time::timeout(Duration::from_secs(60), wait)
        .await
        .expect("a case settles")
}

pub(crate) async fn settled_state(store: &Store, id: &CaseId) -> Option<CaseState> {
    settled(store, id).await.map(|case| case.state)
}

/// Every file below a directory, ascending.
pub(crate) fn files_below(directory: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(directory).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(files_below(&path));
        } else {
            files.push(path);
        }
    }
    files.sort();
    files
}

/// What must be true of a store on disk whenever nothing is under way: the objects are those that cases need, and no upload is left.
pub(crate) async fn assert_nothing_left_over(store: &Store, root: &Path) {
    assert_eq!(files_below(&root.join("uploads")), Vec::<PathBuf>::new());
    let mut needed = Vec::new();
    for case in store.cases(None, 1000).await.unwrap().cases {
        for name in store.rows().objects(&case.id).await.unwrap() {
            needed.push(root.join("objects").join(name.path().as_ref()));
        }
    }
    needed.sort();
    needed.dedup();
    assert_eq!(files_below(&root.join("objects")), needed);
}
