//! Keys of a store: begun with, changed, missed, and left.

use crate::testing::add_key;
use crate::{KeyId, Keys, Location};

use super::*;

async fn open(directory: &TempDir, keys: Keys) -> Result<Store, StoreError> {
    let location = Location {
        keys,
        ..Location::from(&*directory.path().join("store"))
    };
    Store::open_at(&location, Options::default()).await
}

/// The key of each object on the disk.
fn keys_of(directory: &TempDir) -> Vec<Option<String>> {
    let objects = directory.path().join("store/objects");
    let files = files_below(&objects);
    let is_object = |file: &std::path::PathBuf| !file.starts_with(objects.join("keys"));
    let mut keys: Vec<_> = files
        .into_iter()
        .filter(is_object)
        .map(|file| {
            let bytes = std::fs::read(file).unwrap();
            let is_sealed = bytes.starts_with(b"ISOCENC\n");
            is_sealed.then(|| {
                bytes[24..32]
                    .iter()
                    .map(|byte| format!("{byte:02x}"))
                    .collect()
            })
        })
        .collect();
    keys.sort();
    keys.dedup();
    keys
}

fn only(key: KeyId) -> Vec<Option<String>> {
    vec![Some(key.to_string())]
}

fn ignore(_: &Rekeyed) {}

#[tokio::test]
async fn a_store_gets_a_key_and_another_one_and_none() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("keys");
    let plain = open(&directory, Keys::default()).await.unwrap();
    let id = ready(&plain, "volume").await;
    assert_eq!(keys_of(&directory), [None]);

    // New objects are encrypted, old ones read.
    let first = add_key(&file);
    let store = open(&directory, Keys::read(&file).unwrap()).await.unwrap();
    let second_case = ready(&store, "another volume").await;
    assert_eq!(keys_of(&directory).len(), 2);
    let inspected = store.inspect(&mut |finding| panic!("{finding:?}")).await;
    let inspected = inspected.unwrap();
    let of_first = 1 + ObjectKind::DERIVED.len() as u64;
    assert_eq!(
        (inspected.objects, inspected.to_rekey),
        (2 * of_first, of_first)
    );

    // All become encrypted; once more does nothing.
    let rekeyed = store.rekey(&mut ignore).await.unwrap();
    assert_eq!((rekeyed.written, rekeyed.kept), (of_first, of_first));
    assert_eq!((rekeyed.key, rekeyed.retired), (Some(first), vec![]));
    assert_eq!(keys_of(&directory), only(first));
    let again = store.rekey(&mut ignore).await.unwrap();
    assert_eq!((again.written, again.kept), (0, 2 * of_first));

    // Another key. The running process knows it from the file.
    let second = add_key(&file);
    let rekeyed = store.rekey(&mut ignore).await.unwrap();
    assert_eq!((rekeyed.written, rekeyed.kept), (2 * of_first, 0));
    assert_eq!(rekeyed.retired, [first]);
    assert_eq!(keys_of(&directory), only(second));
    for id in [id, second_case] {
        assert!(matches!(read(&store, &id).await, Attempt::Read(_)));
    }
    assert_eq!(store.inspect(&mut |_| ()).await.unwrap().to_rekey, 0);

    // The first is needed no more, the second is.
    let text = std::fs::read_to_string(&file).unwrap();
    let (newest, oldest) = text.split_once('\n').unwrap();
    std::fs::write(&file, oldest).unwrap();
    let refused = open(&directory, Keys::read(&file).unwrap()).await;
    assert!(matches!(refused, Err(StoreError::NoKey(key)) if key == second));
    let refused = open(&directory, Keys::default()).await.unwrap_err();
    assert!(
        refused.to_string().contains("storage.key_file"),
        "{refused}"
    );
    // A running process without it reports no damage, and rebuilds nothing.
    let decode = Arc::new(|_: &CaseFacts, _: &[Bytes]| Some(()));
    let unread = store.read_derived(&id, VOLUME, &decode).await;
    assert!(matches!(unread, Err(StoreError::NoKey(_))), "{unread:?}");
    let bad = store.counters().bad_objects;
    assert_eq!(bad, 0);
    let stopped = store.inspect(&mut |finding| panic!("{finding:?}")).await;
    assert!(matches!(stopped, Err(StoreError::NoKey(_))));

    // Encryption ends.
    std::fs::write(&file, format!("none\n{newest}\n")).unwrap();
    let rekeyed = store.rekey(&mut ignore).await.unwrap();
    assert_eq!((rekeyed.key, rekeyed.written), (None, 2 * of_first));
    assert_eq!(rekeyed.retired, [second]);
    assert_eq!(keys_of(&directory), [None]);
    let plain = open(&directory, Keys::default()).await.unwrap();
    assert!(matches!(read(&plain, &id).await, Attempt::Read(_)));
    assert_nothing_left_over(&plain, &directory.path().join("store")).await;
}

#[tokio::test]
async fn a_damaged_object_keeps_its_key_and_the_others_get_the_new_one() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("keys");
    let first = add_key(&file);
    let store = open(&directory, Keys::read(&file).unwrap()).await.unwrap();
    let id = ready(&store, "volume").await;
    let names = store.case_objects(&id).await.unwrap();
    let damaged = names.iter().find(|name| name.kind == ObjectKind::Forest);
    let damaged = *damaged.unwrap();
    let place = directory
        .path()
        .join("store/objects")
        .join(damaged.path().as_ref());
    let mut bytes = std::fs::read(&place).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    std::fs::write(&place, bytes).unwrap();
    let second = add_key(&file);
    let rekeyed = store.rekey(&mut ignore).await.unwrap();
    assert_eq!(rekeyed.damaged, [damaged]);
    assert_eq!(rekeyed.written, names.len() as u64 - 1);
    assert!(rekeyed.retired.is_empty(), "the first key is not given up");
    // It is made again with the new key, and then the first is needed no more.
    let framed = frame(ObjectKind::Forest, "forest of volume".into());
    assert_eq!(framed.name, damaged);
    store.objects().put(&framed).await.unwrap();
    let rekeyed = store.rekey(&mut ignore).await.unwrap();
    assert_eq!((rekeyed.written, rekeyed.retired), (0, vec![first]));
    assert_eq!(keys_of(&directory), only(second));
}

#[tokio::test]
async fn a_copy_has_the_key_of_its_own_store() {
    let directory = tempfile::tempdir().unwrap();
    let [one, other] = ["one", "other"].map(|name| directory.path().join(name));
    let first = add_key(&one);
    let store = open(&directory, Keys::read(&one).unwrap()).await.unwrap();
    let id = ready(&store, "volume").await;
    assert_eq!(keys_of(&directory), only(first));
    let second = add_key(&other);
    for (keys, expected) in [
        (Keys::default(), vec![None]),
        (Keys::read(&other).unwrap(), only(second)),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let target = open(&folder, keys).await.unwrap();
        let copied = store.copy_into(&target, &mut |_, _| ()).await.unwrap();
        assert_eq!((copied.cases, copied.lost), (1, 0));
        assert_eq!(keys_of(&folder), expected);
        assert!(matches!(read(&target, &id).await, Attempt::Read(_)));
    }
}

#[tokio::test]
async fn an_interrupted_change_goes_on_and_nothing_comes_back() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("keys");
    let plain = open(&directory, Keys::default()).await.unwrap();
    let kept = ready(&plain, "volume").await;
    let deleted = ready(&plain, "another volume").await;
    let key = add_key(&file);
    let store = open(&directory, Keys::read(&file).unwrap()).await.unwrap();
    // It was interrupted after some of the objects.
    let names = store.objects().list().await.unwrap();
    let mut some = Rekeyed {
        key: Some(key),
        ..Rekeyed::default()
    };
    store.rekey_some(&names[..3], &mut some).await.unwrap();
    assert_eq!(some.written, 3);
    // A case is deleted between reading the list and the objects.
    assert!(plain.delete(&deleted).await.unwrap());
    store.rekey_some(&names, &mut some).await.unwrap();
    let rekeyed = store.rekey(&mut ignore).await.unwrap();
    assert_eq!(rekeyed.written, 0);
    assert_eq!(keys_of(&directory), only(key));
    let needed = store.objects_of(&kept).await.unwrap();
    assert_eq!(store.objects().list().await.unwrap().len(), needed.len());
}
