//! Uploads on their way from spooled files to prepared cases.

use std::path::Path;
use std::time::Duration;

use bytes::Bytes;
use case::{MaskSource, ObjectKind};
use pipeline::testing::{phantom, upload as phantom_upload};
use storage::Store;
use storage::testing::{assert_nothing_left_over, files_below, objects_below};
use tempfile::TempDir;

use super::*;
use crate::jobs::start_workers;
use crate::testing::{application, settled_state};

/// Time for a preparation to end.
const GRACE: Duration = Duration::from_secs(60);

struct Setup {
    cases: Cases,
    directory: TempDir,
}

async fn setup() -> Setup {
    let directory = tempfile::tempdir().unwrap();
    let store = Store::open(directory.path(), crate::testing::options());
    Setup {
        cases: application(store.await.unwrap(), "exit 1"),
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
            series: None,
        }
    }

    async fn phantom(&self) -> Upload {
        let source = phantom_upload(&phantom());
        self.upload(source.volume, source.mask).await
    }

    async fn is_ready(&self, id: &CaseId) {
        let state = settled_state(&self.cases.library, id).await;
        assert_eq!(state, Some(CaseState::Ready));
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
async fn an_upload_is_written_once() {
    let setup = setup().await;
    let workers = start_workers(setup.cases.library.clone(), 1);
    let upload = setup.phantom().await;
    let (spooled, sent) = (upload.volume.path().to_owned(), upload.volume.read().await);
    let inode = |path: &Path| {
        use std::os::unix::fs::MetadataExt as _;
        path.metadata().unwrap().ino()
    };
    let written = inode(&spooled);
    let submitted = setup.cases.submit(upload, parameters(10.0), true).await;
    let submitted = submitted.unwrap();
    assert!(submitted.created && !spooled.exists());
    setup.is_ready(&submitted.case.id).await;
    let (stored, names) = stored_volume(setup.directory.path());
    assert_eq!((&stored[72..], names), (&sent.unwrap()[..], 1));
    let folder = setup.directory.path().join("objects/source-volume");
    assert_eq!(inode(&files_below(&folder)[0]), written, "the same file");
    workers.shut_down(GRACE).await;
    assert_nothing_left_over(setup.cases.store(), setup.directory.path()).await;
}

#[tokio::test]
async fn a_version_is_checked_as_an_upload() {
    let setup = setup().await;
    let workers = start_workers(setup.cases.library.clone(), 1);
    let upload = setup.phantom().await;
    let first = setup.cases.submit(upload, parameters(10.0), true).await;
    let of = first.unwrap().case.id;
    setup.is_ready(&of).await;
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
}

#[tokio::test]
async fn the_mask_of_files_in_memory_is_settled() {
    let setup = setup().await;
    let source = Source {
        mask: None,
        ..phantom_upload(&phantom())
    };
    let submitted = setup.cases.library.submit(source, Parameters::default());
    let case = submitted.await.unwrap().case;
    assert_eq!(case.parameters.mask, MaskSource::Pruning);
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
        match setup.cases.submit(upload, parameters, true).await {
            Err(Error::Failure(failure)) => assert_eq!(failure.name, name),
            other => panic!("{name}: {other:?}"),
        }
        assert_nothing_left_over(setup.cases.store(), setup.directory.path()).await;
        assert!(objects_below(&setup.directory.path().join("objects")).is_empty());
    }
}
