//! The store as a whole, without anything that prepares: uploads, versions, derived objects, deletions.

mod attempts;
mod identity;
mod inspect;
mod publish;
mod sweep;

use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use bytes::Bytes;
use case::{CaseFacts, CaseId, CaseState, JobKind, ObjectKind, Parameters};
use tempfile::TempDir;

use super::testing::{
    assert_nothing_left_over, claim, facts, failure, files_below, new_case, objects_below, waiting,
};
use super::*;

async fn store(directory: &TempDir) -> Store {
    let options = Options {
        queue_limit: 2,
        poll: Duration::from_millis(20),
        ..Options::default()
    };
    Store::open(directory.path(), options).await.unwrap()
}

async fn upload(store: &Store, volume: &'static str, mask: Option<&'static str>) -> Upload {
    let spool = async |text: &'static str| store.spools().of(text.into()).await.unwrap();
    Upload {
        volume: spool(volume).await,
        mask: match mask {
            Some(mask) => Some(spool(mask).await),
            None => None,
        },
        dicom: None,
        images: Vec::new(),
        series: None,
    }
}

async fn submit(store: &Store, volume: &'static str) -> Result<Submitted, StoreError> {
    let upload = upload(store, volume, None).await;
    store
        .submit(upload, Parameters::default(), None, false)
        .await
}

/// Publishes the derived objects of a case whose volume this is.
async fn publish(store: &Store, publisher: Publisher, volume: &str) {
    let payload = |kind: ObjectKind| Bytes::from(format!("{} of {volume}", kind.name()));
    let objects = ObjectKind::DERIVED.map(|kind| (kind, payload(kind)));
    let framed = frame_all(objects.into()).await.unwrap();
    let published = store.publish(publisher, framed).await;
    assert_eq!(published.unwrap(), Published::Done);
}

/// A case that is ready.
async fn ready(store: &Store, volume: &'static str) -> CaseId {
    let id = submit(store, volume).await.unwrap().case.id;
    let claim = claim(store).await.unwrap();
    assert_eq!(claim.case, Some(id));
    publish(store, Publisher::Case(claim, facts().into(), &[]), volume).await;
    id
}

const VOLUME: &[ObjectKind] = &[ObjectKind::Volume];

async fn read(store: &Store, id: &CaseId) -> Attempt<String> {
    let decode = |_: &CaseFacts, payloads: &[Bytes]| {
        let text = String::from_utf8(payloads[0].to_vec()).ok()?;
        (!text.contains("nonsense")).then_some(text)
    };
    let decode = Arc::new(decode);
    store.read_derived(id, VOLUME, &decode).await.unwrap()
}

#[tokio::test]
async fn an_upload_is_queued_once_and_again_after_it_has_failed() {
    let directory = tempfile::tempdir().unwrap();
    let store = store(&directory).await;
    for (what, created) in [("new", true), ("known", false)] {
        let submitted = submit(&store, "volume").await.unwrap();
        assert_eq!(submitted.created, created, "{what}");
        assert_eq!(submitted.case.state, CaseState::Queued);
    }
    let claim = claim(&store).await.unwrap();
    assert!(store.finish(&claim, Err(&failure())).await.unwrap());
    let again = submit(&store, "volume").await.unwrap();
    assert!(again.created, "a failed one is queued again");
    assert_nothing_left_over(&store, directory.path()).await;
}

#[tokio::test]
async fn whether_an_upload_is_there_is_known_without_the_writer() {
    let directory = tempfile::tempdir().unwrap();
    let store = store(&directory).await;
    let new = new_case(&store, "volume").await;
    let _writing = store.write().await.unwrap();
    assert_eq!(store.uploaded_again(&new).await.unwrap(), None);
}

#[tokio::test]
async fn a_full_queue_refuses_and_keeps_nothing_of_it() {
    let directory = tempfile::tempdir().unwrap();
    let store = store(&directory).await;
    for volume in ["one", "two"] {
        submit(&store, volume).await.unwrap();
    }
    assert_eq!(waiting(&store, JobKind::PREPARE).await, 2);
    let refused = submit(&store, "three").await;
    assert!(matches!(refused, Err(StoreError::QueueFull(_))));
    assert!(
        !submit(&store, "one").await.unwrap().created,
        "what is there is found"
    );
    assert_nothing_left_over(&store, directory.path()).await;
}

#[tokio::test]
async fn what_is_uploaded_again_gets_a_label_if_it_has_none_or_is_renamed() {
    let directory = tempfile::tempdir().unwrap();
    let store = store(&directory).await;
    for volume in ["failed", "queued"] {
        let label = async |name: Option<&str>, renames| {
            let parameters = Parameters {
                name: name.map(str::to_owned),
                ..Parameters::default()
            };
            let upload = upload(&store, volume, None).await;
            let submitted = store.submit(upload, parameters, None, renames).await;
            submitted.unwrap().case.parameters.name
        };
        assert_eq!(label(None, false).await, None);
        if volume == "failed" {
            let claimed = claim(&store).await.unwrap();
            assert!(store.finish(&claimed, Err(&failure())).await.unwrap());
        }
        for (name, renames, expected) in [
            (None, true, None),
            (Some("one"), false, Some("one")),
            (Some("two"), false, Some("one")),
            (Some("three"), true, Some("three")),
            (None, true, Some("three")),
        ] {
            let label = label(name, renames).await;
            assert_eq!(label.as_deref(), expected, "{volume} {name:?} {renames}");
        }
    }
}

#[tokio::test]
async fn what_is_uploaded_again_takes_the_place_of_a_file_that_is_missing() {
    let directory = tempfile::tempdir().unwrap();
    let store = store(&directory).await;
    for is_claimed in [false, true] {
        for kind in [ObjectKind::SourceVolume, ObjectKind::SourceMask] {
            let masked = upload(&store, "volume", Some("mask")).await;
            store
                .submit(masked, Parameters::default(), None, false)
                .await
                .unwrap();
            let folder = directory.path().join("objects").join(kind.name());
            let [file] = &objects_below(&folder)[..] else {
                panic!("one {}", kind.name());
            };
            std::fs::remove_file(file).unwrap();
            let again = upload(&store, "volume", Some("mask")).await;
            let again = store
                .submit(again, Parameters::default(), None, false)
                .await;
            assert!(!again.unwrap().created);
            assert!(file.is_file(), "{}", kind.name());
        }
        assert!(is_claimed || claim(&store).await.is_some());
    }
    assert_nothing_left_over(&store, directory.path()).await;
}

#[tokio::test]
async fn the_same_files_and_parameters_have_one_name() {
    let store = Store::in_memory(Options::default()).await.unwrap();
    let of = async |volume, mask, parameters: &Parameters| {
        upload(&store, volume, mask).await.case_id(parameters)
    };
    let default = Parameters::default();
    let named = Parameters {
        name: Some("a label".to_owned()),
        ..Parameters::default()
    };
    let closer = Parameters {
        closing_radius_mm: 8.0,
        ..Parameters::default()
    };
    let expected = of("volume", Some("mask"), &default).await;
    for (volume, mask, parameters, is_same) in [
        ("volume", Some("mask"), &default, true),
        ("volume", Some("mask"), &named, true),
        ("volume", Some("mask"), &closer, false),
        ("volume", None, &default, false),
        ("mask", Some("volume"), &default, false),
        ("volume", Some("another"), &default, false),
    ] {
        let id = of(volume, mask, parameters).await;
        assert_eq!(id == expected, is_same, "{volume} {mask:?}");
    }
    let of_somebody = Upload {
        dicom: Some(store.spools().of("whose".into()).await.unwrap()),
        ..upload(&store, "volume", Some("mask")).await
    };
    assert_ne!(of_somebody.case_id(&default), expected);
}

#[tokio::test]
async fn a_version_has_the_volume_and_the_mask_that_it_says() {
    let directory = tempfile::tempdir().unwrap();
    let store = store(&directory).await;
    let upload = upload(&store, "volume", Some("mask")).await;
    let submitted = store
        .submit(upload, Parameters::default(), None, false)
        .await;
    let of = submitted.unwrap().case.id;
    assert_eq!(claim(&store).await.unwrap().case, Some(of));
    // With the manifest.
    assert_eq!(store.objects_of(&of).await.unwrap().len(), 3);
    let closer = || Parameters {
        closing_radius_mm: 8.0,
        ..Parameters::default()
    };
    let supplied = NewMask::Supplied(store.spools().of("another".into()).await.unwrap());
    for (mask, sources) in [(supplied, 2), (NewMask::None, 1), (NewMask::Kept, 2)] {
        let mut version = Version {
            of,
            mask,
            parameters: Parameters::default(),
        };
        let names = store.objects_of(&of).await.unwrap();
        let wider = version.id(&names);
        version.parameters = closer();
        let id = version.id(&names).unwrap();
        assert_ne!(wider, Some(id));
        let made = store.submit_version(version).await.unwrap().unwrap();
        assert_eq!((made.case.id, made.case.previous), (id, Some(of)));
        let claimed = claim(&store).await.unwrap();
        assert_eq!(claimed.case, Some(id));
        let names = store.objects_of(&id).await.unwrap();
        assert_eq!(names.len(), sources + 1);
        let volume = store.read(&id, &names, ObjectKind::SourceVolume);
        assert_eq!(volume.await.unwrap().as_deref(), Some(&b"volume"[..]));
    }
    assert_eq!(store.case(&of).await.unwrap().unwrap().next.len(), 3);
    let nobody = Version {
        of: CaseId::of(&blake3::hash(b"nobody"), None, &closer()),
        mask: NewMask::Kept,
        parameters: closer(),
    };
    assert!(nobody.id(&[]).is_none());
    assert!(store.submit_version(nobody).await.unwrap().is_none());
    assert_nothing_left_over(&store, directory.path()).await;
}

#[tokio::test]
async fn derived_objects_are_read_once_their_case_is_ready() {
    let directory = tempfile::tempdir().unwrap();
    let store = store(&directory).await;
    let queued = submit(&store, "volume").await.unwrap().case.id;
    assert!(matches!(read(&store, &queued).await, Attempt::NoCase));
    store.delete(&queued).await.unwrap();
    assert!(matches!(read(&store, &queued).await, Attempt::NoCase));
    let id = ready(&store, "volume").await;
    match read(&store, &id).await {
        Attempt::Read(text) => assert_eq!(text, "volume of volume"),
        other => panic!("{other:?}"),
    }
    let undecodable = ready(&store, "nonsense").await;
    assert!(matches!(read(&store, &undecodable).await, Attempt::Bad));
    let folder = directory.path().join("objects/volume");
    for file in files_below(&folder) {
        std::fs::write(file, b"damaged").unwrap();
    }
    assert!(matches!(read(&store, &id).await, Attempt::Bad));
    assert_eq!(store.signals().counted(Count::BadObject), 2);
    // Written again for the ready case, they are sound.
    publish(&store, Publisher::Ready((&id).into()), "volume").await;
    assert!(matches!(read(&store, &id).await, Attempt::Read(_)));
}

#[tokio::test]
async fn whose_head_it_is_is_kept_apart() {
    let store = Store::in_memory(Options::default()).await.unwrap();
    let dicom = Upload {
        dicom: Some(store.spools().of("whose".into()).await.unwrap()),
        ..upload(&store, "volume", None).await
    };
    let submitted = store
        .submit(dicom, Parameters::default(), None, false)
        .await;
    let of_dicom = submitted.unwrap().case.id;
    let of_nifti = submit(&store, "volume").await.unwrap().case.id;
    for (id, expected) in [(of_dicom, Some(&b"whose"[..])), (of_nifti, None)] {
        let stored = store.source_dicom(&id).await.unwrap();
        assert_eq!(stored.as_deref(), expected);
    }
}

#[tokio::test]
async fn deletions_tell_whoever_remembers_and_keep_what_others_need() {
    let directory = tempfile::tempdir().unwrap();
    let store = store(&directory).await;
    let told: Arc<Mutex<Vec<CaseId>>> = Arc::default();
    let hook = Arc::clone(&told);
    store.on_delete(move |id| hook.lock().unwrap().push(*id));
    let plain = submit(&store, "volume").await.unwrap().case.id;
    let masked = upload(&store, "volume", Some("mask")).await;
    let masked = store
        .submit(masked, Parameters::default(), None, false)
        .await;
    let masked = masked.unwrap().case.id;
    let stored = |root: &Path| objects_below(&root.join("objects")).len();
    assert_eq!(stored(directory.path()), 4, "both have one volume");
    assert!(store.delete(&plain).await.unwrap());
    assert!(!store.delete(&plain).await.unwrap(), "it is gone");
    assert_eq!(stored(directory.path()), 3);
    assert!(store.delete(&masked).await.unwrap());
    assert_eq!(stored(directory.path()), 0);
    assert_eq!(*told.lock().unwrap(), [plain, masked]);
}

#[tokio::test]
async fn a_store_is_checked_and_says_whether_its_disk_is_full() {
    let directory = tempfile::tempdir().unwrap();
    for (min_free_bytes, is_full) in [(0, None), (u64::MAX, Some(true))] {
        let options = Options {
            min_free_bytes,
            ..Options::default()
        };
        let store = Store::open(directory.path(), options).await.unwrap();
        let checked = store.check().await;
        assert_eq!(checked.err().map(|error| error.is_full()), is_full);
        store.close().await;
    }
}
