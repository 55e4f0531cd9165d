//! A store knows itself: the mistakes of an operator with its folder, its database and its address, by the commands and a running server.

use std::path::{Path, PathBuf};
use std::process::Command;

use storage::testing::files_below;
use storage::testing::postgres::PostgresServer;

use crate::command_line::{done, run};
use crate::head::plain_head;
use crate::operation::{Logged, get, post};
use crate::server::{form, form_type};
use crate::several_machines::program;

/// A folder with stores.
struct Place(tempfile::TempDir);

impl Place {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn text(&self, name: &str) -> String {
        self.path(name).display().to_string()
    }

    /// A store with a case; the id of the case.
    fn prepared(&self, name: &str) -> String {
        let volume = self.text("head.nii");
        std::fs::write(&volume, plain_head().bytes()).unwrap();
        let said = done(&["prepare", &volume, "--data", &self.text(name)]);
        said.lines().next().unwrap().to_owned()
    }
}

/// The files of a folder but for the database.
fn state(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let files = files_below(folder).into_iter();
    let kept = files.filter(|file| {
        let name = file.file_name().unwrap().to_string_lossy();
        // Whoever opens a database writes its log into it.
        name != "lock" && !name.starts_with("rows.sqlite")
    });
    kept.map(|file| (file.clone(), std::fs::read(file).unwrap()))
        .collect()
}

/// Every command that opens a store is refused with these words.
fn all_are_refused(store: &[&str], words: &str) {
    for command in [
        &["serve", "--listen", "127.0.0.1:0", "--gpu", "off"][..],
        &["work"],
        &["check-store"],
        &["check-store", "--repair"],
        &["remove-expired", "--keep-days", "1"],
        &["new-store-id"],
    ] {
        let (status, said) = run(&[command, store].concat());
        assert_eq!(status, Some(78), "{command:?}: {said}");
        assert!(said.contains(words), "{command:?}: {said}");
    }
}

fn id_of(store: &Path) -> String {
    let label = std::fs::read_to_string(store.join("objects/store-id")).unwrap();
    label.trim().to_owned()
}

#[test]
fn an_empty_place_is_no_store_until_somebody_makes_one() {
    let place = Place::new();
    let (missing, empty) = (place.text("missing"), place.text("empty"));
    std::fs::create_dir(&empty).unwrap();
    let database = format!("sqlite://{}", place.text("typo.sqlite"));
    for store in [
        &["--data", &missing][..],
        &["--data", &empty],
        &["--data", &empty, "--database", &database],
    ] {
        all_are_refused(store, "there is no store here");
        all_are_refused(store, "isocortex init-store");
    }
    assert!(!Path::new(&missing).exists());
    assert!(files_below(place.0.path()).is_empty());

    let made = done(&["init-store", "--data", &missing]);
    let id = made.trim().to_owned();
    assert_eq!(id_of(Path::new(&missing)), id);
    assert_eq!(done(&["init-store", "--data", &missing]).trim(), id);
    done(&["check-store", "--data", &missing]);
    // The setting makes one, too; a command that only looks does not, whatever the file says.
    let config = place.text("isocortex.toml");
    std::fs::write(
        &config,
        format!("[storage]\ndata = \"{empty}\"\ncreate = true\n"),
    )
    .unwrap();
    let (status, said) = run(&["check-store", "--config", &config]);
    assert_eq!(status, Some(78), "{said}");
    let mut server = Logged::serve(&empty, &["--config", &config]);
    server.until("listening");
    server.end();
    assert_ne!(id_of(Path::new(&empty)), id);
}

#[test]
fn a_folder_that_is_not_mounted_stops_every_command_and_no_case_fails() {
    let place = Place::new();
    let case = place.prepared("store");
    let (store, data) = (place.path("store"), place.text("store"));
    let picture = place.text("picture.png");
    let render = ["render", &case, "--data", &data, "--output", &picture];
    let id = id_of(&store);
    let (objects, away) = (store.join("objects"), place.path("away"));
    std::fs::rename(&objects, &away).unwrap();
    all_are_refused(
        &["--data", &data],
        "the folder of the objects does not exist",
    );
    std::fs::create_dir(&objects).unwrap();
    all_are_refused(
        &["--data", &data],
        &format!("belongs to the store {id}, the objects have no `store-id`"),
    );
    let (status, said) = run(&render);
    assert_eq!(status, Some(78), "{said}");
    assert!(files_below(&objects).is_empty());
    // `prepare` and `init-store` may make a store, and this is none.
    let volume = place.text("head.nii");
    for command in [
        &["prepare", &volume, "--data", &data][..],
        &["init-store", "--data", &data],
    ] {
        let (status, said) = run(command);
        assert_eq!(status, Some(78), "{said}");
        assert!(said.contains("is their folder mounted"), "{said}");
    }
    assert!(files_below(&objects).is_empty());
    std::fs::remove_dir(&objects).unwrap();
    std::fs::rename(&away, &objects).unwrap();
    done(&render);
    assert!(done(&["check-store", "--data", &data]).contains("read: 1 cases"));
}

#[test]
fn the_objects_of_another_store_are_not_touched() {
    let place = Place::new();
    let case = place.prepared("good");
    place.prepared("staging");
    let objects = format!("file://{}", place.text("good/objects"));
    let [good, staging] = ["good", "staging"].map(|name| id_of(&place.path(name)));
    let before = state(&place.path("good"));
    // Another database, with and without cases; a database of yesterday that knows no case is an old copy of the right one.
    done(&["init-store", "--data", &place.text("empty")]);
    let empty = id_of(&place.path("empty"));
    for (name, theirs) in [("staging", &staging), ("empty", &empty)] {
        let data = place.text(name);
        let store = ["--data", &data, "--objects", &objects];
        all_are_refused(&store, theirs);
        all_are_refused(&store, &good);
    }
    // The variable of another shell.
    let mut command = Command::new(program());
    command.args(["check-store", "--repair", "--data", &place.text("staging")]);
    let refused = command.env("ISOCORTEX_OBJECTS", &objects).output().unwrap();
    assert_eq!(refused.status.code(), Some(78), "{refused:?}");
    // A fresh folder: the commands that may make a store do not make one around the objects of another.
    let fresh = place.text("fresh");
    let (status, said) = run(&["init-store", "--data", &fresh, "--objects", &objects]);
    assert_eq!(status, Some(78), "{said}");
    assert!(said.contains("the database belongs to no store"), "{said}");
    // A copy into it, or out of it.
    let crossed = format!("sqlite://{},{objects}", place.text("staging/rows.sqlite"));
    let good_folder = place.text("good");
    for [from, to] in [[&crossed, &fresh], [&good_folder, &crossed]] {
        let (status, said) = run(&["migrate-store", "--from", from, "--to", to]);
        assert_eq!(status, Some(78), "{said}");
    }
    assert!(
        state(&place.path("good")) == before,
        "an object has changed"
    );
    let picture = place.text("picture.png");
    done(&[
        "render",
        &case,
        "--data",
        &good_folder,
        "--output",
        &picture,
    ]);
}

#[test]
fn a_copy_is_told_from_its_original_by_an_id_of_its_own() {
    let place = Place::new();
    place.prepared("good");
    let (good, copy, moved) = (place.path("good"), place.path("copy"), place.path("moved"));
    for file in files_below(&good) {
        let to = copy.join(file.strip_prefix(&good).unwrap());
        std::fs::create_dir_all(to.parent().unwrap()).unwrap();
        std::fs::copy(file, to).unwrap();
    }
    let [good_text, copy_text, moved_text] = ["good", "copy", "moved"].map(|name| place.text(name));
    let id = id_of(&good);
    assert_eq!(id_of(&copy), id);
    let new = done(&["new-store-id", "--data", &copy_text]);
    assert_eq!(id_of(&copy), new.trim());
    assert_ne!(id_of(&copy), id);
    done(&["check-store", "--data", &copy_text]);
    let objects = format!("file://{}", place.text("good/objects"));
    all_are_refused(&["--data", &copy_text, "--objects", &objects], &id);
    // A copy by `migrate-store` has an id of its own, and keeps it.
    for _ in 0..2 {
        done(&["migrate-store", "--from", &good_text, "--to", &moved_text]);
        assert!(![id.as_str(), new.trim()].contains(&id_of(&moved).as_str()));
    }
    assert_eq!(id_of(&good), id);
    // A damaged label names the id that it should have.
    std::fs::write(copy.join("objects/store-id"), "damaged").unwrap();
    all_are_refused(&["--data", &copy_text], new.trim());
    std::fs::write(copy.join("objects/store-id"), &new).unwrap();
    done(&["check-store", "--data", &copy_text]);
}

#[test]
fn a_running_server_answers_503_with_both_ids_until_its_objects_are_back() {
    let place = Place::new();
    let case = place.prepared("store");
    let (store, data) = (place.path("store"), place.text("store"));
    let config = place.text("isocortex.toml");
    std::fs::write(&config, "[render]\ncache_bytes = 0\n").unwrap();
    let mut server = Logged::serve(&data, &["--config", &config]);
    let line = server.until("listening");
    let address = line["address"].as_str().unwrap().to_owned();
    let ready = || get(&address, "/readyz", "");
    assert_eq!(ready().0, 200);
    let [id, other] = [
        id_of(&store),
        "01890000-0000-7000-8000-000000000000".to_owned(),
    ];
    let (objects, away) = (store.join("objects"), place.path("away"));
    std::fs::rename(&objects, &away).unwrap();
    // Unmounted; an empty folder; the objects of another store; a damaged label.
    for label in [
        None,
        Some(String::new()),
        Some(format!("{other}\n")),
        Some("x".to_owned()),
    ] {
        if let Some(label) = &label {
            std::fs::create_dir_all(&objects).unwrap();
            if !label.is_empty() {
                std::fs::write(objects.join("store-id"), label).unwrap();
            }
        }
        let (status, body) = ready();
        assert_eq!(status, 503, "{body}");
        assert!(body.contains(&id), "{body}");
        assert_eq!(
            body.contains(&other),
            label.is_some_and(|label| label.contains(&other))
        );
    }
    let before = state(&objects);
    let body = form(&[("volume", &plain_head().bytes())]);
    let upload = post(&address, "/v1/cases", &form_type(), &body);
    assert_eq!(upload, 503);
    assert_eq!(state(&objects), before, "nothing was written");
    std::fs::remove_dir_all(&objects).unwrap();
    std::fs::rename(&away, &objects).unwrap();
    assert_eq!(ready().0, 200);
    let (status, json) = get(&address, &format!("/v1/cases/{case}"), "");
    assert_eq!(status, 200);
    assert!(json.contains("\"state\":\"ready\""), "{json}");
    server.end();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_waits_for_its_database_and_names_the_cause_once() {
    let Some(mut postgres) = PostgresServer::start().await else {
        return;
    };
    let place = Place::new();
    let database = postgres.database().await;
    let data = place.text("folder");
    let objects = format!("file://{}", place.text("objects"));
    let shared = [
        "--database",
        &database,
        "--objects",
        &objects,
        "--data",
        &data,
    ];
    let made = tokio::task::block_in_place(|| done(&[&["init-store"][..], &shared].concat()));
    assert_eq!(made.trim().len(), 36, "{made}");
    postgres.stop();
    let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = port.local_addr().unwrap().to_string();
    drop(port);
    let serve = ["serve", "--gpu", "off", "--listen", &address];
    let mut server = Logged::start(&[&serve[..], &shared].concat());
    let waits = server.until("waiting for the store");
    let cause = waits["cause"].as_str().unwrap();
    assert!(
        ["refused", "No such file"]
            .iter()
            .any(|words| cause.contains(words)),
        "{waits}"
    );
    let status = |path: &str| loop {
        // It listens a moment after it has said so.
        if std::net::TcpStream::connect(&address).is_ok() {
            return get(&address, path, "").0;
        }
    };
    assert_eq!(
        [status("/healthz"), status("/readyz"), status("/v1/cases")],
        [200, 503, 503]
    );
    postgres.start_again().await;
    server.until("listening");
    assert_eq!(
        [status("/healthz"), status("/readyz"), status("/v1/cases")],
        [200, 200, 200]
    );
    assert_eq!(server.count("waiting for the store"), 1);
    server.end();
    // Told to stop while it waits, it ends well. A worker waits, too.
    postgres.stop();
    for command in [&serve[..], &["work"]] {
        let mut waiting = Logged::start(&[command, &shared].concat());
        waiting.until("waiting for the store");
        waiting.stop();
    }
}
