//! Objects whose bytes are not those of their name.

use object_store::memory::InMemory;
use object_store::path::Path as ObjectPath;
use object_store::{ObjectStore, ObjectStoreExt as _};

use std::sync::Arc;

use bytes::Bytes;
use case::ObjectKind;

use super::*;

fn name(kind: ObjectKind, payload: &str) -> ObjectName {
    let digest = blake3::hash(payload.as_bytes());
    ObjectName { kind, digest }
}

fn damage(read: Result<Bytes, Unreadable>) -> String {
    match read {
        Err(Unreadable::Damaged(words)) => words,
        other => panic!("{other:?}"),
    }
}

#[tokio::test]
async fn bytes_under_the_name_of_others_are_found() {
    let objects = Objects::new(Arc::new(InMemory::new()));
    let [one, other] = ["one", "other"].map(|text| frame(ObjectKind::Mask, text.into()));
    objects.put(&one).await.unwrap();
    let framed = objects.get_framed(&one.name).await.unwrap();
    for (bytes, words) in [
        (framed.clone(), "its digest does not match its name"),
        (framed.slice(..50), "it ends in its header"),
        (
            Bytes::from_static(&[0; 100]),
            "it does not begin with the magic word",
        ),
    ] {
        objects.put_framed(&other.name, bytes).await.unwrap();
        assert_eq!(damage(objects.get(&other.name).await), words);
    }
    objects.put_framed(&one.name, framed).await.unwrap();
    assert_eq!(objects.get(&one.name).await.unwrap(), "one");
}

#[tokio::test]
async fn a_file_that_changes_after_it_was_hashed_is_found_when_it_is_read() {
    let directory = tempfile::tempdir().unwrap();
    let in_directory = Objects::in_directory(&directory.path().join("objects")).unwrap();
    let in_memory = Objects::new(Arc::new(InMemory::new()));
    for objects in [in_directory, in_memory] {
        let mut spool = Spool::begin(directory.path().to_owned()).await.unwrap();
        spool.write("a volume".into()).await.unwrap();
        let file = spool.finish().await.unwrap();
        let mut bytes = std::fs::read(file.path()).unwrap();
        *bytes.last_mut().unwrap() ^= 1;
        std::fs::write(file.path(), bytes).unwrap();
        let name = name(ObjectKind::SourceVolume, "a volume");
        objects.put_file(&name, &file).await.unwrap();
        assert_eq!(damage(objects.get(&name).await), "its payload is damaged");
    }
}

#[tokio::test]
async fn files_with_other_names_are_not_listed() {
    let files = Arc::new(InMemory::new());
    let objects = Objects::new(Arc::clone(&files) as Arc<dyn ObjectStore>);
    let framed = frame(ObjectKind::Mask, "mask".into());
    objects.put(&framed).await.unwrap();
    let digest = framed.name.digest.to_string();
    for other in [
        "README".to_owned(),
        format!("mask/{digest}"),
        format!("mask/zz/{digest}"),
        format!("hologram/{}/{digest}", &digest[..2]),
        format!("mask/{}/{digest}/more", &digest[..2]),
        format!("mask/{}/{digest}#1", &digest[..2]),
    ] {
        let bytes = Bytes::from_static(b"other");
        files
            .put(&ObjectPath::from(other), bytes.into())
            .await
            .unwrap();
    }
    assert_eq!(objects.list().await.unwrap(), [framed.name]);
}
