//! Checking, moving, backing up and restoring a store, by the commands of `docs/install.md`.

use std::path::{Path, PathBuf};

use storage::testing::files_below;
use storage::testing::postgres::PostgresServer;

use crate::command_line::{done, run};
use crate::head::plain_head;

fn object(folder: &Path, kind: &str) -> PathBuf {
    let mut files = files_below(&folder.join(kind));
    files.pop().expect("an object of this kind")
}

#[test]
fn a_folder_without_a_store_is_an_error_and_stays_as_it_is() {
    let root = tempfile::tempdir().unwrap();
    let path = |name: &str| root.path().join(name).display().to_string();
    let (missing, empty) = (path("missing"), path("empty"));
    std::fs::create_dir(&empty).unwrap();
    let database = format!("sqlite://{}", path("rows.sqlite"));
    let elsewhere = format!("{database},file://{empty}");
    let id = "0".repeat(32);
    for folder in [&missing, &empty] {
        for command in [
            &["check-store", "--data", folder][..],
            &["check-store", "--data", folder, "--repair"],
            &["check-store", "--data", folder, "--database", &database],
            &["remove-expired", "--data", folder, "--keep-days", "1"],
            &["migrate-store", "--from", folder, "--to", &path("copy")],
            &["migrate-store", "--from", &elsewhere, "--to", &path("copy")],
            &["render", &id, "--data", folder, "--output", &path("a.png")],
        ] {
            let (status, said) = run(command);
            assert_eq!(status, Some(78), "{command:?}: {said}");
            assert!(said.contains("there is no store here"), "{said}");
        }
    }
    assert!(files_below(root.path()).is_empty() && !Path::new(&missing).exists());
    assert_eq!(std::fs::read_dir(root.path()).unwrap().count(), 1);
}

#[tokio::test]
async fn a_store_is_moved_checked_repaired_and_restored() {
    let root = tempfile::tempdir().unwrap();
    let path = |name: &str| root.path().join(name).display().to_string();
    let (volume, first, objects, restored) = (
        path("head.nii"),
        path("first"),
        path("objects"),
        path("restored"),
    );
    std::fs::write(&volume, plain_head().bytes()).unwrap();
    let id = done(&["prepare", &volume, "--data", &first]);
    let id = id.lines().next().unwrap().to_owned();
    // Without an age, no case goes: it is about the clock alone.
    let (status, said) = run(&["remove-expired", "--data", &first]);
    assert_eq!(status, Some(2), "{said}");
    assert!(done(&["remove-expired", "--data", &first, "--yes"]).contains("removed: 0 cases"));
    let picture = |data: &str| {
        let output = path("picture.png");
        done(&[
            "render", &id, "--depth", "8", "--data", data, "--output", &output,
        ]);
        std::fs::read(output).unwrap()
    };
    let before = picture(&first);

    // To a database and objects elsewhere; a second run finds all of it there.
    let postgres = PostgresServer::start().await;
    let database = match &postgres {
        Some(postgres) => postgres.database().await,
        None => format!("sqlite://{}", path("rows.sqlite")),
    };
    let second = format!("{database},file://{objects}");
    let copied = done(&["migrate-store", "--from", &first, "--to", &second]);
    assert!(copied.contains("copied: 1 cases, 8 objects"), "{copied}");
    let copied = done(&["migrate-store", "--from", &first, "--to", &second]);
    assert!(
        copied.contains(" 0 objects, 0 bytes; already there: 8 objects"),
        "{copied}"
    );

    // Everything that is wrong is named, and what can be repaired is.
    let address = format!("file://{objects}");
    let scratch = path("scratch");
    let check = [
        "check-store",
        "--database",
        &database,
        "--objects",
        &address,
        "--data",
        &scratch,
    ];
    let repair = [&check[..], &["--repair"]].concat();
    assert!(done(&check).contains("read: 1 cases, 8 objects"));
    let folder = Path::new(&objects);
    let mut damaged = std::fs::read(object(folder, "forest")).unwrap();
    damaged[100] ^= 1;
    std::fs::write(object(folder, "forest"), damaged).unwrap();
    std::fs::remove_file(object(folder, "envelope")).unwrap();
    let stray = folder.join("mask/00").join("0".repeat(64));
    std::fs::create_dir_all(stray.parent().unwrap()).unwrap();
    std::fs::write(&stray, b"stray").unwrap();
    let (status, found) = run(&check);
    assert_eq!(status, Some(74), "{found}");
    for line in [
        "damaged: forest of case",
        "missing: envelope of case",
        "unreferenced: mask/0000",
    ] {
        assert!(found.contains(line), "{line}: {found}");
    }
    assert!(done(&repair).contains("rebuilt: case"));
    assert!(stray.exists(), "a repair deletes nothing");
    std::fs::remove_file(&stray).unwrap();
    done(&check);

    // Back into a folder: the same pictures.
    done(&["migrate-store", "--from", &second, "--to", &restored]);
    done(&["check-store", "--data", &restored]);
    assert!(picture(&restored) == before);

    // A source that is lost is named, and the case is not copied.
    std::fs::remove_file(object(folder, "source-volume")).unwrap();
    let (status, found) = run(&repair);
    assert!(
        status == Some(74) && found.contains("missing: source-volume"),
        "{found}"
    );
    let (status, copied) = run(&["migrate-store", "--from", &second, "--to", &path("third")]);
    assert!(
        status == Some(74) && copied.contains("not copied"),
        "{copied}"
    );
}
