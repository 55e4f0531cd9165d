//! A store that an earlier program made is opened, and what is in it is as it was.
//!
//! `ISOCORTEX_WRITE_GOLDEN=1` makes `golden/store.zip` again. Do so while 0.1.0 is not released and its tables or objects change. From
//! then on the file stays, and each later migration has to open it.

use std::collections::BTreeMap;
use std::io::{Cursor, Read as _, Write as _};
use std::path::{Path, PathBuf};

use axum::http::StatusCode;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use ring::digest::SHA256;
use serde_json::{Value, json};
use storage::testing::files_below;
use zip::write::SimpleFileOptions;
use zip::{ZipArchive, ZipWriter};

use crate::dicom::head_slices;
use crate::findings::mark;
use crate::flair::{added, patch};
use crate::head::plain_head;
use crate::pacs::Neighbour;
use crate::series_builder::{Syntax, files};
use crate::server::{Part, Server};

/// What is asked about the case: what it says, and what is computed from its objects.
const QUESTIONS: [&str; 8] = [
    "",
    "/findings",
    "/layers",
    "/dicom",
    "/volume",
    "/mesh?depth_mm=8",
    "/mesh/paths",
    "/render?depth_mm=8&renderer=splat",
];

/// Names in the archive: the files of the store, and the answers of the program that made it.
const STORE: &str = "store";
const ANSWERS: &str = "answers.json";

fn kept() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("golden/store.zip")
}

/// Makes a store with a case from a PACS that is kept and has findings and a layer.
async fn make() {
    let neighbour = Neighbour::start(|_| {}).await;
    let stored = neighbour
        .store(&files(&head_slices(), Syntax::Explicit))
        .await;
    assert_eq!(stored.status, StatusCode::OK, "{stored:?}");
    let arrival = neighbour.settled().await;
    let case = format!("/v1/cases/{}", arrival["case"].as_str().unwrap());
    neighbour.server.until_ready(&case).await;
    let changed = patch(&neighbour.server, &case, json!({ "kept": true })).await;
    assert_eq!(changed.status, StatusCode::OK, "{changed:?}");
    let parameters = json!({ "contrast": "flair" }).to_string();
    let layer = plain_head().bytes();
    let parts: [Part<'_>; 2] = [("parameters", parameters.as_bytes()), ("volume", &layer)];
    added(&neighbour.server, &case, &parts).await;
    mark(&neighbour.server, &case).await;
    let server = neighbour.restarted().await;

    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    let mut put = |name: String, bytes: &[u8]| {
        archive
            .start_file(name, SimpleFileOptions::default())
            .unwrap();
        archive.write_all(bytes).unwrap();
    };
    let answers = json!({ "case": case, "answers": answers(&server, &case).await });
    put(ANSWERS.to_owned(), answers.to_string().as_bytes());
    for file in files_below(server.directory()) {
        let name = file.strip_prefix(server.directory()).unwrap();
        put(
            format!("{STORE}/{}", name.display()),
            &std::fs::read(&file).unwrap(),
        );
    }
    std::fs::write(kept(), archive.finish().unwrap().into_inner()).unwrap();
}

/// The answers to all questions: JSON as it is, other bodies as digests, pictures by their pixels.
async fn answers(server: &Server, case: &str) -> BTreeMap<String, Value> {
    let mut answers = BTreeMap::new();
    for question in QUESTIONS {
        let answer = server.get(&format!("{case}{question}")).await;
        assert_eq!(answer.status, StatusCode::OK, "{question}: {answer:?}");
        let value = match answer.header("content-type") {
            "application/json" => answer.json(),
            "image/png" => json!(digest(answer.grey().as_raw())),
            _ => json!(digest(&answer.body)),
        };
        answers.insert(question.to_owned(), value);
    }
    answers
}

fn digest(bytes: &[u8]) -> String {
    STANDARD.encode(ring::digest::digest(&SHA256, bytes))
}

/// Whether all that an answer had is in another one, which may have more keys.
fn is_within(before: &Value, now: &Value) -> bool {
    match (before, now) {
        (Value::Object(before), Value::Object(now)) => before
            .iter()
            .all(|(key, value)| now.get(key).is_some_and(|now| is_within(value, now))),
        (Value::Array(before), Value::Array(now)) => {
            let mut pairs = before.iter().zip(now);
            before.len() == now.len() && pairs.all(|(before, now)| is_within(before, now))
        }
        _ => before == now,
    }
}

#[tokio::test]
async fn a_store_of_an_earlier_program_is_opened_and_has_what_it_had() {
    if std::env::var_os("ISOCORTEX_WRITE_GOLDEN").is_some() {
        make().await;
    }
    let directory = tempfile::tempdir().unwrap();
    let mut archive = ZipArchive::new(std::fs::File::open(kept()).unwrap()).unwrap();
    let mut before = Value::Null;
    for index in 0..archive.len() {
        let mut file = archive.by_index(index).unwrap();
        let name = file.enclosed_name().unwrap();
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).unwrap();
        if name == Path::new(ANSWERS) {
            before = serde_json::from_slice(&bytes).unwrap();
            continue;
        }
        let path = directory.path().join(name.strip_prefix(STORE).unwrap());
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }
    let server = Server::start_on(directory, |_| {}).await;
    // What is kept for some days only is gone by the time that a later program opens the store.
    let days = std::time::Duration::from_secs(30 * 24 * 3600);
    server.state.cases.store().pass_time(days);
    let case = before["case"].as_str().unwrap();
    let now = answers(&server, case).await;
    for (question, before) in before["answers"].as_object().unwrap() {
        let now = &now[question];
        assert!(
            is_within(before, now),
            "{question}\nbefore: {before}\nnow: {now}"
        );
    }
}
