//! A store that an earlier version wrote: it opens, and answers as it did then.

use std::io::{Cursor, Read as _};
use std::path::Path;

use serde_json::Value;

use crate::server::Server;

const ARCHIVE: &[u8] = include_bytes!("../fixtures/store-48a553e.zip");

/// The ready case of the archive.
const READY: &str = "/v1/cases/f67e5a76ff8a7b1b135cdfd68538ea1c";
/// Its version.
const VERSION: &str = "/v1/cases/2ee61df8a2eb07349b33b45809b1a028";
/// The case that failed.
const FAILED: &str = "/v1/cases/5bc3db9c6c66e98752de9c19038959d0";

fn archive() -> zip::ZipArchive<Cursor<&'static [u8]>> {
    zip::ZipArchive::new(Cursor::new(ARCHIVE)).unwrap()
}

fn read(name: &str) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut archive = archive();
    let mut file = archive.by_name(name).unwrap();
    file.read_to_end(&mut bytes).unwrap();
    bytes
}

/// Lays the store of the archive into a directory.
fn unpack(directory: &Path) {
    let archive = archive();
    let names = archive.file_names().map(|name| name.unwrap().into_owned());
    for name in names.collect::<Vec<_>>() {
        let Some(below) = name.strip_prefix("store/") else {
            continue;
        };
        let path = directory.join(below);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, read(&name)).unwrap();
    }
}

async fn opened() -> Server {
    Server::start_with(|config| unpack(&config.storage.data)).await
}

/// Adds to `before` what an answer of today has beside it: `kept`, a ready case's `pipeline` and any codes of reasons. The links may become more.
/// What is known of a case stays.
fn with_additions(mut before: Value, now: &Value) -> Value {
    let cases = before["cases"].as_array_mut().unwrap();
    for (case, now) in cases.iter_mut().zip(now["cases"].as_array().unwrap()) {
        case["links"] = now["links"].clone();
        case["kept"] = Value::from(false);
        if case["state"] == "ready" {
            case["pipeline"] = Value::from(1);
        }
        if let Some(codes) = now["quality"].get("reason_codes") {
            case["quality"]["reason_codes"] = codes.clone();
        }
    }
    before
}

#[tokio::test]
async fn cases_of_a_store_of_an_earlier_version_are_what_they_were() {
    let server = opened().await;
    let before: Value = serde_json::from_slice(&read("answers/cases.json")).unwrap();
    let now = server.get("/v1/cases").await.json();
    assert_eq!(now, with_additions(before, &now));
    assert_eq!(server.state.cases.store().counters().bad_objects, 0);
}

#[tokio::test]
async fn meshes_of_a_store_of_an_earlier_version_are_the_same_bytes() {
    let server = opened().await;
    for case in [READY, VERSION] {
        let mesh = server.get(&format!("{case}/mesh?depth_mm=8")).await;
        assert_eq!(mesh.body, read("answers/mesh-8mm.bin"));
    }
    let mesh = server
        .get(&format!("{READY}/mesh?depth_mm=20&paths=flow"))
        .await;
    assert_eq!(mesh.body, read("answers/mesh-20mm-flow.bin"));
}

#[tokio::test]
async fn a_failure_of_an_earlier_version_keeps_its_status_and_its_words() {
    let server = opened().await;
    let answer = server.get(&format!("{FAILED}/mesh?depth_mm=8")).await;
    assert_eq!(answer.problem(), "mask-size-absurd");
    assert_eq!(answer.status, 422);
    assert!(answer.json()["detail"].as_str().unwrap().contains("ml"));
}
