//! Rows and objects that do not belong together: nothing is written, whatever the mistake was.

use std::path::PathBuf;

use super::*;
use crate::identity;
use crate::label::Label;
use crate::testing::postgres::PostgresServer;
use crate::testing::s3::{BUCKET, S3Server};

/// A store in a folder, as serving processes open it.
fn location(folder: &Path) -> Location {
    Location::from(folder)
}

async fn open_by(location: &Location, opening: Opening) -> Result<Store, StoreError> {
    let options = Options {
        opening,
        ..Options::default()
    };
    Store::open(location.clone(), options).await
}

async fn open(location: &Location, may_make: bool) -> Result<Store, StoreError> {
    let opening = match may_make {
        true => Opening::OrMake,
        false => Opening::Existing,
    };
    open_by(location, opening).await
}

/// Makes a store; its id.
async fn made(location: &Location) -> StoreId {
    let store = open(location, true).await.unwrap();
    let id = store.id().await.unwrap();
    store.close().await;
    id
}

/// Every file below some folders, with its bytes but for the log of SQLite.
fn state(folders: &[&Path]) -> Vec<(PathBuf, Vec<u8>)> {
    let files = folders.iter().flat_map(|folder| files_below(folder));
    let kept = files.filter(|file| {
        let name = file.file_name().unwrap().to_string_lossy();
        name != "lock" && !name.starts_with("rows.sqlite-")
    });
    kept.map(|file| (file.clone(), std::fs::read(file).unwrap()))
        .collect()
}

fn mismatch(opened: Result<Store, StoreError>) -> Mismatch {
    match opened {
        Err(StoreError::Mismatch(found)) => found,
        other => panic!("{other:?}"),
    }
}

#[tokio::test]
async fn a_store_is_made_only_by_whoever_may_make_one() {
    let root = tempfile::tempdir().unwrap();
    let folder = root.path().join("store");
    let elsewhere = Location {
        database: Some(DatabaseAddress::Sqlite(root.path().join("rows.sqlite"))),
        objects: Some(ObjectsAddress::Folder(root.path().join("objects"))),
        ..location(&folder)
    };
    for missing in [&location(&folder), &elsewhere] {
        let refused = open(missing, false).await;
        assert!(
            matches!(refused, Err(StoreError::NoStore(_))),
            "{refused:?}"
        );
        assert_eq!(std::fs::read_dir(root.path()).unwrap().count(), 0);
    }
    let id = made(&location(&folder)).await;
    for create in [false, true] {
        let store = open(&location(&folder), create).await.unwrap();
        assert_eq!(store.id().await.unwrap(), id);
        store.close().await;
    }
    let label = std::fs::read_to_string(folder.join("objects/store-id")).unwrap();
    assert_eq!(label, format!("{id}\n"));
    assert_ne!(made(&elsewhere).await, id);
}

#[tokio::test]
async fn objects_that_are_not_there_are_missed_and_nothing_is_written() {
    let root = tempfile::tempdir().unwrap();
    let [folder, mounted, away] = ["store", "mounted", "away"].map(|name| root.path().join(name));
    let shared = |objects: &Path| Location {
        objects: Some(ObjectsAddress::Folder(objects.to_owned())),
        ..location(&folder)
    };
    let id = made(&shared(&mounted)).await;
    // Not mounted: an empty folder, or none. A mistyped address: the same, and a folder above or below the right one.
    std::fs::create_dir(&away).unwrap();
    let below = mounted.join("below");
    std::fs::create_dir(&below).unwrap();
    for wrong in [&away, &below, &root.path().to_owned()] {
        for create in [false, true] {
            let before = state(&[root.path()]);
            let found = mismatch(open(&shared(wrong), create).await);
            assert_eq!((found.rows, found.objects), (Some(id), Label::Missing));
            assert_eq!(state(&[root.path()]), before, "{wrong:?}");
        }
    }
    let nowhere = root.path().join("nowhere");
    let refused = open(&shared(&nowhere), false).await;
    assert!(
        matches!(refused, Err(StoreError::NoStore(_))),
        "{refused:?}"
    );
    assert!(!nowhere.exists());
    assert_eq!(
        mismatch(open(&shared(&nowhere), true).await).objects,
        Label::Missing
    );
    // The variable of another shell: objects of another store, or none where there were some.
    let other = root.path().join("other");
    let theirs = made(&location(&other)).await;
    let found = mismatch(open(&shared(&other.join("objects")), true).await);
    assert_eq!((found.rows, found.objects), (Some(id), Label::Id(theirs)));
    assert_eq!(
        mismatch(open(&location(&folder), true).await).objects,
        Label::Missing
    );
    let store = open(&shared(&mounted), false).await.unwrap();
    store.check().await.unwrap();
    store.close().await;
}

#[tokio::test]
async fn another_database_does_not_get_the_objects_of_a_store() {
    let root = tempfile::tempdir().unwrap();
    let [good, new, used] = ["good", "new", "used"].map(|name| root.path().join(name));
    let id = made(&location(&good)).await;
    let theirs = made(&location(&used)).await;
    std::fs::create_dir(&new).unwrap();
    let on = |database: Option<PathBuf>, folder: &Path| Location {
        database: database.map(DatabaseAddress::Sqlite),
        objects: Some(ObjectsAddress::Folder(good.join("objects"))),
        ..location(folder)
    };
    // A fresh folder, a mistyped file, an empty file, a database of another store; each with and without the right to make one.
    let empty = root.path().join("empty.sqlite");
    std::fs::write(&empty, "").unwrap();
    for wrong in [
        on(None, &new),
        on(Some(root.path().join("typo.sqlite")), &new),
        on(Some(empty), &new),
    ] {
        let before = state(&[root.path()]);
        let refused = open(&wrong, false).await;
        assert!(
            matches!(refused, Err(StoreError::NoStore(_))),
            "{refused:?}"
        );
        let found = mismatch(open(&wrong, true).await);
        assert_eq!((found.rows, found.objects), (None, Label::Id(id)));
        assert_eq!(state(&[root.path()]), before);
    }
    for wrong in [on(None, &used), on(Some(used.join("rows.sqlite")), &new)] {
        let before = state(&[&good]);
        for create in [false, true] {
            let found = mismatch(open(&wrong, create).await);
            assert_eq!((found.rows, found.objects), (Some(theirs), Label::Id(id)));
        }
        assert_eq!(state(&[&good]), before);
    }
}

#[tokio::test]
async fn a_pair_that_was_half_made_is_completed_once_and_by_whoever_may_make_one() {
    let root = tempfile::tempdir().unwrap();
    let folder = root.path().join("store");
    let file = folder.join("rows.sqlite");
    std::fs::create_dir_all(folder.join("objects")).unwrap();
    // Killed after the tables, and after the row.
    Rows::sqlite(&file, Arc::new(()))
        .await
        .unwrap()
        .database
        .close()
        .await;
    let refused = mismatch(open(&location(&folder), false).await);
    assert_eq!((refused.rows, refused.objects), (None, Label::Missing));
    let rows = Rows::sqlite(&file, Arc::new(())).await.unwrap();
    let id = rows.make_store_id(StoreId::new()).await.unwrap();
    assert_eq!(rows.make_store_id(StoreId::new()).await.unwrap(), id);
    rows.database.close().await;
    let refused = mismatch(open(&location(&folder), false).await);
    assert_eq!((refused.rows, refused.objects), (Some(id), Label::Missing));
    // Files that are not of a store belong to somebody.
    let foreign = folder.join("objects/README");
    std::fs::write(&foreign, "theirs").unwrap();
    mismatch(open(&location(&folder), true).await);
    std::fs::remove_file(foreign).unwrap();
    assert_eq!(made(&location(&folder)).await, id);
    // It was whole: now the folder is not mounted, and there is nothing to complete.
    std::fs::remove_file(folder.join("objects/store-id")).unwrap();
    let refused = mismatch(open(&location(&folder), true).await);
    assert_eq!((refused.rows, refused.objects), (Some(id), Label::Missing));
}

#[tokio::test]
async fn rows_of_cases_without_an_id_are_not_given_one() {
    let root = tempfile::tempdir().unwrap();
    let folder = root.path().join("store");
    let store = open(&location(&folder), true).await.unwrap();
    submit(&store, "volume").await.unwrap();
    store.close().await;
    let options = sqlx::sqlite::SqliteConnectOptions::new().filename(folder.join("rows.sqlite"));
    let mut connection = sqlx::ConnectOptions::connect(&options).await.unwrap();
    sqlx::query("DELETE FROM store")
        .execute(&mut connection)
        .await
        .unwrap();
    sqlx::Connection::close(connection).await.unwrap();
    let away = root.path().join("away");
    std::fs::rename(folder.join("objects"), &away).unwrap();
    let found = mismatch(open(&location(&folder), true).await);
    assert_eq!((found.rows, found.objects), (None, Label::Missing));
    assert_eq!(files_below(&folder.join("objects")), Vec::<PathBuf>::new());
}

#[tokio::test]
async fn a_damaged_label_is_refused_and_the_right_one_heals_it() {
    let root = tempfile::tempdir().unwrap();
    let id = made(&location(root.path())).await;
    let file = root.path().join("objects/store-id");
    let whole = std::fs::read_to_string(&file).unwrap();
    let other = StoreId::new();
    for (text, label) in [
        (String::new(), Label::Damaged),
        (whole[..20].to_owned(), Label::Damaged),
        ("\0".repeat(whole.len()), Label::Damaged),
        (whole.replace('-', ""), Label::Id(id)),
        (format!("{other}\n"), Label::Id(other)),
        (format!("{whole}{whole}{whole}"), Label::Damaged),
    ] {
        std::fs::write(&file, &text).unwrap();
        let opened = open(&location(root.path()), true).await;
        match label == Label::Id(id) {
            // The same id in other words.
            true => opened.unwrap().close().await,
            false => assert_eq!(mismatch(opened).objects, label, "{text:?}"),
        }
        assert_eq!(std::fs::read_to_string(&file).unwrap(), text);
    }
    std::fs::write(&file, whole).unwrap();
    open(&location(root.path()), false).await.unwrap();
}

#[tokio::test]
async fn a_copy_keeps_the_id_until_it_gets_its_own_and_an_interruption_is_made_good() {
    let root = tempfile::tempdir().unwrap();
    let [original, copy] = ["original", "copy"].map(|name| root.path().join(name));
    let id = made(&location(&original)).await;
    std::fs::create_dir_all(copy.join("objects")).unwrap();
    for name in ["rows.sqlite", "objects/store-id"] {
        std::fs::copy(original.join(name), copy.join(name)).unwrap();
    }
    let store = open_by(&location(&copy), Opening::WithNewId).await.unwrap();
    let second = store.id().await.unwrap();
    assert_ne!(second, id);
    store.close().await;
    // From now on, neither opens with the objects of the other.
    let crossed = Location {
        objects: Some(ObjectsAddress::Folder(original.join("objects"))),
        ..location(&copy)
    };
    mismatch(open(&crossed, true).await);
    mismatch(open_by(&crossed, Opening::WithNewId).await);
    assert_eq!(made(&location(&original)).await, id);
    // Killed after the object, and after the row.
    let label = copy.join("objects/store-id");
    let third = StoreId::new();
    let changing = Label::Changing {
        from: second,
        to: third,
    };
    std::fs::write(&label, changing.text()).unwrap();
    let found = mismatch(open(&location(&copy), true).await);
    assert_eq!((found.rows, found.objects), (Some(second), changing));
    let store = open_by(&location(&copy), Opening::WithNewId).await.unwrap();
    assert_eq!(store.id().await.unwrap(), third);
    store.close().await;
    let changing = Label::Changing {
        from: second,
        to: third,
    };
    std::fs::write(&label, changing.text()).unwrap();
    assert_eq!(made(&location(&copy)).await, third);
}

#[tokio::test]
async fn without_the_right_objects_a_store_writes_claims_and_removes_nothing() {
    let directory = tempfile::tempdir().unwrap();
    let store = store(&directory).await;
    let known = submit(&store, "volume").await.unwrap().case.id;
    let [objects, away] = ["objects", "away"].map(|name| directory.path().join(name));
    std::fs::rename(&objects, &away).unwrap();
    let is_refused = |error: &StoreError| matches!(error, StoreError::Mismatch(_));
    // The folder is not mounted; another one is mounted in its place.
    for other in [None, Some(StoreId::new())] {
        std::fs::create_dir(&objects).unwrap();
        if let Some(id) = other {
            std::fs::write(objects.join("store-id"), format!("{id}\n")).unwrap();
        }
        let before = state(&[&objects]);
        let checked = store.check().await.unwrap_err();
        assert!(is_refused(&checked), "{checked:?}");
        let written = submit(&store, "another volume").await.unwrap_err();
        assert!(is_refused(&written), "{written:?}");
        let claimed = store.claim(JobKind::PREPARE, 3).await.unwrap_err();
        assert!(is_refused(&claimed), "{claimed:?}");
        let deleted = store.delete(&known).await.unwrap_err();
        assert!(is_refused(&deleted), "{deleted:?}");
        let name = crate::testing::name(ObjectKind::Volume, "unreferenced");
        let swept = upkeep::remove_unreferenced(&store, &[name])
            .await
            .unwrap_err();
        assert!(is_refused(&swept), "{swept:?}");
        assert_eq!(state(&[&objects]), before);
        std::fs::remove_dir_all(&objects).unwrap();
    }
    std::fs::rename(&away, &objects).unwrap();
    store.check().await.unwrap();
    let claimed = claim(&store).await.unwrap();
    assert_eq!((claimed.case, claimed.attempt), (Some(known), 1));
}

/// Whatever rows and objects are kept in, they find each other, and two that start at once are one store.
async fn they_become_one_store(rows: [Rows; 2], objects: [Objects; 2]) -> StoreId {
    let [one, other] = [(&rows[0], &objects[0]), (&rows[1], &objects[1])];
    let both = tokio::join!(
        identity::compare_or_make(one.0, one.1),
        identity::compare_or_make(other.0, other.1)
    );
    let id = both.0.unwrap();
    assert_eq!(both.1.unwrap(), id);
    assert_eq!(identity::compare(&rows[0], &objects[1]).await.unwrap(), id);
    // Somebody else's rows.
    let others = Rows::in_memory(Arc::new(())).await.unwrap();
    let refused = identity::compare_or_make(&others, &objects[0]).await;
    assert!(
        matches!(refused, Err(StoreError::Mismatch(_))),
        "{refused:?}"
    );
    assert_eq!(others.store_id().await.unwrap(), None);
    let changed = identity::change(&rows[0], &objects[0]).await.unwrap();
    assert_ne!(changed, id);
    assert_eq!(
        identity::compare(&rows[1], &objects[1]).await.unwrap(),
        changed
    );
    changed
}

#[tokio::test]
async fn rows_and_objects_of_any_kind_become_one_store() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("rows.sqlite");
    let rows = [
        Rows::sqlite(&file, Arc::new(())).await.unwrap(),
        Rows::sqlite(&file, Arc::new(())).await.unwrap(),
    ];
    let folder = directory.path().join("objects");
    let objects = [(); 2].map(|()| Objects::in_directory(&folder).unwrap());
    they_become_one_store(rows, objects).await;
    let memory: Arc<object_store::memory::InMemory> = Arc::default();
    let rows = Rows::in_memory(Arc::new(())).await.unwrap();
    let objects = [(); 2].map(|()| Objects::new(Arc::clone(&memory) as _));
    they_become_one_store([rows.clone(), rows], objects).await;
}

#[tokio::test]
async fn a_database_and_a_bucket_become_one_store_and_what_is_away_is_not_missing() {
    let (Some(mut postgres), Some(mut s3)) =
        (PostgresServer::start().await, S3Server::start().await)
    else {
        return;
    };
    let owned = |(name, value): (&str, String)| (name.to_owned(), value);
    let variables = s3.variables().map(owned).into();
    let bucket = |prefix: &str| Objects::in_bucket_with(BUCKET, prefix, &variables).unwrap();
    let address = postgres.database().await;
    let database = async || Rows::postgres(address.parse().unwrap(), Arc::new(())).await;
    let rows = [database().await.unwrap(), database().await.unwrap()];
    let id = they_become_one_store(rows, [bucket("a/b"), bucket("a/b")]).await;
    let rows = database().await.unwrap();
    rows.complete_store_id().await.unwrap();
    // Mistyped prefixes: one that is empty, those above and below, another case of the letters, none.
    for prefix in ["a/c", "a", "a/b/c", "A/B", ""] {
        match identity::compare_or_make(&rows, &bucket(prefix)).await {
            Err(StoreError::Mismatch(found)) => {
                assert_eq!((found.rows, found.objects), (Some(id), Label::Missing));
            }
            other => panic!("{prefix}: {other:?}"),
        }
    }
    assert_eq!(bucket("").label().await.unwrap(), Label::Missing);
    s3.stop();
    let away = identity::compare_or_make(&rows, &bucket("a/b"))
        .await
        .unwrap_err();
    assert!(away.is_away(), "{away:?}");
    assert!(away.cause().contains("refused"), "{}", away.cause());
    postgres.stop();
    let away = database().await.unwrap_err();
    assert!(away.is_away(), "{away:?}");
    // Its socket is gone, or nobody listens on it.
    let causes = ["refused", "No such file"];
    assert!(
        causes.iter().any(|cause| away.cause().contains(cause)),
        "{}",
        away.cause()
    );
    // The pool names the same cause, and not only that it waited.
    let away = rows.database.check().await.unwrap_err();
    assert!(
        away.is_away() && !away.cause().contains("pool"),
        "{}",
        away.cause()
    );
}
