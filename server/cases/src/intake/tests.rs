//! Uploads on their way from spooled files to prepared cases.

use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use bytes::Bytes;
use case::{MaskSource, ObjectKind};
use imaging::Limits;
use pipeline::atlas::AtlasChoice;
use pipeline::testing::{phantom, upload as phantom_upload};
use pipeline::{HeadLimits, Pipeline};
use storage::Store;
use storage::testing::{assert_nothing_left_over, files_below, objects_below};
use tempfile::TempDir;

use super::*;
use crate::application::Options;
use crate::dicom::Program;
use crate::jobs::start_workers;
use crate::library::{Library, LibraryOptions, Preparation};
use crate::pictures::{GpuUse, GraphicsOptions};
use crate::testing::{settled_state, until};

/// Time for a preparation to end.
const GRACE: Duration = Duration::from_secs(60);

/// An application that notes for each preparation whether it got a volume that was already read.
struct Setup {
    cases: Cases,
    was_read: Arc<Mutex<Vec<bool>>>,
    directory: TempDir,
}

async fn setup() -> Setup {
    let directory = tempfile::tempdir().unwrap();
    let options = Options {
        location: directory.path().into(),
        preparation_threads: 2,
        prepares_apart: false,
        preparation_cpu_seconds: 120,
        makes_maps: false,
        max_layers: 20,
        store: storage::Options {
            // A worker that looks for work is not idle.
            poll: Duration::from_secs(60),
            ..crate::testing::options()
        },
        network: None,
        atlas: AtlasChoice::Off,
        limits: Limits::default(),
        head: HeadLimits::default(),
        render_threads: 1,
        max_queued_renders: 4,
        children: worker::ChildBudget::default(),
        cache_bytes: 1 << 20,
        graphics: GraphicsOptions::of_one(GpuUse::Off),
        dicom_program: Program::default(),
        max_dicom_bytes: 1 << 20,
        deidentify: false,
        before_removal: crate::BeforeRemoval::default(),
    };
    let was_read = Arc::new(Mutex::new(Vec::new()));
    let (noted, pipeline) = (Arc::clone(&was_read), Pipeline::default());
    let preparation = Preparation {
        has_network: false,
        is_apart: false,
        prepare: Arc::new(move |input, parameters, limits, observe, cancelled| {
            let was_read = input.read.is_some();
            noted.lock().unwrap().push(was_read);
            assert_eq!(was_read, input.source.volume.is_empty());
            pipeline.derive(input, parameters, limits, observe, cancelled)
        }),
    };
    let store = Store::open(directory.path(), options.store.clone());
    let library_options = LibraryOptions {
        limits: options.limits,
        ..LibraryOptions::default()
    };
    let library = Library::new(store.await.unwrap(), preparation, library_options);
    Setup {
        cases: Cases::on(library, &options),
        was_read,
        directory,
    }
}

impl Setup {
    async fn upload(&self, volume: Bytes, mask: Option<Bytes>) -> Upload {
        let store = self.cases.store();
        let mask = match mask {
            Some(mask) => Some(store.spools().of(mask).await.unwrap()),
            None => None,
        };
        Upload {
            volume: store.spools().of(volume).await.unwrap(),
            mask,
            dicom: None,
            images: Vec::new(),
        }
    }

    async fn phantom(&self) -> Upload {
        let source = phantom_upload(&phantom());
        self.upload(source.volume, source.mask).await
    }

    async fn until_idle(&self) {
        let decoded_uploads = self.cases.library.decoded_uploads().clone();
        until(move || decoded_uploads.is_awaited()).await;
    }

    async fn is_ready(&self, id: &CaseId) {
        let state = settled_state(&self.cases.library, id).await;
        assert_eq!(state, Some(CaseState::Ready));
    }

    fn was_read(&self) -> Vec<bool> {
        self.was_read.lock().unwrap().clone()
    }
}

fn parameters(closing_radius_mm: f64) -> Parameters {
    Parameters {
        closing_radius_mm,
        ..Parameters::default()
    }
}

/// The file of an upload's volume in a store, and how many names it has.
fn stored_volume(root: &Path) -> (Vec<u8>, u64) {
    use std::os::unix::fs::MetadataExt as _;
    let folder = root.join("objects").join(ObjectKind::SourceVolume.name());
    let [file] = &files_below(&folder)[..] else {
        panic!("one volume is stored");
    };
    (
        std::fs::read(file).unwrap(),
        file.metadata().unwrap().nlink(),
    )
}

#[tokio::test]
async fn an_upload_is_read_once_and_written_once() {
    let setup = setup().await;
    let workers = start_workers(setup.cases.library.clone(), 1);
    setup.until_idle().await;
    let upload = setup.phantom().await;
    let (spooled, sent) = (upload.volume.path().to_owned(), upload.volume.read().await);
    let inode = |path: &Path| {
        use std::os::unix::fs::MetadataExt as _;
        path.metadata().unwrap().ino()
    };
    let written = inode(&spooled);
    let submitted = setup.cases.submit(upload, parameters(10.0), false).await;
    let submitted = submitted.unwrap();
    assert!(submitted.created && !spooled.exists());
    setup.is_ready(&submitted.case.id).await;
    assert_eq!(setup.was_read(), [true], "the check's volume was prepared");
    let (stored, names) = stored_volume(setup.directory.path());
    assert_eq!((&stored[72..], names), (&sent.unwrap()[..], 1));
    let folder = setup.directory.path().join("objects/source-volume");
    assert_eq!(inode(&files_below(&folder)[0]), written, "the same file");
    workers.shut_down(GRACE).await;
    assert_nothing_left_over(setup.cases.store(), setup.directory.path()).await;
}

#[tokio::test]
async fn what_was_handed_over_is_prepared_as_what_is_read_from_the_store() {
    let [handed, stored] = [setup().await, setup().await];
    let workers = start_workers(handed.cases.library.clone(), 1);
    handed.until_idle().await;
    let submit = async |setup: &Setup| {
        let upload = setup.phantom().await;
        let submitted = setup.cases.submit(upload, parameters(8.0), false).await;
        submitted.unwrap().case.id
    };
    let id = submit(&handed).await;
    // Here no worker is idle yet: it reads what is stored.
    assert_eq!(submit(&stored).await, id);
    let late = start_workers(stored.cases.library.clone(), 1);
    let mut facts = Vec::new();
    for setup in [&handed, &stored] {
        setup.is_ready(&id).await;
        let mut of_case = setup.cases.case(&id).await.unwrap().facts.unwrap();
        assert!(of_case.timings[0].1 > 0.0, "reading took time");
        of_case.timings.clear();
        facts.push(of_case);
    }
    assert_eq!(facts[0], facts[1]);
    assert_eq!(
        (handed.was_read(), stored.was_read()),
        (vec![true], vec![false])
    );
    let objects = |setup: &Setup| {
        let files = objects_below(&setup.directory.path().join("objects"));
        let contents = files.iter().map(|file| std::fs::read(file).unwrap());
        contents.collect::<Vec<_>>()
    };
    assert!(
        objects(&handed) == objects(&stored),
        "the same bytes are stored"
    );
    late.shut_down(GRACE).await;
    workers.shut_down(GRACE).await;
}

#[tokio::test]
async fn a_version_is_read_once_more_and_not_twice() {
    let setup = setup().await;
    let workers = start_workers(setup.cases.library.clone(), 1);
    setup.until_idle().await;
    let upload = setup.phantom().await;
    let first = setup.cases.submit(upload, parameters(10.0), false).await;
    let of = first.unwrap().case.id;
    setup.is_ready(&of).await;
    setup.until_idle().await;
    let version = |mask, parameters| Version {
        of,
        mask,
        parameters,
    };
    let made = setup
        .cases
        .submit_version(version(NewMask::Kept, parameters(8.0)));
    let made = made.await.unwrap();
    assert!(made.created);
    setup.is_ready(&made.case.id).await;
    assert_eq!(setup.was_read(), [true, true]);
    let again = setup
        .cases
        .submit_version(version(NewMask::Kept, parameters(8.0)));
    assert!(!again.await.unwrap().created);
    let twice = Parameters {
        mask: MaskSource::Volume,
        ..parameters(8.0)
    };
    let refused = setup
        .cases
        .submit_version(version(NewMask::None, twice))
        .await;
    assert!(matches!(refused, Err(Error::Failure(failure)) if failure.name == "mask-missing"));
    setup.cases.delete(&of).await.unwrap();
    let gone = setup
        .cases
        .submit_version(version(NewMask::Kept, parameters(9.0)));
    assert!(matches!(gone.await, Err(Error::NoSuchCase)));
    workers.shut_down(GRACE).await;
    assert_eq!(setup.was_read(), [true, true]);
}

#[tokio::test]
async fn files_in_memory_are_read_once_though_their_mask_must_be_settled() {
    let setup = setup().await;
    let library = setup.cases.library.clone();
    let workers = start_workers(library.clone(), 1);
    setup.until_idle().await;
    let source = Source {
        mask: None,
        ..phantom_upload(&phantom())
    };
    let submitted = library.submit(source, Parameters::default()).await.unwrap();
    assert_eq!(submitted.case.parameters.mask, MaskSource::Pruning);
    settled_state(&library, &submitted.case.id).await;
    assert_eq!(setup.was_read(), [true], "what was read to settle the mask");
    workers.shut_down(GRACE).await;
}

#[tokio::test]
async fn what_cannot_be_prepared_leaves_nothing() {
    let setup = setup().await;
    let head = phantom_upload(&phantom());
    let (volume, mask) = (&head.volume, head.mask.as_ref().unwrap());
    let half = volume.slice(..volume.len() / 2);
    let text = Bytes::from_static(b"a text");
    let of_volume = Parameters {
        mask: MaskSource::Volume,
        ..Parameters::default()
    };
    let by_network = Parameters {
        mask: MaskSource::Network,
        ..Parameters::default()
    };
    let table = [
        (&text, Some(mask), parameters(10.0), "not-nifti"),
        (&half, Some(mask), parameters(10.0), "gzip-truncated"),
        (volume, Some(&text), parameters(10.0), "not-nifti"),
        (
            volume,
            Some(mask),
            parameters(51.0),
            "closing-radius-out-of-range",
        ),
        (volume, Some(mask), of_volume.clone(), "mask-twice"),
        (volume, None, of_volume, "mask-missing"),
        (volume, None, by_network, "network-missing"),
    ];
    for (volume, mask, parameters, name) in table {
        let upload = setup.upload(volume.clone(), mask.cloned()).await;
        match setup.cases.submit(upload, parameters, false).await {
            Err(Error::Failure(failure)) => assert_eq!(failure.name, name),
            other => panic!("{name}: {other:?}"),
        }
        assert_nothing_left_over(setup.cases.store(), setup.directory.path()).await;
        assert!(objects_below(&setup.directory.path().join("objects")).is_empty());
    }
    assert!(setup.was_read().is_empty());
}
