//! What is stored and cannot be read, for a reason that is not its own.

use std::time::Duration;

use case::Parameters;
use imaging::Limits;
use pipeline::atlas::AtlasChoice;
use pipeline::{HeadLimits, Source};
use storage::arrivals::{
    ArrivalSource, ArrivalState, NewInstance, Reception, SeriesQuery, SeriesUids, Uid,
};
use storage::testing::files_below;
use storage::{Store, StoreError};

use super::{ArrivalOptions, SeriesRule};
use crate::application::{Cases, Options};
use crate::dicom::Program;
use crate::library::Library;
use crate::pictures::{GpuUse, GraphicsOptions};
use crate::testing::source;

/// A child that reports that there is not enough memory.
const OUT_OF_MEMORY: &str = r#"order=$(/bin/cat); output=${order#*\"output\":\"}; output=${output%%\"*}
printf '%s' '{"refused":{"name":"dicom-out-of-memory","kind":"out_of_memory","detail":"too little memory"}}' > "$output/outcome.json""#;

/// An application whose DICOM files are read by a script of the shell.
pub(crate) fn application(store: Store, script: &str) -> Cases {
    let arguments = vec!["-c".into(), script.into()];
    let options = Options {
        location: std::path::Path::new("unused").into(),
        preparation_threads: 1,
        prepares_apart: false,
        preparation_cpu_seconds: 120,
        makes_maps: false,
        max_layers: 20,
        store: crate::testing::options(),
        network: None,
        atlas: AtlasChoice::Off,
        limits: Limits::default(),
        head: HeadLimits::default(),
        render_threads: 1,
        max_queued_renders: 4,
        cache_bytes: 1 << 20,
        children: worker::ChildBudget::default(),
        graphics: GraphicsOptions::of_one(GpuUse::Off),
        dicom_program: Program::other("/bin/sh".into(), arguments),
        max_dicom_bytes: 1 << 20,
        deidentify: false,
        before_removal: crate::BeforeRemoval::default(),
    };
    Cases::on(Library::of(store), &options)
}

fn uid(text: &str) -> Uid {
    Uid::parse(text).unwrap()
}

#[tokio::test]
async fn a_series_that_is_out_of_memory_each_time_becomes_nothing() {
    let store = Store::in_memory(crate::testing::options()).await.unwrap();
    let cases = application(store, OUT_OF_MEMORY);
    let file = cases.store().spool_all("an image".into()).await.unwrap();
    let image = NewInstance {
        uids: SeriesUids {
            study: uid("1.2"),
            series: uid("1.2.3"),
        },
        accession_number: None,
        sop_instance_uid: uid("1.2.3.4"),
        digest: *file.digest(),
        label: None,
        fingerprint: None,
    };
    let received = cases
        .store()
        .receive(vec![(image, file)], ArrivalSource::CStore);
    assert_eq!(received.await.unwrap(), [Reception::New]);
    let options = ArrivalOptions {
        stable: Duration::ZERO,
        series: SeriesRule::Any,
        ..ArrivalOptions::default()
    };
    let mut attempts = 0;
    while attempts < 100 && crate::jobs::read_one_series(&cases, options).await {
        attempts += 1;
        cases.store().pass_time(Duration::from_secs(24 * 3600));
    }
    let query = SeriesQuery::Study(uid("1.2"), None);
    let arrival = cases.store().arrivals_of(&query).await.unwrap();
    let arrival = arrival.into_iter().next().unwrap();
    assert_eq!(arrival.state, ArrivalState::Nothing);
    let words = arrival.reason.unwrap().detail;
    assert!(words.contains(&format!("{attempts} attempts")), "{words}");
    assert!(words.contains("too little memory"), "{words}");
}

#[tokio::test]
async fn a_store_that_fails_is_an_error_and_not_a_case_that_states_no_patient() {
    let directory = tempfile::tempdir().unwrap();
    let store = Store::open_with(directory.path(), crate::testing::options());
    let cases = application(store.await.unwrap(), "");
    let stored = r#"{"attributes":[["PatientID","P-1"]],"instances":[],"interpolated_slices":[]}"#;
    let of_dicom = Source {
        dicom: Some(stored.into()),
        ..source("volume")
    };
    let submitted = cases.library.submit(of_dicom, Parameters::default());
    let id = submitted.await.unwrap().case.id;
    let attributes = cases.attributes_of(&id).await.unwrap().unwrap();
    assert_eq!(attributes.value("PatientID"), Some("P-1"));
    let [file] = &files_below(&directory.path().join("objects/source-dicom"))[..] else {
        panic!("one object has the attributes");
    };
    std::fs::write(file, b"damaged").unwrap();
    assert!(cases.attributes_of(&id).await.unwrap().is_none());
    // A link that leads to itself can be read as little as a disk that fails.
    std::fs::remove_file(file).unwrap();
    std::os::unix::fs::symlink(file, file).unwrap();
    let failed = cases.attributes_of(&id).await.unwrap_err();
    assert!(
        matches!(failed, StoreError::Objects(_) | StoreError::Disk(_)),
        "{failed:?}"
    );
}
