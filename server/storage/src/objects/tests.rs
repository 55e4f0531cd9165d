//! Objects whose bytes are not those of their name.

use object_store::memory::InMemory;
use object_store::path::Path as ObjectPath;
use object_store::{ObjectStore, ObjectStoreExt as _};

use std::sync::Arc;

use bytes::Bytes;
use case::ObjectKind;

use super::*;
use crate::testing::add_key;

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

#[tokio::test]
async fn with_a_key_objects_are_encrypted_and_those_of_before_are_read() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("keys");
    let files = Arc::new(InMemory::new());
    let open =
        |keys: Keys| Objects::new(Arc::clone(&files) as Arc<dyn ObjectStore>).with_keys(keys);
    let [before, after] = ["before", "after"].map(|text| frame(ObjectKind::Mask, text.into()));
    let without = open(Keys::default());
    without.put(&before).await.unwrap();
    let first = add_key(&file);
    let objects = open(Keys::read(&file).unwrap());
    objects.put(&after).await.unwrap();
    for (framed, text, key) in [(&before, "before", None), (&after, "after", Some(first))] {
        assert_eq!(objects.get(&framed.name).await.unwrap(), text);
        assert_eq!(objects.key_of(&framed.name).await, Some(key));
        let stored = files.get(&framed.name.path()).await.unwrap();
        let stored = stored.bytes().await.unwrap();
        let is_plain = stored
            .windows(text.len())
            .any(|some| some == text.as_bytes());
        assert_eq!(is_plain, key.is_none());
    }
    // Without the key it is not damaged, and can be read again with it.
    let second = directory.path().join("other");
    add_key(&second);
    for keys in [Keys::default(), Keys::read(&second).unwrap()] {
        let read = open(keys).get(&after.name).await;
        let Err(Unreadable::Store(error @ ObjectError::NoKey(id))) = read else {
            panic!("{read:?}");
        };
        assert_eq!(id, first);
        let error = crate::StoreError::from(error);
        assert!(error.is_away(), "{error:?}");
        assert!(error.to_string().contains(&first.to_string()), "{error}");
    }
    // Another key comes first: both are read, and a process that runs writes with it.
    let newer = add_key(&file);
    objects.put(&before).await.unwrap();
    assert_eq!(objects.key_of(&before.name).await, Some(Some(newer)));
    assert_eq!(objects.get(&after.name).await.unwrap(), "after");
    assert_eq!(objects.named_keys().await.unwrap().len(), 2);
    // A damaged one is told as such, wherever the damage is.
    let sound = files.get(&after.name.path()).await.unwrap();
    let sound = sound.bytes().await.unwrap();
    for at in [0, 8, 16, 24, 40, 64, 80, sound.len() - 1] {
        let mut bytes = sound.to_vec();
        bytes[at] ^= 1;
        let path = after.name.path();
        files.put(&path, bytes.into()).await.unwrap();
        damage(objects.get(&after.name).await);
    }
}

#[tokio::test]
async fn a_spooled_file_is_encrypted_while_it_is_copied() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("keys");
    add_key(&file);
    let objects = Objects::in_directory(&directory.path().join("objects")).unwrap();
    let objects = objects.with_keys(Keys::read(&file).unwrap());
    let mut spool = Spool::begin(directory.path().to_owned()).await.unwrap();
    spool.write("the volume of a head".into()).await.unwrap();
    let spooled = spool.finish().await.unwrap();
    let name = name(ObjectKind::SourceVolume, "the volume of a head");
    objects.put_file(&name, &spooled).await.unwrap();
    assert_eq!(objects.get(&name).await.unwrap(), "the volume of a head");
    let place = directory.path().join("objects").join(name.path().as_ref());
    let stored = std::fs::read(&place).unwrap();
    assert!(stored.starts_with(b"ISOCENC\n"));
    assert!(!stored.windows(4).any(|some| some == b"head"));
    // A file that is cut meanwhile leaves nothing.
    std::fs::remove_file(&place).unwrap();
    let cut = std::fs::read(spooled.path()).unwrap();
    std::fs::write(spooled.path(), &cut[..cut.len() - 1]).unwrap();
    let failed = objects.put_file(&name, &spooled).await;
    assert!(matches!(failed, Err(ObjectError::Disk(_))), "{failed:?}");
    assert!(matches!(objects.get(&name).await, Err(Unreadable::Missing)));
}
