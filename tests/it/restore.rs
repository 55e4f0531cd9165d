//! A database that is restored from a backup, folders that are away for a while, and databases that name other objects.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, SystemTime};

use axum::body::Body;
use axum::http::{Method, Request, StatusCode, header};
use cases::Adopted;
use pacs::{ArrivalOptions, start_series_reader};
use storage::testing::files_below;

use crate::command_line::{done, run};
use crate::dicom::{head_slices, reader};
use crate::head::{mask_of, plain_head};
use crate::pacs::stow;
use crate::series_builder::{Syntax, files};
use crate::server::{Server, form, form_type};
use crate::until::until;

/// The files of the database in the folder of a store, with their contents.
fn saved_rows(store: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    // Files that two readings in a row found alike are of one moment: the server may be writing.
    let mut rows = read_rows(store);
    loop {
        let again = read_rows(store);
        if again == rows {
            return rows;
        }
        rows = again;
    }
}

fn read_rows(store: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let files = std::fs::read_dir(store).unwrap();
    let paths = files.map(|file| file.unwrap().path());
    let is_of_rows = |path: &PathBuf| {
        let name = path.file_name().unwrap().to_str().unwrap();
        // The index of the log is made again by whoever opens the database first.
        name.starts_with("rows.") && !name.ends_with("-shm")
    };
    let mut rows: Vec<_> = paths
        .filter(is_of_rows)
        .map(|path| (path.clone(), read_elsewhere(&path)))
        .collect();
    rows.sort();
    rows
}

/// The contents of a file, read by another process: POSIX ends all locks of a process on a file that it closes (fcntl(2)), also those
/// that the database of a server in this process holds.
fn read_elsewhere(path: &Path) -> Vec<u8> {
    let output = Command::new("cat").arg(path).output().unwrap();
    assert!(output.status.success(), "{output:?}");
    output.stdout
}

/// Puts the files of a database in place of those that are there.
fn restore_rows(store: &Path, rows: &[(PathBuf, Vec<u8>)]) {
    for (path, _) in read_rows(store) {
        std::fs::remove_file(path).unwrap();
    }
    for (path, contents) in rows {
        std::fs::write(path, contents).unwrap();
    }
}

async fn body(server: &Server, address: &str) -> Vec<u8> {
    let answer = server.get(address).await;
    assert_eq!(answer.status, StatusCode::OK, "{address}");
    answer.body.to_vec()
}

async fn add_layer(server: &Server, case: &str, volume: &[u8]) {
    let parameters = br#"{"name": "T2", "transform": "none"}"#;
    let request = Request::post(format!("{case}/layers"))
        .header(header::CONTENT_TYPE, form_type())
        .body(Body::from(form(&[
            ("volume", volume),
            ("parameters", parameters),
        ])));
    let answer = server.send(request.unwrap()).await;
    assert_eq!(answer.status, StatusCode::ACCEPTED, "{answer:?}");
}

async fn layers_of(server: &Server, case: &str) -> usize {
    let layers = server.get(&format!("{case}/layers")).await.json();
    let layers = layers["layers"].as_array().unwrap();
    layers.iter().filter(|layer| layer["name"] == "T2").count()
}

/// A version of a case with another closing radius; its address.
async fn version(server: &Server, case: &str) -> String {
    let address = format!("{case}/mask?closing_radius_mm=7.3");
    let answer = server.method(Method::PUT, &address).await;
    assert!(answer.status.is_success(), "{answer:?}");
    let version = answer.header("location").to_owned();
    server.until_ready(&version).await;
    version
}

// The server goes on while the test waits for a command: it may be in a transaction that the command waits for.
#[tokio::test(flavor = "multi_thread")]
async fn what_was_uploaded_after_a_backup_comes_back_and_what_was_deleted_does_not() {
    let server = Server::start().await;
    let head = plain_head();
    let (volume, mask) = (head.bytes(), mask_of(&head).bytes());
    let before = server.prepared(&[("volume", &volume)]).await;
    let store = server.directory().to_owned();
    let backup = saved_rows(&store);

    let with_mask = server
        .prepared(&[("volume", &volume), ("mask", &mask)])
        .await;
    add_layer(&server, &before, &volume).await;
    let version = version(&server, &before).await;
    let radius = br#"{"closing_radius_mm": 6}"#;
    let deleted = [
        ("volume", &volume[..]),
        ("mask", &mask),
        ("parameters", radius),
    ];
    let deleted = server.prepared(&deleted).await;
    assert!(
        server
            .method(Method::DELETE, &deleted)
            .await
            .status
            .is_success()
    );
    let all = [&before, &with_mask, &version];
    let mut meshes = Vec::new();
    for case in all {
        meshes.push(body(&server, &format!("{case}/mesh?depth_mm=8")).await);
    }

    let server = server.restart_with(|_| restore_rows(&store, &backup)).await;
    assert_eq!(server.get(&with_mask).await.status, StatusCode::NOT_FOUND);
    let folder = store.display().to_string();
    for repair in [&[][..], &["--repair"]] {
        let (status, said) = run(&[&["check-store", "--data", &folder], repair].concat());
        assert_eq!(status, Some(74), "{said}");
        assert!(said.contains("`--adopt`"), "{said}");
    }
    let said = done(&["check-store", "--data", &folder, "--adopt"]);
    assert!(
        said.contains("adopted: 2 cases, 1 layers, 0 images"),
        "{said}"
    );
    assert!(said.contains("gone since the backup: labels"), "{said}");
    for (case, mesh) in all.iter().zip(&meshes) {
        server.until_ready(case).await;
        assert!(body(&server, &format!("{case}/mesh?depth_mm=8")).await == *mesh);
    }
    assert_eq!(server.get(&deleted).await.status, StatusCode::NOT_FOUND);
    for case in [&before, &version] {
        assert_eq!(layers_of(&server, case).await, 1, "{case}");
    }
    // There is nothing more to adopt, and nothing is wrong.
    assert_eq!(
        server.state.cases.adopt().await.unwrap(),
        Adopted::default()
    );
    let said = done(&["check-store", "--data", &folder]);
    assert!(!said.contains("unreferenced: manifest"), "{said}");
}

#[tokio::test]
async fn images_that_came_after_a_backup_become_their_case() {
    let server = Server::start_with(|config| config.dicom_program = reader()).await;
    let store = server.directory().to_owned();
    let backup = saved_rows(&store);
    let images = files(&head_slices(), Syntax::Explicit);
    let sent = stow("/dicomweb/studies", crate::pacs::related(&images));
    assert_eq!(server.send(sent).await.status, StatusCode::OK);
    let server = server.restart_with(|_| restore_rows(&store, &backup)).await;
    let adopted = server.pacs.arrivals().adopt().await.unwrap();
    assert_eq!(adopted, (images.len(), Vec::new()));
    let options = ArrivalOptions {
        stable: Duration::ZERO,
        ..ArrivalOptions::default()
    };
    let _reader = start_series_reader(server.pacs.arrivals().clone(), options);
    let case = until("the images are a case", async || {
        let cases = server.get("/v1/cases").await.json();
        let id = cases["cases"][0]["id"].as_str()?.to_owned();
        Some(format!("/v1/cases/{id}"))
    });
    server.until_ready(&case.await).await;
}

#[tokio::test]
async fn a_folder_that_is_away_for_a_while_ends_no_case() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    let picture = format!("{case}/render?depth_mm=8&width=64&height=64");
    let expected = body(&server, &picture).await;
    // Nothing is in memory any more.
    let server = server.restart().await;
    let [there, away] = ["objects", "away"].map(|name| server.directory().join(name));
    std::fs::rename(&there, &away).unwrap();
    for _ in 0..3 {
        let answer = server.get(&picture).await;
        assert_eq!(answer.status, StatusCode::SERVICE_UNAVAILABLE, "{answer:?}");
        assert!(answer.headers.contains_key(header::RETRY_AFTER));
    }
    std::fs::remove_dir_all(&there).ok();
    std::fs::rename(&away, &there).unwrap();
    assert!(body(&server, &picture).await == expected);
    assert_eq!(server.get(&case).await.json()["state"], "ready");
}

/// Makes all files look a month old.
fn age(folder: &Path) {
    let month_ago = SystemTime::now() - Duration::from_secs(30 * 86_400);
    for file in files_below(folder) {
        let file = std::fs::File::options().write(true).open(file).unwrap();
        file.set_modified(month_ago).unwrap();
    }
}

#[test]
fn another_database_removes_nothing_of_a_folder() {
    let root = tempfile::tempdir().unwrap();
    let path = |name: &str| root.path().join(name).display().to_string();
    let (head, good, other) = (path("head.nii"), path("good"), path("other"));
    std::fs::write(&head, plain_head().bytes()).unwrap();
    done(&["prepare", &head, "--data", &good]);
    done(&[
        "prepare",
        &head,
        "--closing-radius-mm",
        "7",
        "--data",
        &other,
    ]);
    let objects = root.path().join("good/objects");
    age(&objects);
    let before = files_below(&objects);
    let address = format!("file://{}", objects.display());
    for options in [
        &["--repair"][..],
        &["--remove-unreferenced"],
        &["--repair", "--remove-unreferenced"],
    ] {
        let check = ["check-store", "--data", &other, "--objects", &address];
        let (status, said) = run(&[&check[..], options].concat());
        assert_ne!(status, Some(0), "{said}");
        assert!(before.iter().all(|file| file.exists()), "{options:?}");
    }
    done(&["check-store", "--data", &good]);
}

#[test]
fn old_objects_that_nothing_refers_to_are_removed_when_that_is_asked_for_alone() {
    let root = tempfile::tempdir().unwrap();
    let path = |name: &str| root.path().join(name).display().to_string();
    let (head, data) = (path("head.nii"), path("data"));
    std::fs::write(&head, plain_head().bytes()).unwrap();
    done(&["prepare", &head, "--data", &data]);
    let folder = root.path().join("data/objects/mask/00");
    std::fs::create_dir_all(&folder).unwrap();
    let [old, young] = ["0", "1"].map(|digit| folder.join(format!("00{}", digit.repeat(62))));
    std::fs::write(&old, b"old").unwrap();
    age(&folder);
    let check = |options: &[&str]| run(&[&["check-store", "--data", &data], options].concat());
    let (status, said) = check(&["--repair"]);
    assert!(status == Some(0) && old.exists(), "{said}");
    // Two of nine or ten are more than 5 %.
    let (status, said) = check(&["--remove-unreferenced"]);
    assert!(
        said.contains("1 objects, 3 bytes of at least 7 days"),
        "{said}"
    );
    assert!(
        status == Some(74) && said.contains("`--yes`") && old.exists(),
        "{said}"
    );
    // What came after the latest case may be an upload that the rows do not know.
    std::fs::write(&young, b"young").unwrap();
    let (status, said) = check(&["--remove-unreferenced", "--yes"]);
    assert!(
        status == Some(74) && said.contains("younger than every case"),
        "{said}"
    );
    assert!(old.exists() && young.exists());
    std::fs::remove_file(&young).unwrap();
    let (status, said) = check(&["--remove-unreferenced", "--yes"]);
    assert!(
        status == Some(0) && said.contains("removed: 1 objects"),
        "{said}"
    );
    assert!(!old.exists());
    done(&["check-store", "--data", &data]);
}
