//! What the tests of the library, of the workers and of the models share, and those of the crates above.

use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use bytes::Bytes;
use case::{
    Case, CaseId, CaseState, Failure, FailureKind, ObjectKind, Parameters, Progress, Stage,
};
use pipeline::{Derived, Source};
use storage::testing::{facts, failure};
use storage::{Options, Store};
use worker::ChildBudget;

use crate::application::Cases;
use crate::dicom::Program;
use crate::library::{Library, LibraryOptions, Preparation};
use crate::removal::BeforeRemoval;
use crate::settings::{Limits, Prepare, Render};

/// A preparation that takes as long as it is told, and whose results are made of the source's bytes.
#[derive(Debug, Default)]
pub struct Fake {
    /// Volumes that were prepared, in order.
    pub runs: Mutex<Vec<Bytes>>,
    /// While raised, preparations go on until they are cancelled or it is lowered.
    pub hold: AtomicBool,
    /// Preparations at work.
    pub active: AtomicUsize,
    /// The most that were at work at a time.
    pub most: AtomicUsize,
}

impl Fake {
    pub fn run_count(&self) -> usize {
        self.runs.lock().unwrap().len()
    }

    pub fn hold(&self, hold: bool) {
        self.hold.store(hold, Ordering::Relaxed);
    }

    pub async fn until_active(&self) {
        while self.active.load(Ordering::Relaxed) == 0 {
            tokio::time::sleep(Duration::from_millis(2)).await;
        }
    }
}

impl Fake {
    /// It as what prepares cases.
    pub fn preparation(self: &Arc<Self>) -> Preparation {
        let fake = Arc::clone(self);
        Preparation {
            has_network: true,
            is_apart: false,
            prepare: Arc::new(move |source, _, _, observe, cancelled| {
                fake.run(source, observe, cancelled)
            }),
        }
    }

    fn run(
        &self,
        source: &Source,
        observe: &(dyn Fn(Progress) + Sync),
        cancelled: &AtomicBool,
    ) -> Result<Derived, Failure> {
        let is_first = {
            let mut runs = self.runs.lock().unwrap();
            runs.push(source.volume.clone());
            runs.iter().filter(|run| **run == source.volume).count() == 1
        };
        let active = 1 + self.active.fetch_add(1, Ordering::Relaxed);
        self.most.fetch_max(active, Ordering::Relaxed);
        observe(Progress::at(Stage::Forest));
        while self.hold.load(Ordering::Relaxed) && !cancelled.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(1));
        }
        self.active.fetch_sub(1, Ordering::Relaxed);
        if cancelled.load(Ordering::Relaxed) {
            return Err(Failure::unusable("cancelled", "cancelled"));
        }
        match &source.volume[..] {
            b"bad" => Err(failure()),
            b"interrupted" if is_first => Err(Failure::new(
                FailureKind::Cancelled,
                "cancelled",
                "a process was ended",
            )),
            b"panic" => panic!("a fault of the program, on purpose"),
            volume => Ok(Derived {
                objects: fake_objects(volume),
                facts: facts(),
            }),
        }
    }
}

/// Waits until something holds.
pub async fn until(holds: impl Fn() -> bool) {
    let wait = async {
        while !holds() {
            tokio::time::sleep(Duration::from_millis(2)).await;
        }
    };
    tokio::time::timeout(Duration::from_secs(60), wait)
        .await
        .expect("it comes to hold");
}

pub fn fake_objects(volume: &[u8]) -> Vec<(ObjectKind, Bytes)> {
    let payload = |kind: ObjectKind| [kind.name().as_bytes(), volume, &[0; 999]].concat().into();
    ObjectKind::DERIVED.map(|kind| (kind, payload(kind))).into()
}

/// The library of a store whose cases are prepared by a fake.
pub fn library_on(store: Store, fake: &Arc<Fake>) -> Library {
    Library::new(store, fake.preparation(), LibraryOptions::default())
}

/// Options of a store whose workers are quick to look for work.
pub fn options() -> Options {
    Options {
        heartbeat: Duration::from_millis(20),
        poll: Duration::from_millis(20),
        retry_after: Duration::from_millis(20),
        ..Options::default()
    }
}

pub fn source(volume: &str) -> Source {
    Source {
        volume: Bytes::copy_from_slice(volume.as_bytes()),
        ..Source::default()
    }
}

/// Submits a volume without a mask.
pub async fn submit(library: &Library, volume: &str) -> Case {
    library
        .submit(source(volume), Parameters::default())
        .await
        .unwrap()
        .case
}

/// Waits until a case is ready or failed, or gone.
pub async fn settled(library: &Library, id: &CaseId) -> Option<Case> {
    let mut watch = library.store().subscribe(id);
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

pub async fn settled_state(library: &Library, id: &CaseId) -> Option<CaseState> {
    settled(library, id).await.map(|case| case.state)
}

/// An application whose DICOM files are read by a script of the shell.
pub fn application(store: Store, script: &str) -> Cases {
    let arguments = vec!["-c".into(), script.into()];
    let options = crate::Options {
        location: Path::new("unused").into(),
        store: options(),
        limits: Limits::default(),
        prepare: Prepare::default(),
        render: Render {
            threads: 1,
            ..Render::on_cpu()
        },
        children: ChildBudget::default(),
        prepares_apart: false,
        dicom_program: Program::other("/bin/sh".into(), arguments),
        deidentify: false,
        before_removal: BeforeRemoval::default(),
    };
    Cases::on(Library::of(store), &options)
}
